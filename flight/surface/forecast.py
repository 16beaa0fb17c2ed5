"""What the next hops will meet: the loss u, its C3 and its quantiles, averaged over all that is believed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flight.surface.tracker import Tracker

Array = NDArray[np.float64]

_BISECTIONS = 40
_REACH = 8.0  # standard deviations beyond the outermost mean within which every quantile lies
_LIGHT = 1e-4


@dataclass(frozen=True)
class LossForecast:
    """A Gaussian mixture of u: weights, means, variances (n,)."""

    weights: Array
    means: Array
    variances: Array

    @property
    def mean(self) -> float:
        """Mean u."""
        return float(self.weights @ self.means)

    @property
    def std(self) -> float:
        """Standard deviation of u."""
        return math.sqrt(float(self.weights @ (self.variances + (self.means - self.mean) ** 2)))

    def below(self, loss: float | Array) -> Array:
        """Probability that u is at most `loss`, for each."""
        z = (np.atleast_1d(loss)[:, None] - self.means) / self._sigmas
        return np.asarray(normal_below(z) @ self.weights)

    @cached_property
    def _sigmas(self) -> Array:
        return np.asarray(np.sqrt(self.variances))

    def quantiles(self, probabilities: Sequence[float]) -> Array:
        """The u below which each probability lies."""
        spread = _REACH * math.sqrt(float(np.max(self.variances)))
        low = np.full(len(probabilities), float(np.min(self.means)) - spread)
        high = np.full(len(probabilities), float(np.max(self.means)) + spread)
        wanted = np.asarray(probabilities)
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            less = self.below(middle) < wanted
            low, high = np.where(less, middle, low), np.where(less, high, middle)
        return np.asarray(0.5 * (low + high), dtype=np.float64)

    def scaled(self, factor: float) -> LossForecast:
        """With all losses times a factor."""
        return LossForecast(self.weights, self.means * factor, self.variances * factor**2)

    def widened(self, share: float) -> LossForecast:
        """Less sure by a share of u."""
        return LossForecast(self.weights, self.means, self.variances + (share * self.means) ** 2)


def forecast_loss(
    tracker: Tracker, energy_j: float, extra_dose: float = 0.0, *, with_common: bool = True
) -> LossForecast:
    """u of a hop of `energy_j` once the spot bore `extra_dose` more, if the ground does not change.

    `with_common` keeps the error of C2_ref in, as the height of a leap on the same set-up has it; without it u is the
    ground's own.
    """
    weights, means, variances = [], [], []
    for share, run in zip(tracker.run_weights, tracker.runs, strict=True):
        dose = max(tracker.dose - run.dose + extra_dose, 0.0)
        mean, variance = run.mixture.loss_ahead(dose, tracker.log_energy(energy_j), with_common)
        weights.append(run.mixture.weights * share)
        means.append(mean)
        variances.append(variance)
    together = np.concatenate(weights)
    heavy = together > _LIGHT * together.max()
    kept = together[heavy] / together[heavy].sum()
    return LossForecast(kept, np.concatenate(means)[heavy], np.concatenate(variances)[heavy])


def normal_below(z: Array) -> Array:
    """Probability that a standard normal value is below z, to 1e-7 (Abramowitz and Stegun, 26.2.17)."""
    size = np.abs(z)
    t = 1.0 / (1.0 + 0.2316419 * size)
    series = t * (0.319381530 + t * (-0.356563782 + t * (1.781477937 + t * (-1.821255978 + t * 1.330274429))))
    tail = np.exp(-0.5 * size**2) / math.sqrt(2.0 * math.pi) * series
    return np.asarray(np.where(z >= 0.0, 1.0 - tail, tail), dtype=np.float64)
