"""A fast world of grounds to try the surface belief in: draws of spots, and what hops on them would show.

Places are drawn from the published means and ranges (truncated at 2.5 standard deviations), the compaction law with
continuous constants, the estimator's errors as it states them. The belief under test knows none of the draws, and its
own model is coarser: a grid of laws, everything Gaussian, unknown ground in cells.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flight.surface.compaction import EXPONENTIAL, LOGARITHMIC, STRETCHED
from flight.surface.known import UNKNOWN, SurfaceSettings, same_setting
from flight.surface.priors import SurfaceModel, surface_model
from flight.surface.settings import LearningSettings, SurfaceLearning

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

FOOT, TILT_DEG = "1", 0.0
DIRECT_STD, AVERAGE_STD = 0.006, 0.051
"""Common error of u by C2_ref: measured just before, or the average of the foot."""
LOSS_SIGMA, STIFFNESS_SIGMA = 0.005, 0.04
"""Errors of one hop's u and ln stiffness, as the simulated robot's flight code states them."""
TRUNCATED = 2.5
LAW_KINDS = (EXPONENTIAL, STRETCHED, LOGARITHMIC)


@dataclass(frozen=True)
class Spots:
    """Many spots: fresh loss, share of it gone at the fourth hop, slope over ln E, ln stiffness, law, scatter."""

    loss: Array
    fall: Array
    slope: Array
    log_stiffness: Array
    law: Ints
    rate: Array
    shape: Array
    scatter: Array

    def share(self, dose: Array) -> Array:
        """The part of the fall that has happened after a dose, 1 at three; doses broadcast against the spots."""
        return self._raw(dose) / self._raw(np.full_like(self.loss, 3.0))

    def _raw(self, dose: Array) -> Array:
        stretched = 1.0 - np.exp(-((dose / self.rate) ** self.shape))
        logarithmic = 1.0 - 1.0 / (1.0 + self.shape * np.log1p(dose / self.rate))
        return np.where(self.law == 2, logarithmic, stretched)

    def middle_loss(self, dose: Array, log_energy: Array) -> Array:
        """u without the scatter of the hop."""
        return self.loss * (1.0 - self.fall * self.share(dose)) + self.slope * log_energy

    def one(self, index: int) -> Spots:
        """A single spot, as arrays of one."""
        return Spots(*(getattr(self, name)[index : index + 1] for name in self.__dataclass_fields__))


@dataclass(frozen=True)
class World:
    """The published surfaces as distributions of places, and unknown ground about them."""

    surfaces: SurfaceSettings
    settings: SurfaceLearning

    @property
    def names(self) -> tuple[str, ...]:
        """Known surfaces, then none of them."""
        known = [s.name for s in self.surfaces.surfaces if same_setting(s, FOOT, TILT_DEG)]
        return (*known, UNKNOWN)

    @property
    def prior(self) -> Array:
        """How often each occurs."""
        count, unknown = len(self.names) - 1, self.surfaces.unknown_probability
        return np.array([*[(1.0 - unknown) / count] * count, unknown])

    def spots(self, name: str, count: int, chance: np.random.Generator) -> Spots:
        """Fresh places of one surface, or of unknown ground, each of a surface of its own."""
        learning = self.settings.learning
        if name == UNKNOWN:
            return self._unknown(count, learning, chance)
        row = next(s for s in self.surfaces.surfaces if s.name == name and same_setting(s, FOOT, TILT_DEG))
        return self._known(surface_model(row, learning), row.place_c3_mean, row.place_c3_std, count, chance)

    def _known(
        self, model: SurfaceModel, c3: float, c3_std: float, count: int, chance: np.random.Generator
    ) -> Spots:
        learning = self.settings.learning
        looser = _truncated(count, chance)
        own = chance.standard_normal(count)
        tied = model.loss_stiffness
        stiffer = tied * looser + math.sqrt(1.0 - tied**2) * own
        loss = -np.log1p(-np.minimum(c3 + c3_std * looser, 0.98))
        fall = np.clip(np.abs(model.fall + learning.fall_std * chance.standard_normal(count)), 0.0, 1.0)
        scatter = np.full(count, max(learning.hop_share * model.loss_std, learning.least_hop_std))
        assert model.log_stiffness is not None
        log_stiffness = model.log_stiffness + model.log_stiffness_std * stiffer
        return self._with_law(loss, fall, log_stiffness, scatter, chance)

    def _unknown(self, count: int, learning: LearningSettings, chance: np.random.Generator) -> Spots:
        surfaces = self.surfaces
        loss = -np.log1p(-chance.uniform(surfaces.unknown_c3_low, surfaces.unknown_c3_high, count))
        low, high = surfaces.unknown_stiffness_low_n_m, surfaces.unknown_stiffness_high_n_m
        log_stiffness = chance.uniform(math.log(low), math.log(high), count)
        compacts = chance.random(count) < 0.5
        spread = np.where(compacts, learning.unknown_fall_std, learning.fall_std)
        fall = np.where(compacts, learning.unknown_fall, 0.0) + spread * chance.standard_normal(count)
        scatter = np.full(count, learning.unknown_hop_std)
        return self._with_law(loss, np.clip(np.abs(fall), 0.0, 1.0), log_stiffness, scatter, chance)

    def _with_law(
        self, loss: Array, fall: Array, log_stiffness: Array, scatter: Array, chance: np.random.Generator
    ) -> Spots:
        count, learning = loss.size, self.settings.learning
        law = chance.integers(0, len(LAW_KINDS), count)
        rate = np.exp(chance.uniform(np.log([0.8, 0.8, 0.1])[law], np.log([7.0, 9.0, 2.0])[law]))
        shape = np.where(
            law == 0, 1.0, chance.uniform(np.array([0.0, 0.4, 0.6])[law], np.array([1.0, 0.8, 3.0])[law])
        )
        slope = learning.energy_slope_share * loss + learning.energy_slope_std * chance.standard_normal(count)
        return Spots(loss, fall, slope, log_stiffness, law, rate, shape, scatter)


def _truncated(count: int, chance: np.random.Generator) -> Array:
    """Standard normal values within the truncation, by drawing again what is outside."""
    values = chance.standard_normal(count)
    while (outside := np.abs(values) > TRUNCATED).any():
        values[outside] = chance.standard_normal(int(outside.sum()))
    return values
