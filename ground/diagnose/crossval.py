"""Cross-validation: how a fitted plant predicts the segments that were left out of its fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ground.diagnose.fit import Fit, fit_plant
from ground.diagnose.problem import FitProblem, Ranges
from ground.diagnose.scoring import block_scores, learned_scale
from ground.diagnose.segments import Segment

Float = NDArray[np.float64]

FOLDS = 4
BLOCKS_WANTED = 16


@dataclass(frozen=True)
class HeldOut:
    """Standardised residuals of left-out segments (samples, outputs), and the scale each fit learned (outputs,)."""

    residuals: tuple[Float, ...]
    scales: tuple[Float, ...]

    @property
    def mean_square(self) -> float:
        """Mean squared standardised residual over all that was left out in turn."""
        stacked = np.concatenate([block.ravel() for block in self.residuals])
        return float(np.nanmean(stacked**2))

    def scores(self, share: Float) -> Float:
        """Log predictive density by block, counting `share` effective samples per sample."""
        parts = max(1, round(BLOCKS_WANTED / len(self.residuals)))
        return np.concatenate(
            [
                block_scores(np.array_split(block, parts), scale, share)
                for block, scale in zip(self.residuals, self.scales, strict=True)
            ]
        )


def cross_validate(fit: Fit, segments: Sequence[Segment], sigmas: Float, ranges: Ranges) -> HeldOut:
    """Leave neighbouring segments (whole recordings, where there are several) out in turn, refit, predict.

    A single segment cannot be left out; its own residuals stand in, and the learned scale with them.
    """
    if len(segments) == 1:
        return in_sample(fit, segments)
    residuals: list[Float] = []
    scales: list[Float] = []
    width = segments[0].observed.shape[1]
    for held in folds_of(len(segments)):
        kept = [segment for i, segment in enumerate(segments) if i not in held]
        trained = fit_plant(fit.plant, kept, sigmas, ranges, fit.values, tolerance=1e-3, iterations=6)
        scale = learned_scale(trained.residuals.reshape(-1, width))
        for number in sorted(held):
            residuals.append(predict_segment(trained, segments[number], sigmas))
            scales.append(scale)
    return HeldOut(tuple(residuals), tuple(scales))


def in_sample(fit: Fit, segments: Sequence[Segment]) -> HeldOut:
    """The residuals that a fit leaves on its own segments, in the same form."""
    width = segments[0].observed.shape[1]
    rows = fit.residuals.reshape(-1, width)
    edges = np.cumsum([segment.samples for segment in segments])[:-1]
    residuals = [
        np.where(np.isfinite(segment.observed), block, np.nan)
        for segment, block in zip(segments, np.split(rows, edges), strict=True)
    ]
    return HeldOut(tuple(residuals), (learned_scale(rows),) * len(segments))


def predict_segment(fit: Fit, segment: Segment, sigmas: Float) -> Float:
    """Standardised residuals (samples, outputs) of a segment that was not fitted; NaN where nothing was seen.

    Only its open initial states are fitted to it, the parameters stay.
    """
    problem = FitProblem(fit.plant, (segment,), sigmas, {}, frozen=fit.values)
    residuals = problem.residuals(problem.settle_initial_states()).reshape(segment.observed.shape)
    return np.where(np.isfinite(segment.observed), residuals, np.nan)


def folds_of(count: int) -> tuple[frozenset[int], ...]:
    """Segments left out together: neighbours in time, whole recordings where there are several."""
    edges = np.linspace(0, count, min(FOLDS, count) + 1).round().astype(int)
    return tuple(frozenset(range(int(a), int(b))) for a, b in pairwise(edges) if b > a)
