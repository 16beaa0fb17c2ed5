"""Confirm: an effect is claimed only if the recordings that no fit saw are predicted better with it.

Cross-validation within the fitted recordings is sure of small things too soon where a model leaves structure behind:
what it cannot describe is the same in every window. Held-out recordings have the last word.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ground.diagnose.candidates import label_of
from ground.diagnose.chosen import Chosen, Named
from ground.diagnose.fit import Fit
from ground.diagnose.name import Search
from ground.diagnose.scoring import probability_better
from ground.diagnose.segments import Segment
from ground.diagnose.unseen import HeldOutViews, errors_of
from sim_hal.plant.simulate import SimulationError

Float = NDArray[np.float64]

BLOCKS = 12
"""Stretches of the held-out windows that the comparison is bootstrapped over, at least."""
FELT = 0.1
"""An effect that moves what is predicted by less than this share of the error cannot be judged there; it stays."""


@dataclass(frozen=True)
class HeldOutTrial:
    """An effect on held-out stretches: whether they feel it, and the probability that it makes them better."""

    felt: bool
    probability: float


def searched(search: Search, refit: Fit, held_out: HeldOutViews) -> tuple[Named, tuple[str, ...]]:
    """The search's end as far as it is confirmed; where another start fits far better, the better of both ends."""
    first, passed_over = search.follow(refit, [])
    best = confirmed(first, search, held_out)
    if passed_over is None:
        return best
    search.outlook.say(f"going back to {label_of(passed_over[1][-1].candidate)}")
    other = confirmed(search.follow(*passed_over)[0], search, held_out)
    return other if search.better_of(best[0], other[0]) is other[0] else best


def confirmed(named: Named, search: Search, held_out: HeldOutViews) -> tuple[Named, tuple[str, ...]]:
    """The search's end without the effects that fail on what was held out, and the names of those, in words."""
    failed: list[str] = []
    while named.chosen:
        worst = next((one for view in held_out.views if (one := failing(named, search, *view))), None)
        if worst is None:
            break
        search.outlook.say(f"{label_of(worst.candidate)} does not hold on what was held out")
        failed.append(label_of(worst.candidate))
        named = search.again_without(named, worst)
    return named, tuple(failed)


def failing(named: Named, search: Search, view: Sequence[Segment], least: float) -> Chosen | None:
    """The effect that fails most clearly in one view, its probability of making it better being below `least`."""
    present = errors_of(named.fit, view, search.workers.context.sigmas)
    trials = [trial(present, one, view, search) for one in named.chosen]
    lost = [(t.probability, i) for i, t in enumerate(trials) if t.felt and t.probability < least]
    return named.chosen[min(lost)[1]] if lost else None


def holds(named: Named, search: Search, held_out: HeldOutViews) -> bool:
    """Whether the effect that joined last does not fail on what was held out."""
    if not named.chosen:
        return True
    for view, least in held_out.views:
        present = errors_of(named.fit, view, search.workers.context.sigmas)
        last = trial(present, named.chosen[-1], view, search)
        if last.felt and last.probability < least:
            return False
    return True


def trial(present: Sequence[Float], one: Chosen, held_out: Sequence[Segment], search: Search) -> HeldOutTrial:
    """One effect put to the test."""
    if one.absent is None:
        return HeldOutTrial(False, 1.0)
    try:
        absent = errors_of(one.absent, held_out, search.workers.context.sigmas)
    except SimulationError:  # a friction that falls below zero without it: nothing is predicted so
        return HeldOutTrial(True, 1.0)
    scale = np.sqrt(np.maximum(1.0, mean_square(np.vstack(present))))
    moved = np.sqrt(mean_square(np.vstack([a - b for a, b in zip(absent, present, strict=True)])))
    parts = max(1, round(BLOCKS / len(present)))
    better = probability_better(scores_of(present, scale, parts), scores_of(absent, scale, parts))
    return HeldOutTrial(bool((moved > FELT * scale).any()), better)


def scores_of(errors: Sequence[Float], scale: Float, parts: int) -> Float:
    """What each stretch counts for, the higher the better."""
    return -np.array([blockwise(part, scale) for error in errors for part in np.array_split(error, parts)])


def mean_square(errors: Float) -> Float:
    """Mean square by output, (outputs,); 0 where nothing was measured."""
    seen = np.isfinite(errors)
    power = np.sum(np.where(seen, errors, 0.0) ** 2, axis=0)
    return np.asarray(power / np.maximum(seen.sum(axis=0), 1))


def blockwise(errors: Float, scale: Float) -> float:
    """Mean square over a stretch and its channels, each in its own scale."""
    return float(np.mean(mean_square(errors / scale)))
