"""Cross-validation: how a fitted plant predicts the recordings that were left out of its fit.

Leaving stretches out moves the optimum only a little, so where it moves to, and how the left-out stretches are
then predicted, follows from the sensitivities of the one full fit by a Newton step (approximate cross-validation:
Beirami, Razaviyayn, Shahrampour and Tarokh 2017; Giordano et al. 2019). Sensitivities may be wrong where a foot just
touches, or an unknown is told by its tolerance alone: a stretch that is predicted far worse than it was fitted is
simulated at the unknowns that the others tell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ground.diagnose.fit import Fit, bounds_of
from ground.diagnose.problem import FitProblem
from ground.diagnose.scoring import block_scores, learned_scale
from ground.diagnose.segments import Segment

Float = NDArray[np.float64]

FOLDS = 8
BLOCKS_WANTED = 16
DOUBTFUL = 1.5
"""A left-out stretch whose squared residual grows by more than this is simulated."""
UNTOLD = 0.05
"""An unknown of which the rest of the data holds less than this share of the information (the soil of the only hop on
it, a start) is settled on the left-out data itself: what nobody could know is no failure to predict."""


@dataclass(frozen=True)
class HeldOut:
    """Standardised residuals of left-out segments, (samples, outputs) each.

    Their scale is their own, all left-out segments together: one that the fitted part teaches would punish the model
    that fits better, for being surer of what two recordings can't tell yet.
    """

    residuals: tuple[Float, ...]

    @property
    def scale(self) -> Float:
        """Root mean square by channel, (outputs,), in sigmas of the sensor, at least 1."""
        return learned_scale(np.vstack(self.residuals))

    @property
    def mean_square(self) -> float:
        """Mean squared standardised residual over all that was left out in turn."""
        stacked = np.concatenate([block.ravel() for block in self.residuals])
        return float(np.nanmean(stacked**2))

    def by_channel(self) -> list[Float]:
        """All residuals of each output, (samples,) each."""
        return list(np.concatenate(self.residuals).T)

    def scores(self, share: Float, scale: Float | None = None) -> Float:
        """Log predictive density by block, counting `share` effective samples per sample."""
        parts = max(1, round(BLOCKS_WANTED / len(self.residuals)))
        used = self.scale if scale is None else scale
        return np.concatenate(
            [block_scores(np.array_split(block, parts), used, share) for block in self.residuals]
        )


def cross_validate(fit: Fit, segments: Sequence[Segment], sigmas: Float) -> HeldOut:
    """Leave neighbouring segments (whole recordings, where there are several) out in turn and predict them.

    A single segment cannot be left out; its own residuals stand in. `sigmas` (outputs,) are the sensors'.
    """
    if len(segments) == 1:
        return in_sample(fit, segments)
    edges = np.concatenate([[0], np.cumsum([segment.observed.size for segment in segments])])
    moving = ~fit.held
    jacobian, prior = fit.jacobian[:, moving], fit.prior[moving]
    information = [j.T @ j for j in (jacobian[a:b] for a, b in pairwise(edges))]
    slopes = [jacobian[a:b].T @ fit.residuals[a:b] for a, b in pairwise(edges)]
    whole, slope = sum(information) + np.diag(prior), sum(slopes) + prior * fit.z[moving]
    residuals: list[Float] = []
    again = Simulated(fit, segments, sigmas)
    for held in folds_of(len(segments)):
        own = sum(information[i] for i in held)
        kept = whole - own
        told = np.diag(kept) > UNTOLD * np.diag(whole)
        rest_slope = slope - sum(slopes[i] for i in held)
        step = newton_step(kept, rest_slope, told)
        for number in sorted(held):
            a, b = edges[number], edges[number + 1]
            predicted = again.checked(fit.residuals[a:b] + jacobian[a:b] @ step, step, number)
            predicted = predicted - settled(jacobian[a:b][:, ~told], predicted, prior[~told])
            residuals.append(seen(predicted, segments[number]))
    return HeldOut(tuple(residuals))


class Simulated:
    """Simulations at other unknowns than the fitted ones; made ready when first needed."""

    def __init__(self, fit: Fit, segments: Sequence[Segment], sigmas: Float) -> None:
        self._fit, self._segments, self._sigmas = fit, segments, sigmas

    @cached_property
    def _problem(self) -> FitProblem:
        fit = self._fit
        return FitProblem(fit.plant, self._segments, self._sigmas, {}, unknowns=fit.free)

    def checked(self, predicted: Float, step: Float, number: int) -> Float:
        """A segment's residuals as predicted after a step of what moves, or as simulated where that is nearer."""
        start = sum(segment.observed.size for segment in self._segments[:number])
        fitted = self._fit.residuals[start : start + predicted.size]
        power = float(predicted @ predicted)
        if power < DOUBTFUL * max(float(fitted @ fitted), float(predicted.size)):
            return predicted
        z = self._fit.z.copy()
        z[~self._fit.held] += step
        low, high = bounds_of(self._fit.free)
        z = np.clip(z, low, high)
        simulated = self._problem.segment_residuals(z, number, self._problem.values(z))
        return simulated if float(simulated @ simulated) < power else predicted


def newton_step(information: Float, slope: Float, told: NDArray[np.bool_]) -> Float:
    """To the optimum of the rest; unknowns that it does not tell stay."""
    step = np.zeros(slope.size)
    step[told] = -np.linalg.lstsq(information[np.ix_(told, told)], slope[told], rcond=None)[0]
    return step


def settled(columns: Float, residuals: Float, prior: Float) -> Float:
    """What untold unknowns take out of the left-out residuals, within their tolerances."""
    if columns.shape[1] == 0:
        return np.zeros_like(residuals)
    information = columns.T @ columns + np.diag(prior)
    return np.asarray(columns @ np.linalg.lstsq(information, columns.T @ residuals, rcond=None)[0])


def seen(residuals: Float, segment: Segment) -> Float:
    """Residuals as (samples, outputs), NaN where nothing was measured."""
    return np.where(np.isfinite(segment.observed), residuals.reshape(segment.observed.shape), np.nan)


def in_sample(fit: Fit, segments: Sequence[Segment]) -> HeldOut:
    """The residuals that a fit leaves on its own segments, in the same form."""
    width = segments[0].observed.shape[1]
    rows = fit.residuals.reshape(-1, width)
    counts = np.cumsum([segment.samples for segment in segments])[:-1]
    residuals = [seen(part, segment) for segment, part in zip(segments, np.split(rows, counts), strict=True)]
    return HeldOut(tuple(residuals))


def folds_of(count: int) -> tuple[frozenset[int], ...]:
    """Segments left out together: neighbours in time, whole recordings where there are several."""
    edges = np.linspace(0, count, min(FOLDS, count) + 1).round().astype(int)
    return tuple(frozenset(range(int(a), int(b))) for a, b in pairwise(edges) if b > a)
