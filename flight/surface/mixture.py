"""A mixture of linear-Gaussian hypotheses about the ground underfoot, updated exactly.

Each hypothesis is a surface, a law of compaction and a way in which the robot came to stand here; given it, the state
x = (a, d, e, q, b) is Gaussian: a the loss u = -ln(1 - C3) of the fresh spot at the reference energy, d its fall by
the fourth hop, e its slope over ln E, q the logarithm of the ground's stiffness, and b the error that all hops share
through C2_ref, which adds to u. A hop shows u = a - d h(n) + e ln(E/E_0) + b + noise, and q + noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flight.surface.compaction import LAWS, shares

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

SIZE = 5
LOSS, FALL, SLOPE, STIFFNESS, COMMON = range(SIZE)
_NEGLIGIBLE = 1e-9


@dataclass(frozen=True)
class Evidence:
    """What one hop showed: loss u with the error of this hop alone, and ln stiffness, where it was seen.

    `log_energy` is ln(E_used/E_0); `dose` the hops that the spot bore before, in hops of energy E_0.
    """

    loss: float
    loss_sigma: float
    log_energy: float
    dose: float
    log_stiffness: float | None = None
    log_stiffness_sigma: float = 0.0

    def __post_init__(self) -> None:
        values = (self.loss, self.log_energy, self.dose, self.log_stiffness or 0.0)
        if not all(map(math.isfinite, values)) or not (self.loss_sigma > 0.0 and self.dose >= 0.0):
            raise ValueError(f"{self} is no measurement")


@dataclass(frozen=True)
class Mixture:
    """Hypotheses (n,): log weights, means (n, 5), covariances (n, 5, 5), labels, scatter of u and q by hop."""

    log_weights: Array
    means: Array
    covariances: Array
    surfaces: Ints
    laws: Ints
    kinds: Ints
    loss_scatter: Array
    stiffness_scatter: Array

    @property
    def weights(self) -> Array:
        """Probabilities (n,), adding up to 1."""
        return normalised(self.log_weights)

    def with_common(self, std: float) -> Mixture:
        """With a new C2_ref, whose error nothing is known of yet."""
        means, covariances = self.means.copy(), self.covariances.copy()
        means[:, COMMON] = 0.0
        covariances[:, COMMON, :] = covariances[:, :, COMMON] = 0.0
        covariances[:, COMMON, COMMON] = std**2
        return replace(self, means=means, covariances=covariances)

    def after(self, evidence: Evidence) -> tuple[Mixture, float]:
        """The mixture that has seen the evidence, and the log density of it beforehand."""
        before = log_sum(self.log_weights)
        found = self._seen(
            self._rows(evidence.dose, evidence.log_energy),
            evidence.loss,
            evidence.loss_sigma**2 + self.loss_scatter**2,
        )
        if evidence.log_stiffness is not None:
            rows = np.zeros_like(self.means)
            rows[:, STIFFNESS] = 1.0
            variance = evidence.log_stiffness_sigma**2 + self.stiffness_scatter**2
            found = found._seen(rows, evidence.log_stiffness, variance)
        return found, log_sum(found.log_weights) - before

    def loss_ahead(self, dose: float, log_energy: float, with_common: bool = True) -> tuple[Array, Array]:
        """Mean and variance of a hop's u by hypothesis (n,), scatter of the hop included."""
        rows = self._rows(dose, log_energy)
        rows[:, COMMON] = float(with_common)
        mean = np.einsum("hi,hi->h", rows, self.means)
        variance = np.einsum("hi,hij,hj->h", rows, self.covariances, rows)
        return mean, np.asarray(variance + self.loss_scatter**2, dtype=np.float64)

    def by(self, labels: Ints, count: int) -> Array:
        """Probability of each label (count,)."""
        return np.asarray(np.bincount(labels, weights=self.weights, minlength=count), dtype=np.float64)

    def moments(self, index: int) -> tuple[float, float]:
        """Mean and standard deviation of one part of the state."""
        weights = self.weights
        mean = float(weights @ self.means[:, index])
        variance = weights @ (self.covariances[:, index, index] + (self.means[:, index] - mean) ** 2)
        return mean, math.sqrt(float(variance))

    def chosen(self, which: NDArray[np.bool_] | Ints) -> Mixture:
        """Some of the hypotheses."""
        return Mixture(*(getattr(self, name)[which] for name in _FIELDS))

    def pruned(self) -> Mixture:
        """Without the hypotheses that have become negligible."""
        keep = self.log_weights > np.max(self.log_weights) + math.log(_NEGLIGIBLE)
        return self if bool(keep.all()) else self.chosen(keep)

    def weighted(self, log_factor: float | Array) -> Mixture:
        """With the log weights moved by a factor's logarithm."""
        return replace(self, log_weights=self.log_weights + log_factor)

    def _rows(self, dose: float, log_energy: float) -> Array:
        rows = np.zeros_like(self.means)
        rows[:, LOSS] = rows[:, COMMON] = 1.0
        rows[:, FALL] = -shares(dose)[self.laws]
        rows[:, SLOPE] = log_energy
        return rows

    def _seen(self, rows: Array, value: float, variance: Array) -> Mixture:
        """Kalman's step for one scalar in every hypothesis, with the weight by its predictive density."""
        gains = np.einsum("hij,hj->hi", self.covariances, rows)
        total = np.einsum("hi,hi->h", rows, gains) + variance
        error = value - np.einsum("hi,hi->h", rows, self.means)
        return replace(
            self,
            log_weights=self.log_weights - 0.5 * (error**2 / total + np.log(2.0 * math.pi * total)),
            means=self.means + gains * (error / total)[:, None],
            covariances=self.covariances - gains[:, :, None] * gains[:, None, :] / total[:, None, None],
        )


_FIELDS = (
    "log_weights",
    "means",
    "covariances",
    "surfaces",
    "laws",
    "kinds",
    "loss_scatter",
    "stiffness_scatter",
)


def joined(mixtures: Sequence[Mixture]) -> Mixture:
    """All hypotheses of several mixtures."""
    return Mixture(*(np.concatenate([getattr(each, name) for each in mixtures]) for name in _FIELDS))


def arrays_of(mixture: Mixture) -> dict[str, Array | Ints]:
    """The arrays of a mixture by name."""
    return {name: getattr(mixture, name) for name in _FIELDS}


def log_sum(logs: Array) -> float:
    """ln of the sum of exponentials."""
    most = float(np.max(logs))
    return most + math.log(float(np.sum(np.exp(logs - most))))


def normalised(logs: Array) -> Array:
    """Probabilities in proportion to the exponentials."""
    weights = np.exp(logs - np.max(logs))
    return np.asarray(weights / weights.sum(), dtype=np.float64)


LAW_COUNT = len(LAWS)
