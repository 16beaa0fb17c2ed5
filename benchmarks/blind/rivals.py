"""What a user would otherwise do with the same recordings: least squares on the nominal model, and sparse regression.

Least squares knows no name but "a parameter is out of tolerance". Sparse regression (PySINDy's STLSQ on a library of
terms) is given every help: each balance equation's residual force from the recorded channels, of the plant refitted
as the diagnosis does it, and a name counts as found when the term with the largest share could stand for it.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from benchmarks.blind.cases import BlindCase
from benchmarks.blind.explanations import OUT_OF_TOLERANCE
from benchmarks.blind.sight import mask
from ground.recordings.model import Recording
from sim_hal.plant.simulate import Plant

Float = NDArray[np.float64]

MISFIT = 1.05
"""A reduced residual (rms in sigmas) above this is called a mismatch by a user of least squares."""
OUT_SIGMAS = 3.0
EXPLAINED = 0.05
"""Share of the residual force's variance that a sparse formula must explain to be believed."""
SPARSITY = 0.1
"""Least standardised coefficient that STLSQ keeps, as a share of the residual's scatter."""
SMOOTHING = (15, 3)
"""Window and order of the Savitzky-Golay derivative of measured channels."""
TERMS: Mapping[str, frozenset[str]] = {
    "1": frozenset({"asymmetric_friction", "buoyancy", "sensor_bias", OUT_OF_TOLERANCE}),
    "v": frozenset({"viscous_friction", "aerodynamic_drag_linear", "soil_rate_dependence", OUT_OF_TOLERANCE}),
    "sign(v)": frozenset(
        {
            "coulomb_friction",
            "stribeck_friction",
            "presliding_hysteresis",
            "sleeve_friction",
            "warm_up_friction",
        }
        | {
            "position_dependent_friction",
            "hinge_friction",
            "brush_voltage_drop",
            "dead_time",
            "spring_hysteresis",
        }
    ),
    "v|v|": frozenset({"quadratic_friction", "aerodynamic_drag_quadratic"}),
    "v^3": frozenset({"quadratic_friction", "aerodynamic_drag_quadratic"}),
    "x": frozenset({"sensor_scale", "string_creep", "string_stiffening", "soil_hardening", OUT_OF_TOLERANCE}),
    "x^2": frozenset(
        {"progressive_spring", "string_stiffening", "soil_hardening", "end_stop", "leg_end_stop"}
    ),
    "x^3": frozenset(
        {"progressive_spring", "string_stiffening", "soil_hardening", "end_stop", "leg_end_stop"}
    ),
    "load": frozenset({"load_dependent_friction", "sensor_scale", OUT_OF_TOLERANCE}),
    "load sign(v)": frozenset({"load_dependent_friction", "spring_hysteresis"}),
    "load^3": frozenset({"torque_constant_saturation", "supply_sag"}),
    "t": frozenset({"sensor_drift", "winding_heating", "warm_up_friction", "string_creep"}),
    "a": frozenset(
        {"added_inertia", "soil_added_mass", "reel_inertia", "mass_distribution", OUT_OF_TOLERANCE}
    ),
}
"""What each term of the library may stand for, as generously as the taxonomy allows."""


@dataclass(frozen=True)
class RivalAnswer:
    """`names` is the set that counts as named; empty where a mismatch is claimed without a name."""

    mismatch: bool
    names: frozenset[str]


@dataclass(frozen=True)
class Signals:
    """One balance along a run: residual force, speed, position, load, acceleration, time; (samples,) each."""

    residual: Float
    v: Float
    x: Float
    load: Float
    a: Float
    t: Float


def least_squares(case: BlindCase, refit: Plant, chi: Mapping[str, float]) -> RivalAnswer:
    """The nominal model fitted; a parameter near the edge of its tolerance is blamed, else nothing is named."""
    stated = case.plant.flat()
    away = [
        abs(parameter.value - stated[name].value) / stated[name].std
        for name, parameter in refit.flat().items()
        if stated[name].std > 0.0
    ]
    blamed = max(away, default=0.0) > OUT_SIGMAS - 0.01
    mismatch = max(chi.values()) > MISFIT or blamed
    return RivalAnswer(mismatch, frozenset({OUT_OF_TOLERANCE} if blamed else ()))


def sparse_regression(case: BlindCase, refit: Plant) -> RivalAnswer:
    """PySINDy on each balance's residual force; the balance whose formula explains most is believed."""
    best, names = 0.0, frozenset[str]()
    for parts in zip(*(balances(refit, run, mask(case.plant, run)) for run in case.train), strict=True):
        share, term = formula(parts)
        if share > best:
            best, names = share, TERMS[term]
    return RivalAnswer(best > EXPLAINED, names if best > EXPLAINED else frozenset())


def formula(parts: Sequence[Signals]) -> tuple[float, str]:
    """Share of the residual force that a sparse formula explains over all runs, and its largest term."""
    library = np.vstack([terms(part) for part in parts])
    target = np.concatenate([part.residual for part in parts])
    scale = np.std(library, axis=0) + np.abs(np.mean(library, axis=0))
    scatter = float(np.std(target))
    if scatter == 0.0:
        return 0.0, "1"
    columns = library / np.where(scale > 0.0, scale, 1.0)
    import pysindy  # of the extra `bench`: what counts cases does without

    solver = pysindy.STLSQ(threshold=SPARSITY, alpha=1e-3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # STLSQ warns when it drops every term
        solver.fit(columns, target[:, None] / scatter)
    coefficients = np.asarray(solver.coef_).ravel()
    left = target / scatter - columns @ coefficients
    share = 1.0 - float(np.mean(left**2) / np.mean((target / scatter) ** 2))
    return share, list(TERMS)[int(np.argmax(np.abs(coefficients)))]


def terms(s: Signals) -> Float:
    """The library, (samples, terms), in the order of `TERMS`."""
    sign = np.sign(s.v)
    columns = [np.ones(s.v.size), s.v, sign, s.v * abs(s.v), s.v**3, s.x, s.x**2, s.x**3]
    columns += [s.load, s.load * sign, s.load**3, s.t, s.a]
    return np.column_stack(columns)


def slope(values: Float, step_s: float, order: int = 1) -> Float:
    """Smoothed derivative of a measured channel."""
    return np.asarray(savgol_filter(values, *SMOOTHING, deriv=order, delta=step_s))


def balances(plant: Plant, run: Recording, use: NDArray[np.bool_]) -> list[Signals]:
    """The balances of a kind with their residual forces, from what was measured."""
    p = {name: parameter.value for name, parameter in plant.flat().items()}
    step = float(np.median(np.diff(run.times_s)))
    found = _BALANCES[plant.kind](p, run.channels, step, run)
    return [Signals(*(column[use] for column in vars(signals).values())) for signals in found]


def _axis(p: Mapping[str, float], c: Mapping[str, Float], step: float, run: Recording) -> list[Signals]:
    v, a = slope(c["position_m"], step), c["acceleration_m_s2"]
    force = p["m"] * a - c["force_n"]
    return [Signals(force, v, c["position_m"], c["force_n"], a, run.times_s)]


def _drop(p: Mapping[str, float], c: Mapping[str, Float], step: float, run: Recording) -> list[Signals]:
    v, reading = slope(c["height_m"], step), c["body_acceleration_m_s2"]
    return [Signals(p["m"] * reading, v, c["height_m"], reading, reading, run.times_s)]


def _drive(p: Mapping[str, float], c: Mapping[str, Float], step: float, run: Recording) -> list[Signals]:
    ratio = p["p"] / (2.0 * np.pi * p["N"])
    theta, i = c["nut_position_m"] / ratio, c["motor_current_a"]
    omega, accel = slope(theta, step), slope(theta, step, 2)
    force = p["k"] * c["spring_compression_m"]
    load = ratio * force * np.where(omega >= 0.0, 1.0 / p["eta"], p["eta_b"])
    moving = np.abs(omega) > 1.0
    dry = np.where(moving, p["tau_c"] * np.sign(omega), 0.0)
    torque = np.where(moving, p["J"] * accel - p["K"] * i + p["b"] * omega + dry + load, 0.0)
    rate = slope(i, step)
    voltage = p["L"] * rate + p["R"] * i + p["K"] * omega - c["motor_voltage_v"]
    stiffness = 1.0 / (1.0 / p["k"] + 1.0 / p["k_m"])
    spring = force - np.maximum(0.0, stiffness * c["nut_position_m"])
    return [
        Signals(torque, np.where(moving, omega, 0.0), c["nut_position_m"], force, accel, run.times_s),
        Signals(voltage, i, c["nut_position_m"], i, rate, run.times_s),
        Signals(spring, ratio * omega, c["nut_position_m"], force, accel, run.times_s),
    ]


def _hop(p: Mapping[str, float], c: Mapping[str, Float], step: float, run: Recording) -> list[Signals]:
    delta = c["spring_compression_m"] + p["m_b"] * p["g"] / p["k"]
    rate, specific = slope(delta, step), c["body_acceleration_m_s2"]
    opened = run.times_s > (run.event_time_s("fire_command") or 0.0) + 0.012
    body = np.where(opened, p["m_b"] * specific - p["k"] * delta - p["c"] * rate, 0.0)
    speed = np.cumsum(np.where(opened, specific - p["g"], 0.0)) * step
    return [
        Signals(body, rate, delta, p["k"] * delta, specific, run.times_s),
        Signals(body, speed, delta, p["k"] * delta, specific, run.times_s),
    ]


_BALANCES = {"axis": _axis, "drop": _drop, "drive": _drive, "hop": _hop}
