"""Errors on held-out data that drift cannot fake, each with an interval by block bootstrap.

Every model gets the same start: a window's first samples, and nothing measured after them. Windows are anchored anew;
a free run goes from the start of a held-out recording to its end.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ground.diagnose.segments import Segment, cut_recording, head_of_run, segment_of
from ground.diagnose.verify import predict
from ground.recordings.model import Recording
from sim_hal.plant.simulate import Plant, SimulationError, compile_plant

Float = NDArray[np.float64]
Predictor = Callable[[Segment], Float]

DRAWS = 2000
LEVEL = (0.05, 0.95)
BLOCKS = 20


@dataclass(frozen=True)
class Score:
    """A root mean square error with its 90 % interval, and the sums of squares of the blocks it is of."""

    value: float
    low: float
    high: float
    sums: Float = field(default_factory=lambda: np.empty(0), repr=False, compare=False)

    def __str__(self) -> str:
        return f"{self.value:.3g} ({self.low:.2g} to {self.high:.2g})"


def windows_of(recordings: Sequence[Recording], plant: Plant, samples: int) -> tuple[Segment, ...]:
    """Held-out recordings in windows of `samples`, whole ones only (a shorter recording is one window)."""
    compiled = compile_plant(plant)
    parts = [
        cut_recording(recording, start, min(recording.times_s.size, start + samples))
        for recording in recordings
        for start in range(0, max(1, recording.times_s.size - samples + 1), samples)
    ]
    return tuple(segment_of(part, plant, compiled) for part in parts)


def by_plant(plant: Plant, sigmas: Float) -> Predictor:
    """A plant as a predictor: open starts are fitted to the first samples. What fails is NaN."""

    def predicted(segment: Segment) -> Float:
        try:
            return predict(plant, segment, sigmas)
        except SimulationError:
            return np.full(segment.observed.shape, np.nan)

    return predicted


def squares(predictor: Predictor, windows: Sequence[Segment]) -> list[Float]:
    """Squared errors of each window after its first samples, (samples, outputs) each; infinite where it failed."""
    found = []
    for segment in windows:
        first = head_of_run(segment.run).times_s.size
        error = (segment.observed - predictor(segment))[first:] ** 2
        failed = ~np.isfinite(error) & np.isfinite(segment.observed[first:])
        found.append(np.where(failed, np.inf, error))
    return found


def scored(errors: Sequence[Float], column: int, parts: int = 1) -> Score:
    """Root mean square of one output over blocks (each window in `parts`), bootstrapped over the blocks."""
    blocks = [block for error in errors for block in np.array_split(error[:, column], parts) if block.size]
    sums = np.array([np.nansum(block) for block in blocks])
    counts = np.array([np.sum(~np.isnan(block)) for block in blocks], dtype=float)
    sums, counts = sums[counts > 0], counts[counts > 0]
    if not np.isfinite(sums).all():
        return Score(np.inf, np.inf, np.inf, sums)
    picks = drawn_blocks(sums.size)
    drawn = np.sqrt(sums[picks].sum(axis=1) / counts[picks].sum(axis=1))
    low, high = np.quantile(drawn, LEVEL)
    return Score(float(np.sqrt(sums.sum() / counts.sum())), float(low), float(high), sums)


def drawn_blocks(count: int) -> NDArray[np.int64]:
    """Draws (DRAWS, count) of blocks for a bootstrap, the same for all models: ratios are of the same blocks."""
    return np.random.Generator(np.random.PCG64(0)).integers(0, count, (DRAWS, count))


def ratio(own: Sequence[Float], other: Sequence[Float]) -> Score:
    """Error over another model's, by the sums of squares in each block, (blocks,) for each channel.

    Channels count alike. A model that ran away has infinite sums, and errs infinitely more.
    """
    drawn, values = [], []
    for mine, theirs in zip(own, other, strict=True):
        picks = drawn_blocks(mine.size)
        with np.errstate(invalid="ignore", divide="ignore"):
            drawn.append(theirs[picks].sum(axis=1) / mine[picks].sum(axis=1))
            values.append(theirs.sum() / mine.sum())
    with np.errstate(invalid="ignore", divide="ignore"):
        low, high = np.quantile(1.0 / np.sqrt(np.mean(drawn, axis=0)), LEVEL)
        return Score(float(1.0 / np.sqrt(np.mean(values))), float(low), float(high))


def blocks_of(windows: Sequence[Segment]) -> int:
    """In how many parts to cut each window, so that there is something to bootstrap over."""
    return max(1, -(-BLOCKS // len(windows)))
