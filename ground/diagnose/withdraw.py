"""Withdraw: whether an effect that the plant already has still earns its place on these recordings."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ground.diagnose.crossval import cross_validate
from ground.diagnose.fit import Fit
from ground.diagnose.scoring import effective_share, probability_better
from ground.diagnose.workers import FitTask, Workers, fit_job
from sim_hal.plant.simulate import EffectUse, Plant

PROPOSE = 0.95


@dataclass(frozen=True)
class Withdrawal:
    """An effect without which these recordings are predicted better, with the probability that this is so."""

    physics_id: str
    place: str
    probability: float

    @property
    def words(self) -> str:
        """For a person."""
        name = f"{self.physics_id.replace('_', ' ')} ({self.place.replace('_', ' ')})"
        return (
            f"{name} stands in the plant file, but these recordings are predicted better without it "
            f"(probability {self.probability:.2f}): think of withdrawing it."
        )


def withdrawals(refit: Fit, given: Plant, workers: Workers) -> tuple[Withdrawal, ...]:
    """The effects of the plant file that make predictions of left-out recordings worse; refits without each."""
    segments, sigmas = workers.context.segments, workers.context.sigmas
    tasks = [FitTask(without(refit.plant, use), refit, {}, "polish") for use in given.effects]
    share = effective_share(refit.residuals.reshape(-1, segments[0].observed.shape[1]))
    present = cross_validate(refit, segments, sigmas).scores(share)
    found = []
    for use, fit in zip(given.effects, workers.map(fit_job, tasks), strict=True):
        probability = probability_better(cross_validate(fit, segments, sigmas).scores(share), present)
        if probability >= PROPOSE:
            found.append(Withdrawal(use.physics_id, use.channel or use.equation, probability))
    return tuple(found)


def without(plant: Plant, use: EffectUse) -> Plant:
    """The plant with one effect taken out."""
    gone = plant.prefix(use)
    return replace(plant, effects=tuple(other for other in plant.effects if plant.prefix(other) != gone))
