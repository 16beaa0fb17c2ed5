"""What a reader of a diagnosis must keep in mind."""

from __future__ import annotations

import difflib
from collections.abc import Iterator

from ground.diagnose.belonging import amount
from ground.diagnose.between import between_samples
from ground.diagnose.candidates import label_of
from ground.diagnose.chosen import Named
from ground.diagnose.data import HELD_OUT_SHARE, Data
from ground.diagnose.fit import Fit
from ground.diagnose.needed import needed
from ground.diagnose.problem import PRIOR_REACH
from ground.diagnose.tension import strained
from ground.diagnose.unlike_units import unlike_units, unstated_units
from sim_hal.plant.simulate import Plant


def notes_of(data: Data, plant: Plant, refit: Fit, named: Named) -> tuple[str, ...]:
    """What a reader must keep in mind."""
    notes = [
        *unlike_units(plant, data.whole),
        *unstated_units(plant),
        *absent_channels(data),
        amount((*data.fitted, *data.held_out), data.single),
    ]
    if data.by_windows:
        notes.append(
            "Run free, this plant runs away from what was recorded: it was fitted, and judged on what was held out, "
            f"in windows of {data.windows[0].samples} samples, each with a start of its own."
        )
    notes += needed(named.chosen, plant)
    if data.single:
        notes.append(
            f"There was one recording: its last {HELD_OUT_SHARE:.0%} was held out, so what changes from run to run "
            "was not tested. A second recording would."
        )
    notes += between_samples(plant, named.fit.plant)
    notes += strained(named.fit) if named.chosen else ()
    stated = refit.plant.flat()
    for name, value in named.fit.values.items():
        if name in stated and stated[name].std > 0.0:
            away = (value - stated[name].value) / stated[name].std
            if abs(away) > PRIOR_REACH - 0.01:
                notes.append(f"{name} ends at the edge of its tolerance ({away:+.1f} sigma).")
    refused = ", ".join(f"{label_of(candidate)} ({p:.2f})" for candidate, p in named.refused)
    if refused:
        notes.append(f"Tried last and not taken (probability of predicting better in brackets): {refused}.")
    return tuple(notes)


def absent_channels(data: Data) -> Iterator[str]:
    """Sensors of which something is stated, but that no recording has: a slip of the pen leaves a channel without."""
    recordings = (*data.fitted, *data.held_out)
    read = {name for r in recordings for table in (r, *r.extra_tables.values()) for name in table.channels}
    stated = {name for recording in recordings for name in recording.sensors}
    for name in sorted(stated - read):
        near = difflib.get_close_matches(name, sorted(read - stated), 1)
        meant = f" (is {near[0]} meant?)" if near else ""
        yield f"The sidecars' sensors tell of {name}, but no recording has such a channel{meant}."
