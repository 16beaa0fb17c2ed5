"""Typical sizes of force, speed, travel and time in each balance equation, from the motion itself.

They are what the plausible ranges of effects are written in, so that a rig of any size can be searched.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ground.diagnose.fit import Fit
from ground.diagnose.segments import Segment
from sim_hal.plant.expressions import Name, Node, Op, summands
from sim_hal.plant.simulate import Balance, Plant, compile_plant, probes

Float = NDArray[np.float64]

TYPICAL = 95.0
"""Percentile that counts as the typical size: high, yet deaf to single spikes."""


SHORT = 0.05
"""A period in position, as a share of the travel, while nothing better is known."""
RIPPLE = 0.02
"""The parts of a ripple, as a share of the typical force, while nothing better is known."""


def find_scales(fit: Fit, segments: Sequence[Segment]) -> dict[str, dict[str, float]]:
    """Scales by balance (F, A_sin, A_cos, V, X, X_low, X_mid, X_high, P, T, M) and channel (Y, Y_max, T, D, S)."""
    plant = fit.plant
    sample_s = float(np.median(np.concatenate([np.diff(s.run.times_s) for s in segments])))
    duration = float(np.median([s.run.times_s[-1] - s.run.times_s[0] for s in segments]))
    longest = max(float(s.run.times_s[-1] - s.run.began_s) for s in segments)
    formulas: dict[str, Node] = {}
    for name, balance in plant.structure.balances.items():
        formulas |= probes(plant, name)
        formulas |= force_formulas(plant, balance)
    series = simulate_all(fit, segments, formulas)
    scales: dict[str, dict[str, float]] = {}
    for name, balance in plant.structure.balances.items():
        scales[name] = balance_scales(balance, series, duration)
    for column, channel in enumerate(plant.structure.outputs):
        measured = np.concatenate([s.observed[:, column] for s in segments])
        if np.isfinite(measured).any():
            largest = float(np.nanmax(np.abs(measured)))
            times = {"T": duration, "D": longest, "S": sample_s}
            scales[channel] = {"Y": typical(measured), "Y_max": largest} | times
    return {name: own for name, own in scales.items() if own}


def force_formulas(plant: Plant, balance: Balance) -> dict[str, Node]:
    """What the typical force is read from: the net force (the port's own value, or the state's rate and its response
    to a force), and each force that adds to it. Where a rig moves slowly the forces are large and the net is not."""
    structure = plant.structure
    net: dict[str, Node]
    if balance.port is not None:
        net, whole = {f"{balance.name}.force": Name(balance.port)}, structure.definitions[balance.port].value
    else:
        state, response = next(iter(balance.per_force.items()))
        net = {f"{balance.name}.rate": Op("rate", (Name(state),)), f"{balance.name}.response": response}
        whole = structure.rates[state]
    return net | {f"{balance.name}.part_{i}": part for i, part in enumerate(summands(whole))}


def simulate_all(fit: Fit, segments: Sequence[Segment], formulas: dict[str, Node]) -> dict[str, Float]:
    """Values of extra formulas along all segments, as the fitted plant moves."""
    compiled = compile_plant(fit.plant.with_values(fit.values), extra=formulas)
    first = len(fit.plant.structure.outputs)
    runs = [
        compiled.run(compiled.values, segment.run, initial)[:, first:]
        for segment, initial in zip(segments, fit.initial, strict=True)
    ]
    stacked = np.vstack(runs)
    return {name: stacked[:, i] for i, name in enumerate(compiled.output_names[first:])}


def balance_scales(balance: Balance, series: dict[str, Float], duration_s: float) -> dict[str, float]:
    """Scales of one balance; those that the motion does not show are left out."""
    found = {"T": duration_s}
    parts = [values for name, values in series.items() if name.startswith(f"{balance.name}.part_")]
    force = series.get(f"{balance.name}.force")
    if force is None:
        response = series[f"{balance.name}.response"]
        acts = response != 0.0
        if not acts.any():
            return {}
        parts = [part[acts] / response[acts] for part in parts]
        force = series[f"{balance.name}.rate"][acts] / response[acts]
        found["M"] = float(np.median(np.abs(1.0 / response[acts])))
    if (largest := max(typical(values) for values in (force, *parts))) > 0.0:
        found["F"] = largest
        found["A_sin"] = found["A_cos"] = RIPPLE * largest
    speed = series.get(f"{balance.name}.velocity")
    if speed is not None and typical(speed) > 0.0:
        found["V"] = typical(speed)
    position = series.get(f"{balance.name}.position")
    if position is not None and np.ptp(position) > 0.0:
        low, high = float(np.min(position)), float(np.max(position))
        found |= {"X": high - low, "X_low": low, "X_high": high, "X_mid": 0.5 * (low + high)}
        found["P"] = SHORT * (high - low)
    return found


def typical(values: Float) -> float:
    """High percentile of the magnitude, missing samples left out."""
    return float(np.percentile(np.abs(values[np.isfinite(values)]), TYPICAL))
