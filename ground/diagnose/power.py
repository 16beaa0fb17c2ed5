"""What these recordings could have shown: the smallest strength of each explanation that would have been seen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ground.diagnose.candidates import EffectCandidate, label_of
from ground.diagnose.screen import Promise


def power_of(screened: Sequence[Promise]) -> list[dict[str, object]]:
    """By effect and place, the smallest strength that these recordings would have shown, the likeliest seen first.

    The figure is that of the start (of width, place, characteristic speed) at which the recordings feel the effect
    best; another shape may need more.
    """
    best: dict[str, Promise] = {}
    for promise in screened:
        key, least = promise.candidate.key, promise.least
        if np.isfinite(least) and (key not in best or least < best[key].least):
            best[key] = promise
    seen = sorted(best.values(), key=lambda p: p.least)
    return [row_of(p, p.candidate) for p in seen if isinstance(p.candidate, EffectCandidate)]


def row_of(promise: Promise, candidate: EffectCandidate) -> dict[str, object]:
    """One line: name, place, the strength's own name, its smallest visible value and unit."""
    name = candidate.own_strengths[0]
    stored = candidate.uses[promise.start].parameters[name]
    return {
        "physics_id": candidate.physics_id,
        "place": candidate.channel or candidate.equation,
        "parameter": name,
        "smallest_seen": abs(stored.value) * promise.least,
        "unit": stored.unit,
    }


def untestable(screened: Sequence[Promise]) -> list[str]:
    """Effects that would move no reading of these recordings, from whatever start."""
    felt = {promise.candidate.key for promise in screened if np.isfinite(promise.least)}
    dull = {p.candidate.key: label_of(p.candidate) for p in screened if p.candidate.key not in felt}
    return sorted(dull.values())
