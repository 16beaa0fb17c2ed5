"""What can be hidden in a rig: every effect of the catalogue, every sensor fault, a parameter out of tolerance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.random import Generator

from ground.recordings.model import Recording
from ground.recordings.plant_run import to_run
from sim_hal.plant.compose import place_units
from sim_hal.plant.effects.base import Form
from sim_hal.plant.expressions import Name, Node, Op
from sim_hal.plant.plant import check_use
from sim_hal.plant.simulate import EffectUse, Parameter, Plant, catalogue, compile_plant, prior, probes

OUT_OF_TOLERANCE = "parameter_out_of_tolerance"
TYPICAL = 90.0
"""Percentile of a magnitude along the runs that counts as its typical size."""
SIZE_SPREAD = 3.0
"""A size that only shapes an effect (a width, a time) is drawn within this factor of the catalogue's start."""
INNER = (0.15, 0.85)
"""A place along a range is drawn within these shares of it."""
NARROW = 20.0
"""Limits closer than this factor span a range of places, not of sizes."""
EDGE_SIGMAS = 3.0
"""What a tolerance may still explain; a parameter counts as out of tolerance beyond."""


@dataclass(frozen=True)
class Explanation:
    """One thing that may be hidden. `place` is the channel that lies or the parameter that is off, else None."""

    physics_id: str
    kind: str
    equation: str
    place: str | None = None


@dataclass(frozen=True)
class Shaped:
    """An explanation with everything drawn but its size.

    `values` are the effect's parameters at size 1; those in `scaled` grow with the size (none: it acts as a whole).
    A parameter out of tolerance has its direction in `values`. `largest` is the greatest size still plausible.
    """

    explanation: Explanation
    values: Mapping[str, float]
    scaled: tuple[str, ...]
    largest: float
    units: Mapping[str, str] = field(default_factory=dict)

    def parameters(self, size: float) -> dict[str, float]:
        """The effect's parameters at a size."""
        return {name: value * (size if name in self.scaled else 1.0) for name, value in self.values.items()}

    def hidden_in(self, plant: Plant, nominal: Plant, size: float) -> Plant:
        """The true plant with this in it; a parameter is moved `EDGE_SIGMAS + size` sigmas from its nominal value."""
        own = self.explanation
        if own.physics_id == OUT_OF_TOLERANCE:
            stated = nominal.flat()[str(own.place)]
            away = self.values["direction"] * (EDGE_SIGMAS + size)
            return plant.with_values({str(own.place): stated.value + away * stated.std})
        parameters = {
            name: Parameter(value, 0.0, self.units[name]) for name, value in self.parameters(size).items()
        }
        return plant.with_effect(EffectUse(own.physics_id, own.equation, own.place, parameters))


def explanations(plant: Plant, runs: Sequence[Recording]) -> tuple[Explanation, ...]:
    """All that may be hidden in runs of this plant, each in the place that the taxonomy gives it, or the only one.

    What falls freely touches nothing but the air: of what rubs, stops or pushes, nothing is hidden in a drop.
    """
    found = []
    alone = len(plant.structure.balances) == 1 and plant.kind != "drop"
    for effect in catalogue().values():
        for equation, channel in plant.places(effect):
            if effect.kind == "sensor" or equation == effect.equation or alone:
                found.append(Explanation(effect.physics_id, effect.kind, equation, channel))
    surfaces = {str(run.conditions.get("surface", "")) for run in runs}
    for name, parameter in plant.flat().items():
        here = "." not in name or name.split(".")[0] in surfaces
        if parameter.std > 0.0 and here:
            found.append(Explanation(OUT_OF_TOLERANCE, "parameter", "any", name))
    return tuple(found)


def drawn(options: Sequence[Explanation], random: Generator) -> Explanation:
    """One of the options: each name as likely as any other, then each of its places."""
    names = sorted({option.physics_id for option in options})
    name = str(random.choice(names))
    places = [option for option in options if option.physics_id == name]
    return places[int(random.integers(len(places)))]


def shaped(
    explanation: Explanation, plant: Plant, scales: Mapping[str, Mapping[str, float]], random: Generator
) -> Shaped | None:
    """Draw all but the size; None where the rig lacks a scale that the effect is written in."""
    if explanation.physics_id == OUT_OF_TOLERANCE:
        return Shaped(explanation, {"direction": float(random.choice([-1.0, 1.0]))}, (), 12.0)
    effect = catalogue()[explanation.physics_id]
    use = EffectUse(effect.physics_id, explanation.equation, explanation.place, {})
    form = _form(plant, use)
    balance = plant.balance(effect, explanation.equation)
    place = explanation.place or (balance.name if balance is not None else explanation.equation)
    numbers = {name: parameter.value for name, parameter in plant.parameters.items()}
    try:
        ranges = {p.name: prior(p, numbers | dict(scales.get(place, {}))) for p in form.parameters}
    except KeyError:
        return None
    scaled = tuple(p.name for p in form.parameters if p.strength and not p.constant)
    direction = random.normal(size=len(scaled))
    direction /= max(float(np.linalg.norm(direction)), 1e-300)
    values = {}
    for parameter in form.parameters:
        start, low, high = ranges[parameter.name]
        if parameter.name in scaled:
            part = float(direction[scaled.index(parameter.name)])
            values[parameter.name] = start * (part if low < 0.0 else abs(part))
        elif parameter.constant:
            values[parameter.name] = start
        else:
            values[parameter.name] = _shape(start, low, high, random)
    if scaled and not any(values[name] for name in scaled):
        return None
    limits = [ranges[name][2] / abs(values[name]) for name in scaled if values[name] != 0.0]
    largest = min(limits, default=1.0)
    return Shaped(explanation, values, scaled, largest, place_units(plant, use, form))


def _form(plant: Plant, use: EffectUse) -> Form:
    effect = catalogue()[use.physics_id]
    form = (
        effect.forms[0]
        if effect.kind == "sensor"
        else plant.form(effect, plant.balance(effect, use.equation))
    )
    assert form is not None  # it is one of the plant's places
    blank = {p.name: Parameter(0.0, 0.0, "1") for p in form.parameters}
    return check_use(plant, replace(use, parameters=blank))


def _shape(start: float, low: float, high: float, random: Generator) -> float:
    """A size by factors about the catalogue's start, a place evenly over the inner part of its range."""
    if low <= 0.0 or high < NARROW * low:
        return low + (high - low) * random.uniform(*INNER)
    spread = SIZE_SPREAD ** random.uniform(-1.0, 1.0)
    return float(min(max(start * spread, low), high))


def typical_scales(plant: Plant, runs: Sequence[Recording]) -> dict[str, dict[str, float]]:
    """Typical force, speed, travel, inertia and time by balance, and reading by channel, as the plant moves."""
    extra: dict[str, Node] = {}
    for name, balance in plant.structure.balances.items():
        extra |= probes(plant, name)
        if balance.port is not None:
            extra[f"{name}.force"] = Name(balance.port)
        else:
            state, response = next(iter(balance.per_force.items()))
            extra |= {f"{name}.rate": Op("rate", (Name(state),)), f"{name}.response": response}
    compiled = compile_plant(plant, extra=extra)
    table = np.vstack([compiled.run(compiled.values, to_run(run, plant)) for run in runs])
    series = {name: table[:, i] for i, name in enumerate(compiled.output_names)}
    duration = float(np.median([run.times_s[-1] - run.times_s[0] for run in runs]))
    times = {"T": duration, "S": float(np.median(np.diff(runs[0].times_s)))}
    scales = {
        name: times | {"Y": _typical(series[name]), "Y_max": float(np.max(np.abs(series[name])))}
        for name in plant.structure.outputs
    }
    for name in plant.structure.balances:
        scales[name] = {"T": duration} | _balance_scales(name, series)
    return scales


def _balance_scales(name: str, series: Mapping[str, np.ndarray]) -> dict[str, float]:
    found = {}
    if f"{name}.force" in series:
        found["F"] = _typical(series[f"{name}.force"])
    else:
        response = series[f"{name}.response"]
        acts = response != 0.0
        found["F"] = _typical(series[f"{name}.rate"][acts] / response[acts])
        found["M"] = float(np.median(np.abs(1.0 / response[acts])))
    found["A_sin"] = found["A_cos"] = 0.02 * found["F"]
    if f"{name}.velocity" in series:
        found["V"] = _typical(series[f"{name}.velocity"])
    if f"{name}.position" in series:
        low, high = float(np.min(series[f"{name}.position"])), float(np.max(series[f"{name}.position"]))
        found |= {"X": high - low, "X_low": low, "X_high": high, "X_mid": 0.5 * (low + high)}
        found["P"] = 0.05 * (high - low)
    return {
        key: value for key, value in found.items() if value != 0.0 or key == "X_low"
    }  # travel may begin at 0


def _typical(values: np.ndarray) -> float:
    return float(np.percentile(np.abs(values), TYPICAL))
