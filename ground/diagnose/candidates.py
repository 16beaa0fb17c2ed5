"""What may be missing: effects and sensor faults where they can act, with the starts of their fits."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Protocol

from ground.diagnose.result import Estimate, FindingKind
from sim_hal.plant.compose import compose, place_units
from sim_hal.plant.effects.base import Form
from sim_hal.plant.expressions import parse, to_text
from sim_hal.plant.plant import check_use, effect_of
from sim_hal.plant.simulate import (
    Effect,
    EffectUse,
    Parameter,
    Plant,
    alternatives,
    catalogue,
    prior,
    usual_size,
)
from sim_hal.plant.structure import PlantError

Scales = Mapping[str, Mapping[str, float]]
"""By balance equation or channel: the scales F, V, X, T, D, M, Y that effects' ranges are written in."""

SHAPE_STARTS = (0.25, 1.0, 4.0)
"""Starts of a shape parameter (a width, a characteristic speed), as multiples of its own start value."""
PLACE_STARTS = (0.15, 0.325, 0.5, 0.675, 0.85)
"""Starts of a parameter whose range spans zero or a stretch of travel, as shares of that range."""
NARROW = 20.0
"""A range whose ends are closer than this factor is a stretch to be searched evenly."""
BUILT_IN = ("drive", "hop", "axis", "drop")
FLIGHT = "ballistic"
"""The equation of what moves in the air alone, by the taxonomy."""


class Candidate(Protocol):
    """One explanation that competes.

    `key` tells it from all others: the prefix of its parameters in the plant. `starts` is how many starts its fit may
    try, `parameters` how many a fit is free to choose beyond the plant's own.
    """

    @property
    def physics_id(self) -> str: ...
    @property
    def kind(self) -> FindingKind: ...
    @property
    def equation(self) -> str: ...
    @property
    def channel(self) -> str | None: ...
    @property
    def key(self) -> str: ...
    @property
    def two_sided(self) -> bool: ...
    @property
    def starts(self) -> int: ...
    @property
    def parameters(self) -> int: ...

    def place(self, plant: Plant) -> tuple[str | None, str]:
        """The channel that lies (None: the plant is wrong), and the equation or balance that it enters."""

    def joined(self, plant: Plant, start: int = 0) -> Plant:
        """The plant with this in it, from one of its starts."""

    def removed(self, plant: Plant) -> Plant:
        """The plant without it."""

    def strengths(self) -> tuple[str, ...]:
        """Flat names of the parameters that are zero where it is absent."""

    def estimates(
        self, plant: Plant, values: Mapping[str, float], std: Mapping[str, float]
    ) -> dict[str, Estimate]:
        """Its parameters by own name, as a fit found them."""

    def statement(self, estimates: Mapping[str, Estimate]) -> str:
        """One sentence for a person, with the effect's size."""

    def formula(self, plant: Plant) -> str:
        """The law, in the catalogue's symbols."""


def label_of(candidate: Candidate) -> str:
    """For people: what a candidate is and where it enters."""
    place = candidate.channel or candidate.equation
    return f"{candidate.physics_id.replace('_', ' ')} ({place.replace('_', ' ')})"


@dataclass(frozen=True)
class EffectCandidate:
    """An effect of the catalogue in one place. `uses` are its starts; `own_strengths` are 0 when it is absent."""

    effect: Effect
    key: str
    uses: tuple[EffectUse, ...]
    own_strengths: tuple[str, ...]
    two_sided: bool

    @property
    def physics_id(self) -> str:
        """The taxonomy's name."""
        return self.effect.physics_id

    @property
    def kind(self) -> FindingKind:
        """Whether the plant lacks it or a channel lies."""
        return "sensor" if self.effect.kind == "sensor" else "physics"

    @property
    def equation(self) -> str:
        """The equation it enters."""
        return self.uses[0].equation

    @property
    def channel(self) -> str | None:
        """The channel that lies, of a sensor fault."""
        return self.uses[0].channel

    def place(self, plant: Plant) -> tuple[str | None, str]:
        """The channel that lies, if one does, and the balance that it enters, whatever the taxonomy calls that."""
        balance = None if self.kind == "sensor" else plant.balance(self.effect, self.equation)
        return self.channel, self.equation if balance is None else balance.name

    @property
    def starts(self) -> int:
        """How many starts its fit may try."""
        return len(self.uses)

    @property
    def parameters(self) -> int:
        """Number of parameters that a fit is free to choose."""
        return sum(math.isinf(parameter.std) for parameter in self.uses[0].parameters.values())

    def rarity(self, plant: Plant, values: Mapping[str, float], scales: Scales) -> float:
        """By how many powers of ten it is rarer, being as large as fitted, than such an effect of a usual size.

        The odds fall with the square of the size, as a Cauchy's do: a broken sensor may drift by anything.
        """
        own = scales_at(self.uses[0], plant, scales)
        parameters = check_use(plant, self.uses[0]).parameters
        usual = {f"{self.key}.{p.name}": usual_size(p, own) for p in parameters if p.usual}
        return sum(math.log10(1.0 + (values.get(name, 0.0) / size) ** 2) for name, size in usual.items())

    def joined(self, plant: Plant, start: int = 0) -> Plant:
        """The plant with the effect."""
        return plant.with_effect(self.uses[start])

    def removed(self, plant: Plant) -> Plant:
        """The plant without the effect."""
        return replace(plant, effects=tuple(use for use in plant.effects if plant.prefix(use) != self.key))

    def strengths(self) -> tuple[str, ...]:
        """Flat names of the strengths."""
        return tuple(f"{self.key}.{name}" for name in self.own_strengths)

    def estimates(
        self, plant: Plant, values: Mapping[str, float], std: Mapping[str, float]
    ) -> dict[str, Estimate]:
        """Fitted parameters by own name; a constant of the effect has sigma 0."""
        stored = {name: p for name, p in plant.flat().items() if name.startswith(self.key + ".")}
        return {
            flat.removeprefix(self.key + "."): Estimate(values.get(flat, p.value), std.get(flat, 0.0), p.unit)
            for flat, p in stored.items()
        }

    def statement(self, estimates: Mapping[str, Estimate]) -> str:
        """The effect's sentence, sizes with sigma and unit."""
        sizes = {
            name: f"{sized(e)} {e.unit if e.unit != '1' else ''}".rstrip() for name, e in estimates.items()
        }
        return self.effect.template(sizes).format(**sizes)

    def formula(self, plant: Plant) -> str:
        """The effect's law in the form in which it acts here."""
        return formula_text(check_use(plant, self.uses[0]))


def sized(estimate: Estimate) -> str:
    """A parameter with its sigma; one that may as well be anything only about."""
    if estimate.std > abs(estimate.value):
        return f"about {estimate.value:.2g}"
    return f"{estimate.value:.3g} ± {estimate.std:.1g}"


def formula_text(form: Form) -> str:
    """A form's law as text."""
    if form.dry:
        forward, backward = (to_text(parse(text)) for text in form.dry)
        if forward == backward:
            return f"-({forward}) * sign(v); at v = 0 any force up to that"
        return f"-({forward}) forward, +({backward}) backward; at v = 0 any force up to that"
    if form.sensor:
        return to_text(parse(form.sensor))
    if form.delay or form.skew:
        return "y(t - delay)" if form.delay else "y(t + skew * elapsed)"
    parts = [to_text(parse(form.force))] if form.force else []
    parts += [f"-({to_text(parse(form.inertia))}) * rate(v)"] if form.inertia else []
    parts += [f"{port} + ({text})" for port, text in form.terms.items()]
    parts += [f"{port} * ({text})" for port, text in form.factors.items()]
    parts += [f"d{name}/dt = {state.rate}" for name, state in form.states.items()]
    parts += [f"{name} = {text}" for name, text in form.local.items()]
    return "; ".join(parts)


def effect_candidates(plant: Plant, scales: Scales) -> tuple[EffectCandidate, ...]:
    """Every effect of the catalogue in every place of the plant where it can act and does not yet."""
    present = {plant.prefix(use) for use in plant.effects}
    found: list[EffectCandidate] = []
    for effect in catalogue().values():
        for equation, channel in plant.places(effect):
            use = EffectUse(effect.physics_id, equation, channel, {})
            if plant.prefix(use) in present or (channel is not None and channel not in scales):
                continue
            if not at_home(effect, use, plant):
                continue
            candidate = candidate_at(effect, use, plant, scales)
            if candidate is not None:
                found.append(candidate)
    return tuple(found)


def at_home(effect: Effect, use: EffectUse, plant: Plant) -> bool:
    """Whether an effect can be at work in a place.

    What falls freely touches nothing that could rub on it: an equation called ballistic takes what acts in the air
    alone. In the built-in plants every effect enters where the taxonomy puts it, unless there is only one place.
    """
    if effect.kind == "sensor" or use.equation == effect.equation:
        return True
    if use.equation == FLIGHT:
        return False
    return plant.kind not in BUILT_IN or len(plant.structure.balances) == 1


def candidate_at(effect: Effect, use: EffectUse, plant: Plant, scales: Scales) -> EffectCandidate | None:
    """One effect in one place with its starts; None where it cannot act."""
    balance = None if effect.kind == "sensor" else plant.balance(effect, use.equation)
    form = plant.form(effect, balance, use.channel)
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
    choices = {name: starts_of(*ranges[name]) for name in shapes[:1]}
    choices |= {p.name: alternatives(p, own) for p in form.parameters if p.also}
    uses = []
    for chosen in product(*choices.values()):
        values = {name: start for name, (start, _, _) in ranges.items()} | dict(
            zip(choices, chosen, strict=True)
        )
        parameters = {
            p.name: Parameter(values[p.name], 0.0 if p.constant else math.inf, units[p.name])
            for p in form.parameters
        }
        uses.append(replace(use, parameters=parameters))
    if not fits(plant, uses[0]):
        return None
    two_sided = all(ranges[name][1] < 0.0 for name in strengths)
    return EffectCandidate(effect, plant.prefix(use), tuple(uses), strengths, two_sided)


def fits(plant: Plant, use: EffectUse) -> bool:
    """Whether an effect's formulas have the units of their place: a rig's position may be a voltage."""
    check_use(plant, use)
    try:
        compose(plant.with_effect(use))
    except PlantError:
        if plant.kind in BUILT_IN:
            raise
        return False
    return True


def starts_of(start: float, low: float, high: float) -> Sequence[float]:
    """Where the search of a shape parameter begins: a size by factors, a place evenly and where stated."""
    if low <= 0.0 or high < NARROW * low:
        return sorted({start, *(low + share * (high - low) for share in PLACE_STARTS)})
    return sorted({min(max(start * factor, low), high) for factor in SHAPE_STARTS})


def scales_at(use: EffectUse, plant: Plant, scales: Scales) -> dict[str, float]:
    """The scales of the place an effect enters, and the plant's own parameters."""
    effect = effect_of(plant, use)
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
