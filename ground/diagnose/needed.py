"""How much more data of the same kind would tell what is still open."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ground.diagnose.accept import likelihood_here
from ground.diagnose.candidates import label_of
from ground.diagnose.chosen import Chosen
from sim_hal.plant.simulate import Plant

OPEN = 0.2
"""A rival more probable than this leaves a finding open."""
TOLD_ODDS = 19.0
"""Odds at which it counts as told."""
MOST = 20.0
"""More data than this many times what is there is no advice."""


def needed(chosen: Sequence[Chosen], plant: Plant) -> tuple[str, ...]:
    """For each effect with an open rival, how many times as much data would tell the two apart, in words."""
    return tuple(text for one in chosen if (text := needed_for(one, plant)) is not None)


def needed_for(one: Chosen, plant: Plant) -> str | None:
    """The same for one effect; None where nothing is open.

    What the recordings say for one law against another (log odds, less those beforehand) grows with their number.
    """
    weights = {candidate.key: weight for candidate, weight in one.weights}
    own = weights.pop(one.candidate.key, 0.0)
    rival = max((c for c, _ in one.weights if c.key in weights), key=lambda c: weights[c.key], default=None)
    if rival is None or own == 0.0 or weights[rival.key] < OPEN:
        return None
    beforehand = math.log(likelihood_here(one.candidate, plant) / likelihood_here(rival, plant))
    said = math.log(own / weights[rival.key]) - beforehand
    wanted = math.log(TOLD_ODDS) - beforehand
    names = f"{label_of(one.candidate)} from {label_of(rival)}"
    if said <= 0.0 or wanted > MOST * said:
        return f"More data of the same kind would hardly tell {names}."
    return f"About {max(wanted / said, 1.0):.2g} times as much data of the same kind would tell {names}."
