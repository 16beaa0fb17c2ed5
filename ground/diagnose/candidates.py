"""Which effects compete, where they may enter, and from which values their fits start."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product

from sim_hal.plant.compose import place_units
from sim_hal.plant.plant import check_use, find_effect
from sim_hal.plant.simulate import Effect, EffectUse, Parameter, Plant, catalogue, prior

Scales = Mapping[str, Mapping[str, float]]
"""By balance equation or channel: the scales F, V, X, T, M, Y that effects' ranges are written in."""

SHAPE_STARTS = (1.0, 4.0)
"""Starts of a shape parameter (a width, a characteristic speed), as multiples of its own start value."""


@dataclass(frozen=True)
class Candidate:
    """One effect in one place. `uses` are the starts that its fit tries; `own_strengths` are 0 when it is absent."""

    effect: Effect
    equation: str
    channel: str | None
    uses: tuple[EffectUse, ...]
    own_strengths: tuple[str, ...]
    two_sided: bool

    @property
    def physics_id(self) -> str:
        """The taxonomy's name."""
        return self.effect.physics_id

    @property
    def parameters(self) -> int:
        """Number of parameters that a fit is free to choose."""
        return sum(math.isinf(parameter.std) for parameter in self.uses[0].parameters.values())

    @property
    def place(self) -> str:
        """The channel or balance equation it enters."""
        return self.channel or self.equation

    @property
    def label(self) -> str:
        """For people: the effect and where it enters."""
        return f"{self.physics_id.replace('_', ' ')} ({self.place.replace('_', ' ')})"

    def strengths(self, plant: Plant) -> tuple[str, ...]:
        """Flat names of the strengths in a plant."""
        prefix = plant.prefix(self.uses[0])
        return tuple(f"{prefix}.{name}" for name in self.own_strengths)

    def weakened(self, use: EffectUse, share: float) -> EffectUse:
        """The same use with its strengths scaled down."""
        parameters = {
            name: replace(p, value=p.value * share) if name in self.own_strengths else p
            for name, p in use.parameters.items()
        }
        return replace(use, parameters=parameters)


def candidates(plant: Plant, scales: Scales) -> tuple[Candidate, ...]:
    """Every effect of the catalogue in every place of the plant where it can act and does not yet."""
    present = {plant.prefix(use) for use in plant.effects}
    found: list[Candidate] = []
    for effect in catalogue().values():
        for equation, channel in plant.places(effect):
            use = EffectUse(effect.physics_id, equation, channel, {})
            if plant.prefix(use) in present or (channel is not None and channel not in scales):
                continue
            candidate = candidate_at(effect, use, plant, scales)
            if candidate is not None:
                found.append(candidate)
    return tuple(found)


def candidate_at(effect: Effect, use: EffectUse, plant: Plant, scales: Scales) -> Candidate | None:
    """One effect in one place with its starts; None where it cannot act."""
    form = (
        effect.forms[0]
        if effect.kind == "sensor"
        else plant.form(effect, plant.balance(effect, use.equation))
    )
    strengths = tuple(p.name for p in form.parameters if p.strength) if form else ()
    if form is None or not strengths:
        return None
    own = scales_at(use, plant, scales)
    try:
        ranges = {p.name: prior(p, own) for p in form.parameters}
    except KeyError:  # a scale that this place does not have: the effect cannot be told there
        return None
    units = place_units(plant, use, form)
    shapes = [p.name for p in form.parameters if not p.strength and not p.constant]
    uses = []
    for factors in product(SHAPE_STARTS, repeat=len(shapes[:1])):
        values = {name: start for name, (start, _, _) in ranges.items()}
        for name, factor in zip(shapes[:1], factors, strict=True):
            _, low, high = ranges[name]
            values[name] = min(max(values[name] * factor, low), high)
        parameters = {
            p.name: Parameter(values[p.name], 0.0 if p.constant else math.inf, units[p.name])
            for p in form.parameters
        }
        uses.append(replace(use, parameters=parameters))
    check_use(plant, uses[0])
    two_sided = all(ranges[name][1] < 0.0 for name in strengths)
    return Candidate(effect, use.equation, use.channel, tuple(uses), strengths, two_sided)


def scales_at(use: EffectUse, plant: Plant, scales: Scales) -> dict[str, float]:
    """The scales of the place an effect enters, and the plant's own parameters."""
    effect = find_effect(use.physics_id, plant.source)
    balance = plant.balance(effect, use.equation)
    place = use.channel or (balance.name if balance else use.equation)
    values = {name: parameter.value for name, parameter in plant.parameters.items()}
    return values | dict(scales.get(place, scales.get(use.equation, {})))


def ranges_of(plant: Plant, scales: Scales) -> dict[str, tuple[float, float, float]]:
    """Start and limits, by flat name, of the effect parameters that are free: found just now, without a prior."""
    found: dict[str, tuple[float, float, float]] = {}
    for use in plant.effects:
        form = check_use(plant, use)
        own = scales_at(use, plant, scales)
        for parameter in form.parameters:
            stored = use.parameters[parameter.name]
            if math.isinf(stored.std):
                _, low, high = prior(parameter, own)
                found[f"{plant.prefix(use)}.{parameter.name}"] = (stored.value, low, high)
    return found
