"""The rival that knows no physics: a polynomial autoregressive model with inputs (NARX), by ridge regression.

Lags and degree are chosen by simulated error on a quarter of what may be fitted (Billings, Nonlinear System
Identification, 2013, ch. 3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from ground.diagnose.segments import Segment, head_of_run

Float = NDArray[np.float64]

LAGS = (3, 10)
DEGREES = (1, 3)
RIDGE = 1e-9
MOST_CHECKED = 8
CURVED = 2
"""Latest samples of each signal that enter products."""
RUNAWAY = 20.0
"""A simulated value this many scales from zero has run away."""


@dataclass(frozen=True)
class Narx:
    """y_k from the last `lags` outputs and inputs; all scaled to order one."""

    lags: int
    degree: int
    inputs: tuple[str, ...]
    scale_y: Float
    shift_y: Float
    scale_u: Float
    weights: Float

    def __call__(self, segment: Segment) -> Float:
        """Simulated outputs (samples, outputs): measured over the first samples, free from there on."""
        first = head_of_run(segment.run).times_s.size
        u = stacked(segment, self.inputs) / self.scale_u
        y = (filled(segment.observed) - self.shift_y) / self.scale_y
        y[first:] = 0.0
        for k in range(first, y.shape[0]):
            row = regressors(past(y, u, k, self.lags), self.degree, y.shape[1] + u.shape[1])
            y[k] = row @ self.weights
            if not np.all(np.abs(y[k]) < RUNAWAY):
                y[k:] = np.nan
                break
        return np.asarray(y * self.scale_y + self.shift_y)


def fit_narx(segments: Sequence[Segment], inputs: tuple[str, ...]) -> Narx | None:
    """The best of some sizes; None when none stays bounded on what was left out of its fit."""
    held = max(1, len(segments) // 4)
    train, check = segments[:-held], segments[-held:][:MOST_CHECKED]
    tried = [trained(train or segments, inputs, lags, degree) for lags in LAGS for degree in DEGREES]
    errors = [simulated_error(model, check) for model in tried]
    best = int(np.argmin(errors))
    if not np.isfinite(errors[best]):
        return None
    return trained(segments, inputs, tried[best].lags, tried[best].degree)


def trained(segments: Sequence[Segment], inputs: tuple[str, ...], lags: int, degree: int) -> Narx:
    """One size, by ridge regression on one step ahead."""
    observed = np.vstack([filled(s.observed) for s in segments])
    shift, scale = observed.mean(axis=0), np.maximum(observed.std(axis=0), 1e-300)
    drive = np.vstack([stacked(s, inputs) for s in segments])
    scale_u = np.maximum(np.abs(drive).max(axis=0, initial=0.0), 1e-300)
    rows, targets = [], []
    for segment in segments:
        y, u = (filled(segment.observed) - shift) / scale, stacked(segment, inputs) / scale_u
        rows.append(regressors(history(y, u, lags), degree, y.shape[1] + u.shape[1]))
        targets.append(y[lags:])
    a, b = np.vstack(rows), np.vstack(targets)
    information = a.T @ a + RIDGE * a.shape[0] * np.eye(a.shape[1])
    weights = np.linalg.lstsq(information, a.T @ b, rcond=None)[0]
    return Narx(lags, degree, inputs, scale, shift, scale_u, np.asarray(weights))


def simulated_error(model: Narx, segments: Sequence[Segment]) -> float:
    """Mean squared scaled error of simulations; infinite when one runs away."""
    errors = [(s.observed - model(s)) / model.scale_y for s in segments]
    stack = np.vstack(errors)
    bad = ~np.isfinite(stack) & np.isfinite(np.vstack([s.observed for s in segments]))
    return float("inf") if bad.any() else float(np.nanmean(stack**2))


def history(y: Float, u: Float, lags: int) -> Float:
    """Past outputs and inputs of every sample from the first that has enough, latest first, (samples, signals)."""
    count = y.shape[0]
    columns = [signal[lags - back : count - back] for back in range(1, lags + 1) for signal in (y, u)]
    return np.column_stack([u[lags:], *columns])


def past(y: Float, u: Float, k: int, lags: int) -> Float:
    """One row of `history`, (1, signals)."""
    columns = [signal[k - back] for back in range(1, lags + 1) for signal in (y, u)]
    return np.concatenate([u[k], *columns])[None, :]


def regressors(signals: Float, degree: int, width: int) -> Float:
    """All signals, a constant, and products of the latest ones up to the degree."""
    latest = [signals[:, i] for i in range(min(signals.shape[1], CURVED * width))]
    columns = [np.ones(signals.shape[0]), *signals.T]
    for power in range(2, degree + 1):
        columns += [np.prod(chosen, axis=0) for chosen in combinations_with_replacement(latest, power)]
    return np.column_stack(columns)


def stacked(segment: Segment, inputs: Sequence[str]) -> Float:
    """Inputs (samples, inputs); gaps bridged by lines."""
    columns = [segment.run.inputs[name] for name in inputs]
    table = np.column_stack(columns) if columns else np.empty((segment.samples, 0))
    return filled(table)


def filled(table: Float) -> Float:
    """A table with its gaps bridged by lines."""
    full = table.copy()
    at = np.arange(table.shape[0])
    for column in full.T:
        seen = np.isfinite(column)
        if seen.any() and not seen.all():
            column[~seen] = np.interp(at[~seen], at[seen], column[seen])
    return full
