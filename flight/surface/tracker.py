"""What is believed of the ground underfoot, hop by hop, and whether it has changed since.

Bayesian online change-point detection (Adams and MacKay, 2007) over mixtures of linear-Gaussian hypotheses: each run
assumes that the robot has stood on one spot since a given hop. With every hop a new run begins: on another place, of
the same surface or any other, on the same place loosened, or with another foot.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flight.surface.known import UNKNOWN, SurfaceSettings
from flight.surface.mixture import (
    COMMON,
    FALL,
    LOSS,
    STIFFNESS,
    Evidence,
    Mixture,
    joined,
    log_sum,
    normalised,
)
from flight.surface.priors import (
    AS_BEFORE,
    CHANGED_FOOT,
    KINDS,
    LOOSENED,
    NEW_PLACE,
    SurfaceModel,
    known_models,
    prior_mixture,
    unknown_models,
)
from flight.surface.settings import SurfaceLearning

Array = NDArray[np.float64]

_RUNS = 6
_LEAST_RUN = 1e-5


@dataclass(frozen=True)
class HopSeen:
    """One hop as the belief takes it in: loss u = -ln(1 - C3) with its own error, energy, and stiffness if seen."""

    energy_j: float
    loss: float
    loss_sigma: float
    log_stiffness: float | None = None
    log_stiffness_sigma: float = 0.0


@dataclass(frozen=True)
class Run:
    """The hypothesis that the robot has stood on one spot since hop `start`, where `dose` had been spent before."""

    start: int
    dose: float
    log_weight: float
    mixture: Mixture


@dataclass(frozen=True)
class GroundModels:
    """All that a spot may be: models by name, their prior probabilities, and the settings."""

    names: tuple[str, ...]
    models: tuple[SurfaceModel, ...]
    prior: Array
    settings: SurfaceLearning

    @staticmethod
    def of(
        surfaces: SurfaceSettings,
        settings: SurfaceLearning,
        foot: str,
        tilt_deg: float,
        learned: Sequence[SurfaceModel] = (),
    ) -> GroundModels:
        """Known surfaces, those learned, and none of them; the first two equally probable."""
        known = [*known_models(surfaces, settings.learning, foot, tilt_deg), *learned]
        names = (*dict.fromkeys(model.name for model in known), UNKNOWN)
        unknown = surfaces.unknown_probability
        prior = np.array([*[(1.0 - unknown) / (len(names) - 1)] * (len(names) - 1), unknown])
        models = (*known, *unknown_models(surfaces, settings.learning))
        return GroundModels(names, models, prior, settings)

    def fresh(self, probabilities: Array, common: tuple[float, float], kind: int) -> Mixture:
        """A spot that nothing has hopped on yet."""
        mixture, share = self._template
        logs = np.log(np.maximum(probabilities[mixture.surfaces] * share, 1e-300))
        means, covariances = mixture.means.copy(), mixture.covariances.copy()
        means[:, COMMON], covariances[:, COMMON, COMMON] = common[0], common[1] ** 2
        kinds = np.full(mixture.kinds.shape, kind, dtype=np.int64)
        return replace(mixture, log_weights=logs, means=means, covariances=covariances, kinds=kinds)

    @cached_property
    def _template(self) -> tuple[Mixture, Array]:
        """Every hypothesis of a fresh spot, and which share of its surface's probability is its own (n,)."""
        return prior_mixture(self.models, self.names, self.settings)


@dataclass(frozen=True)
class Tracker:
    """The belief: runs with their weights, doses spent in all, hops seen. A value: `after` gives the next one."""

    ground: GroundModels
    runs: tuple[Run, ...]
    dose: float = 0.0
    hops: int = 0

    @staticmethod
    def begin(ground: GroundModels, common_loss: tuple[float, float]) -> Tracker:
        """Before the first hop."""
        first = ground.fresh(ground.prior, common_loss, AS_BEFORE)
        return Tracker(ground, (Run(0, 0.0, 0.0, first),))

    def after(self, hop: HopSeen, hazard: float | None = None) -> Tracker:
        """The belief after one more hop; `hazard` is the probability beforehand that the spot is another."""
        if hazard is None:
            hazard = self.ground.settings.change.hazard
        runs = [self._weighed(run, hop, math.log1p(-hazard) if self.hops else 0.0) for run in self.runs]
        if self.hops:
            fresh = Run(self.hops, self.dose, math.log(hazard), self.changed_spot())
            runs.append(self._weighed(fresh, hop, 0.0))
        total = log_sum(np.array([run.log_weight for run in runs]))
        runs = [replace(run, log_weight=run.log_weight - total) for run in runs]
        runs = sorted(
            (run for run in runs if run.log_weight > math.log(_LEAST_RUN)), key=lambda r: -r.log_weight
        )
        return replace(
            self, runs=tuple(runs[:_RUNS]), dose=self.dose + self.dose_of(hop.energy_j), hops=self.hops + 1
        )

    def dose_of(self, energy_j: float) -> float:
        """How much a hop compacts, in hops of the reference energy."""
        learning = self.ground.settings.learning
        return float((energy_j / learning.reference_energy_j) ** learning.dose_exponent)

    def log_energy(self, energy_j: float) -> float:
        """ln(E/E_0)."""
        return math.log(energy_j / self.ground.settings.learning.reference_energy_j)

    def changed_spot(self) -> Mixture:
        """What is expected of the ground if it has changed since the last hop."""
        change = self.ground.settings.change
        place = self.on_new_place().runs[0].mixture
        here = self.runs[0].mixture.pruned()
        parts = [
            place.weighted(
                math.log(1.0 - change.loosened_share - change.foot_share) - log_sum(place.log_weights)
            )
        ]
        if change.loosened_share:
            loosened = _moved(here, LOOSENED, 1.0, change.loosening_std, change.loosening_std)
            parts.append(loosened.weighted(math.log(change.loosened_share)))
        factors = self._other_feet()
        parts += [
            _moved(here, CHANGED_FOOT, factor, change.other_foot_std, change.other_foot_std).weighted(
                math.log(change.foot_share / len(factors))
            )
            for factor in factors
            if change.foot_share
        ]
        return joined(parts)

    def on_new_place(self, ground: GroundModels | None = None) -> Tracker:
        """The belief when the robot is known to have come to a fresh place, of which more may be known by now.

        What was none of the known and has been learned since counts as the surface learned.
        """
        ground = ground or self.ground
        chances = dict(zip(self.ground.names, self.probabilities_array(), strict=True))
        learned = [name for name in ground.names if name not in chances]
        if learned:
            chances[learned[-1]] = chances.pop(UNKNOWN)
        here = np.array([chances.get(name, 0.0) for name in ground.names])
        same = ground.settings.change.same_surface
        shares = same * here / max(float(here.sum()), 1e-300) + (1.0 - same) * ground.prior
        common = self.runs[0].mixture.moments(COMMON)
        run = Run(self.hops, self.dose, 0.0, ground.fresh(shares, common, NEW_PLACE))
        return replace(self, ground=ground, runs=(run,))

    def without_the_unlikely(self, least: float) -> Tracker:
        """The belief without runs and hypotheses whose probability is below `least`, for quick looks ahead."""
        kept = [
            replace(run, mixture=run.mixture.chosen(run.mixture.weights * share > least))
            for share, run in zip(self.run_weights, self.runs, strict=True)
            if float(np.max(run.mixture.weights)) * share > least
        ]
        return replace(self, runs=tuple(kept))

    def with_common(self, std: float) -> Tracker:
        """The belief once C2_ref is taken from elsewhere, with a common error of u that is new."""
        return replace(
            self, runs=tuple(replace(run, mixture=run.mixture.with_common(std)) for run in self.runs)
        )

    def probabilities_array(self) -> Array:
        """Probability of each of the ground's names."""
        count = len(self.ground.names)
        weights = self.run_weights
        return np.asarray(
            sum(
                w * run.mixture.by(run.mixture.surfaces, count)
                for w, run in zip(weights, self.runs, strict=True)
            )
        )

    @property
    def run_weights(self) -> Array:
        """Probability of each run."""
        return normalised(np.array([run.log_weight for run in self.runs]))

    def changed_within(self, hops: int) -> float:
        """Probability that the ground has changed within the last so many hops."""
        recent = [run.start > 0 and run.start > self.hops - 1 - hops for run in self.runs]
        return float(self.run_weights @ np.array(recent, dtype=np.float64))

    def kind_of_change(self) -> str:
        """The most probable way in which the present run began."""
        run = max(self.runs, key=lambda each: each.log_weight)
        return KINDS[int(np.argmax(run.mixture.by(run.mixture.kinds, len(KINDS))))]

    def _weighed(self, run: Run, hop: HopSeen, log_factor: float) -> Run:
        dose = self.dose - run.dose
        evidence = Evidence(
            hop.loss,
            hop.loss_sigma,
            self.log_energy(hop.energy_j),
            dose,
            hop.log_stiffness,
            hop.log_stiffness_sigma,
        )
        mixture, log_density = run.mixture.after(evidence)
        return replace(run, mixture=mixture.pruned(), log_weight=run.log_weight + log_factor + log_density)

    def _other_feet(self) -> list[float]:
        factors = self.ground.settings.learning.foot_factors
        ratios = {round(a / b, 6) for a in factors.values() for b in factors.values()} - {1.0}
        middle = sorted(ratio for ratio in ratios if 0.3 < ratio < 3.0)
        return [middle[len(middle) // 6], middle[len(middle) // 2], middle[-1 - len(middle) // 6]]


def _moved(mixture: Mixture, kind: int, factor: float, loss_std: float, stiffness_std: float) -> Mixture:
    """The same hypotheses with loss and fall scaled, and less sure: `loss_std` as a share of u."""
    scale = np.ones(mixture.means.shape[1])
    scale[[LOSS, FALL]] = factor
    means = mixture.means * scale
    covariances = mixture.covariances * scale[:, None] * scale[None, :]
    covariances[:, LOSS, LOSS] += (loss_std * means[:, LOSS]) ** 2
    covariances[:, STIFFNESS, STIFFNESS] += stiffness_std**2
    kinds = np.full(mixture.kinds.shape, kind, dtype=np.int64)
    weights = mixture.log_weights - log_sum(mixture.log_weights)
    return replace(mixture, log_weights=weights, means=means, covariances=covariances, kinds=kinds)
