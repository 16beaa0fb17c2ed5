"""The exact posterior over surfaces in the fast world: its own densities, integrated by brute force."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.surface_world import LOSS_SIGMA, STIFFNESS_SIGMA, Spots, World
from flight.surface.known import UNKNOWN

Array = NDArray[np.float64]

DRAWS, UNKNOWN_DRAWS = 10_000, 60_000


@dataclass(frozen=True)
class HopData:
    """What the hops of one mission showed: u, ln stiffness, ln(E/E_0), dose before; (hops,) each; and sigma of b."""

    loss: Array
    log_stiffness: Array
    log_energy: Array
    dose: Array
    common_std: float


class ExactPosterior:
    """Probabilities of the surfaces given the first hops, by averaging the likelihood over draws of spots."""

    def __init__(self, world: World, seed: int) -> None:
        chance = np.random.default_rng(seed)
        self.names = world.names
        self._prior = world.prior
        self._hop_std = world.settings.learning.stiffness_hop_std
        self._spots: Mapping[str, Spots] = {
            name: world.spots(name, UNKNOWN_DRAWS if name == UNKNOWN else DRAWS, chance)
            for name in self.names
        }

    def after(self, data: HopData, hops: Sequence[int]) -> list[Array]:
        """Probabilities (names,) after each of the numbers of hops."""
        logs = np.array([self._log_evidence(self._spots[name], data, hops) for name in self.names])
        return [_shares(self._prior, logs[:, column]) for column in range(len(hops))]

    def _log_evidence(self, spots: Spots, data: HopData, hops: Sequence[int]) -> list[float]:
        """ln of the mean likelihood; b and the hops' scatter are integrated in closed form."""
        precision = 1.0 / (LOSS_SIGMA**2 + spots.scatter**2)
        variance_q = STIFFNESS_SIGMA**2 + self._hop_std**2
        total, square, logs = (np.zeros_like(spots.loss) for _ in range(3))
        found = []
        for index in range(max(hops)):
            middle = spots.middle_loss(np.asarray(data.dose[index]), np.asarray(data.log_energy[index]))
            error = data.loss[index] - middle
            total = total + error * precision
            square = square + error**2 * precision
            logs = logs + 0.5 * np.log(precision)
            logs = logs - 0.5 * (data.log_stiffness[index] - spots.log_stiffness) ** 2 / variance_q
            count = index + 1
            if count in hops:
                widened = 1.0 / data.common_std**2 + count * precision
                value = (
                    logs - 0.5 * (square - total**2 / widened) - 0.5 * np.log(data.common_std**2 * widened)
                )
                most = float(np.max(value))
                found.append(most + math.log(float(np.mean(np.exp(value - most)))))
        return found


def _shares(prior: Array, logs: Array) -> Array:
    values = np.log(prior) + logs
    weights = np.exp(values - np.max(values))
    return np.asarray(weights / weights.sum(), dtype=np.float64)
