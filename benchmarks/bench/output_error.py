"""A plain output-error fit of the full model by SciPy: every effect that could be there at once.

Then a look at which strengths differ from nothing. What a careful user would do without a search over names.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from benchmarks.blind.cases import BlindCase
from benchmarks.blind.explanations import OUT_OF_TOLERANCE, Shaped, explanations, shaped, typical_scales
from benchmarks.blind.rivals import RivalAnswer
from benchmarks.blind.sight import channel_sigmas, mask, simulate
from sim_hal.plant.simulate import Plant, SimulationError

SEEN_SIGMAS = 3.0
EVALUATIONS = 40
"""Jacobians at most: beyond, the fit has not converged in what a user would wait."""
_BAD = 1e3


@dataclass(frozen=True)
class FullModel:
    """Nominal parameters by name and the effects in it; a point is (sigmas away …, sizes …)."""

    plant: Plant
    names: tuple[str, ...]
    forms: tuple[Shaped, ...]

    def at(self, point: Any) -> Plant:
        """The plant of a point."""
        stated = self.plant.flat()
        away = dict(zip(self.names, point, strict=False))
        plant = self.plant.with_values({n: stated[n].value + a * stated[n].std for n, a in away.items()})
        for form, size in zip(self.forms, point[len(self.names) :], strict=True):
            plant = form.hidden_in(plant, self.plant, float(size))
        return plant


def output_error(case: BlindCase) -> RivalAnswer:
    """Fit all at once; name the effect whose strength is most of its own sigmas away from nothing."""
    model = full_model(case)
    sigmas = list(channel_sigmas(case.plant).values())
    outputs = case.plant.structure.outputs
    uses = [mask(case.plant, run) for run in case.train]
    read = [np.column_stack([run.channels[name] for name in outputs]) for run in case.train]
    count = len(model.names) + len(model.forms)

    def residuals(point: Any) -> Any:
        try:
            made = simulate(model.at(point), case.train)
        except SimulationError:
            return np.full(size, _BAD)
        parts = [((m - r) / sigmas)[use].ravel() for m, r, use in zip(made, read, uses, strict=True)]
        return np.concatenate((*parts, point[: len(model.names)]))  # tolerances are measurements, too

    size = sum(int(use.sum()) * len(sigmas) for use in uses) + len(model.names)
    low = np.concatenate((np.full(len(model.names), -4.0), np.zeros(len(model.forms))))
    high = np.concatenate((np.full(len(model.names), 4.0), [form.largest for form in model.forms]))
    start = np.clip(np.where(np.arange(count) < len(model.names), 0.0, 1e-3), low, high)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fit = least_squares(residuals, start, bounds=(low, high), x_scale="jac", max_nfev=EVALUATIONS)
        slopes: Any = fit.jac
        spread = np.sqrt(np.diag(np.linalg.pinv(slopes.T @ slopes)))
    strengths = fit.x[len(model.names) :] / np.maximum(spread[len(model.names) :], 1e-12)
    if not strengths.size or strengths.max() < SEEN_SIGMAS:
        off = np.abs(fit.x[: len(model.names)]).max(initial=0.0) > SEEN_SIGMAS
        return RivalAnswer(bool(off), frozenset({OUT_OF_TOLERANCE} if off else ()))
    return RivalAnswer(True, frozenset({model.forms[int(np.argmax(strengths))].explanation.physics_id}))


def full_model(case: BlindCase) -> FullModel:
    """All uncertain parameters and all effects with a strength; what only shapes one is at its typical size."""
    plant = case.plant
    scales, random = typical_scales(plant, case.train), np.random.default_rng(0)
    forms: dict[str, Shaped] = {}
    for option in explanations(plant, case.train):
        if option.physics_id == OUT_OF_TOLERANCE or option.physics_id in forms:
            continue
        form = shaped(option, plant, scales, random)
        if form is not None and form.scaled:
            forms[option.physics_id] = form
    names = tuple(name for name, parameter in plant.flat().items() if parameter.std > 0.0)
    return FullModel(plant, names, tuple(forms.values()))
