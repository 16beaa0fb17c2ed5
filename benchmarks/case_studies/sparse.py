"""The rival that knows a library of terms: PySINDy's STLSQ on the force that the refitted plant lacks."""

from __future__ import annotations

import math
import warnings

import numpy as np
from numpy.typing import NDArray

from ground.diagnose.evidence import LocatedForce
from sim_hal.plant.simulate import EffectUse, Parameter, Plant, PlantError

Float = NDArray[np.float64]

THRESHOLD = 0.05
"""Least standardised coefficient that STLSQ keeps."""
UNITS = {
    "1": "force", "v": "force/velocity", "v * abs(v)": "force/velocity**2", "v ** 3": "force/velocity**3",
    "x": "force/position", "x ** 2": "force/position**2", "x ** 3": "force/position**3",
}  # fmt: skip
SIGN = "sign(v)"


def sparse_terms(force: LocatedForce) -> dict[str, float]:
    """Terms with coefficients for the located force; empty when it follows neither speed nor position."""
    import pysindy  # of the extra `bench`

    columns = library(force)
    if not columns:
        return {}
    table = np.column_stack(list(columns.values()))
    size, scatter = (
        np.maximum(table.std(axis=0), np.abs(table.mean(axis=0)) * 1e-9 + 1e-300),
        force.before.std(),
    )
    size = np.where(size < 1e-200, 1.0, size)
    solver = pysindy.STLSQ(threshold=THRESHOLD, alpha=1e-6)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # STLSQ warns when it drops every term
        solver.fit(table / size, force.before[:, None] / scatter)
    found = np.asarray(solver.coef_).ravel() * scatter / size
    return {name: float(c) for name, c in zip(columns, found, strict=True) if c != 0.0}


def library(force: LocatedForce) -> dict[str, Float]:
    """The terms that this place has the quantities for."""
    v, x = force.causes.get("velocity"), force.causes.get("position")
    found: dict[str, Float] = {}
    if v is None and x is None:
        return found
    found["1"] = np.ones(force.before.size)
    if v is not None:
        found |= {"v": v, SIGN: np.sign(v), "v * abs(v)": v * np.abs(v), "v ** 3": v**3}
    if x is not None:
        found |= {"x": x, "x ** 2": x**2, "x ** 3": x**3}
    return found


def with_terms(plant: Plant, force: LocatedForce, terms: dict[str, float]) -> Plant | None:
    """The plant with the sparse law; dry friction as such, so that it can be simulated. None where it cannot be."""
    laws = {name: c for name, c in terms.items() if name != SIGN}
    try:
        if terms.get(SIGN, 0.0) < 0.0:
            level = Parameter(-terms[SIGN], 0.0, force.unit)
            plant = plant.with_effect(EffectUse("coulomb_friction", force.equation, None, {"F_c": level}))
        if laws:
            names = {name: f"a_{i}" for i, name in enumerate(laws, start=1)}
            text = " + ".join(names[name] if name == "1" else f"{names[name]} * {name}" for name in laws)
            use = EffectUse("unlisted", force.equation, None, parameters_of(plant, force, laws), text)
            plant = plant.with_effect(use)
        return plant
    except PlantError:
        return None


def parameters_of(plant: Plant, force: LocatedForce, laws: dict[str, float]) -> dict[str, Parameter]:
    """Coefficients with the units of their place."""
    from sim_hal.plant.compose import place_units
    from sim_hal.plant.plant import check_use

    raw = {f"a_{i}": Parameter(c, math.inf, UNITS[name]) for i, (name, c) in enumerate(laws.items(), start=1)}
    text = " + ".join(f"{a} * ({'1' if n == '1' else n})" for a, n in zip(raw, laws, strict=True))
    draft = EffectUse("unlisted", force.equation, None, raw, text)
    units = place_units(plant, draft, check_use(plant, draft))
    return {name: Parameter(p.value, 0.0, units[name]) for name, p in raw.items()}
