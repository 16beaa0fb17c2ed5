"""Starts that a sidecar leaves out: a body was dropped or pushed by hand, and nobody wrote down how fast it was."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ground.recordings.model import Recording
from sim_hal.plant.expressions import Name
from sim_hal.plant.simulate import Plant
from sim_hal.plant.structure import FIT, Known, State


def unstated_starts(plant: Plant, recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Known quantities that are nothing but a state's start, and that not all recordings tell.

    None of a plant with a state that starts otherwise: there the start is more than where things are (a string that
    is latched, a foot that stands).
    """
    structure = plant.structure
    starts = [s.initial.id if isinstance(s.initial, Name) else "" for s in structure.states.values()]
    if not all(start in structure.known for start in starts):
        return ()
    told = (r.state.keys() | r.conditions.keys() for r in recordings)
    both = set(starts).intersection(*told)
    return tuple(start for start in starts if start not in both and structure.known[start].default is None)


def with_open_starts(plant: Plant, recordings: Sequence[Recording]) -> Plant:
    """The plant with the starts that not all recordings tell read from the channel of that name, else fitted."""
    missing = unstated_starts(plant, recordings)
    if not missing:
        return plant
    read = {
        name
        for name in missing
        if all(name in r.channels and np.isfinite(r.channels[name]).any() for r in recordings)
    }
    structure = plant.structure
    known = {name: one for name, one in structure.known.items() if name not in missing}
    known |= {f"first({name})": Known(structure.known[name].unit) for name in sorted(read)}

    def opened(state: State) -> State:
        if not isinstance(state.initial, Name) or state.initial.id not in missing:
            return state
        name = state.initial.id
        return replace(state, initial=Name(f"first({name})") if name in read else FIT)

    states = {name: opened(state) for name, state in structure.states.items()}
    return replace(plant, structure=replace(structure, known=known, states=states))
