"""What drives a rig, between its samples: a reading of the input that predicts better than the one assumed.

An input that a plant file draws in straight lines may have been held by a computer (half a sample late, which looks
like a sensor's delay), or have been smooth (straight lines damp its fast parts, which looks like too heavy a mass).
No physics is missing then, only what the recorder did not write down.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ground.diagnose.accept import worthwhile
from ground.diagnose.candidates import Candidate, ranges_of
from ground.diagnose.fit import Fit
from ground.diagnose.problem import FitProblem
from ground.diagnose.scoring import model_weights, probability_better
from ground.diagnose.screen import Absorbed
from ground.diagnose.trials import Trials
from ground.diagnose.workers import Context, FitTask
from sim_hal.plant.between import INTERPOLATIONS
from sim_hal.plant.simulate import Plant

STATED = 1.0
"""What the plant file says outright is believed as firmly as that a free parameter is not there."""


def interpolation_of(plant: Plant) -> str | None:
    """How all inputs run between samples; None without inputs, or where they differ."""
    found = {spec.interpolation for spec in plant.structure.inputs.values()}
    return found.pop() if len(found) == 1 else None


def is_stated(plant: Plant) -> bool:
    """Whether the plant file itself says how an input runs between its samples."""
    inputs = plant.document.get("inputs", {})
    entries = inputs.values() if isinstance(inputs, Mapping) else ()
    return any(isinstance(entry, Mapping) and "interpolation" in entry for entry in entries)


def between_samples(given: Plant, extended: Plant) -> tuple[str, ...]:
    """What a reader must know, where the inputs turned out to run otherwise than the plant file has them."""
    assumed, found = interpolation_of(given), interpolation_of(extended)
    if assumed is None or found is None or found == assumed:
        return ()
    says = "says" if is_stated(given) else "leaves it at"
    return (
        f"Between their samples the inputs run as by `interpolation: {found}` (the plant file {says} `{assumed}`): "
        "that predicts what was held out better. It is the recorder's doing or the controller's, not the rig's.",
    )


def promise_job(context: Context, task: tuple[Fit, Plant]) -> float:
    """The cost that is left when a fitted plant's inputs run as another one's and its unknowns follow."""
    fit, plant = task
    problem = FitProblem(plant, context.segments, context.sigmas, ranges_of(plant, context.scales))
    moved = problem.residuals(problem.start(fit.values, fit.initial)) - fit.residuals
    return Absorbed(fit).left_of(moved)


def otherwise_driven(
    trials: Trials, current: Fit, best: tuple[Candidate, Fit, float] | None, sure: float
) -> Fit | None:
    """The plant as it stands with its inputs read otherwise, where that predicts better.

    It must be `sure` to do so, and be likelier than the `best` effect (with its fit and how unusual it is), if any.
    """
    present = interpolation_of(current.plant)
    if current.plant.kind != "equations" or present is None:
        return None
    plants = [current.plant.with_interpolation(each) for each in INTERPOLATIONS if each != present]
    trials.outlook.begin("between", "reading the inputs otherwise between their samples")
    promised = trials.workers.map(promise_job, [(current, plant) for plant in plants])
    plants = [plant for plant, left in zip(plants, promised, strict=True) if left < current.cost]
    if not plants:
        return None
    fits = trials.fitted([FitTask(plant, current, current.values, "polish") for plant in plants])
    share = trials.share(min(fits, key=lambda fit: fit.chi2))
    before, scores = trials.held_out(current), []
    able = []
    for fit in fits:
        held = trials.held_out(fit)
        ours, theirs = held.scores(share), before.scores(share)
        nats = float(np.sum(ours - theirs))
        if probability_better(ours, theirs) >= sure and worthwhile(before, held, nats):
            able.append(fit)
            scores.append(ours)
    if not able:
        return None
    odds = [STATED * is_stated(trials.given)] * len(able)
    if best is not None:
        scores.append(trials.held_out(best[1]).scores(share))
        odds.append(best[2])
    winner = int(np.argmax(model_weights(np.vstack(scores), odds)))
    return able[winner] if winner < len(able) else None
