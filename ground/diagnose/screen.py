"""Screen: which effects the residuals ask for, before any of them is fitted in full."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ground.diagnose.candidates import Candidate
from ground.diagnose.fit import Fit
from ground.diagnose.problem import FitProblem
from ground.diagnose.segments import Segment
from sim_hal.plant.simulate import EffectUse

Float = NDArray[np.float64]

SAME = 0.9999
"""Two effects whose sensitivities correlate this closely are one and the same on these recordings."""
UNFELT = 1e-3
"""An effect that moves no reading by this share of its sigma, at its start's strength, cannot be judged."""
SMALL = 1e-3
"""Strength at which the derivative is taken, as a share of the candidate's start."""


def screen(
    current: Fit, offered: Sequence[Candidate], segments: Sequence[Segment], sigmas: Float
) -> list[Candidate]:
    """Candidates by the drop in chi-square that a linear step in their strength promises, best first.

    The residuals' sensitivity to the strength at zero, made orthogonal to those of all that is fitted already:
    what the parameters can absorb counts for nothing (Rao's score test with nuisance parameters). Of each
    candidate's starts the most promising is kept; of candidates that act alike here, the first of the catalogue.
    """
    basis, _ = np.linalg.qr(current.jacobian)
    ranked: list[tuple[float, Candidate, Float]] = []
    for candidate in offered:
        trials = [
            (*score_gain(current, use, candidate, segments, sigmas, basis), use) for use in candidate.uses
        ]
        gain, direction, use = max(trials, key=lambda trial: trial[0])
        if gain > 0.0 and not any(abs(direction @ other) > SAME for _, _, other in ranked):
            ranked.append((gain, replace(candidate, uses=(use,)), direction))
    return [candidate for _, candidate, _ in sorted(ranked, key=lambda item: -item[0])]


def score_gain(
    current: Fit,
    use: EffectUse,
    candidate: Candidate,
    segments: Sequence[Segment],
    sigmas: Float,
    basis: Float,
) -> tuple[float, Float]:
    """Promised drop in chi-square of one candidate from one start, and the direction it moves the residuals in.

    The drop is 0 where the strength's sign forbids it, or where these recordings do not feel the effect at all.
    """
    weak = candidate.weakened(use, SMALL)
    problem = FitProblem(current.plant.with_effect(weak), segments, sigmas, {}, frozen=current.values)
    slope = problem.residuals(problem.start_at(current.initial)) - current.residuals
    slope = slope - basis @ (basis.T @ slope)
    length = float(np.linalg.norm(slope))
    if length < SMALL * UNFELT * np.sqrt(slope.size):
        return 0.0, np.zeros_like(slope)
    along = -float(slope @ current.residuals) / length
    return (along**2 if along > 0.0 or candidate.two_sided else 0.0), slope / length
