"""A plant's structure and its effects, put together into one set of equations.

Effects are taken in the order of their flat names, whatever their order in the file, and a port's value is
(its own value) · factors + terms, so that the result does not depend on who was added first.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from sim_hal.plant.effects.base import FILTERED, Form
from sim_hal.plant.expressions import ExpressionError, Name, Node, Num, Op, add, multiply, parse, rename, walk
from sim_hal.plant.filters import Filters, Settled, while_acting
from sim_hal.plant.inertia import Correction, heavier
from sim_hal.plant.plant import EffectUse, Plant, check_use, effect_of
from sim_hal.plant.structure import Balance, Definition, Memory, PlantError, State, Structure, unit_text
from sim_hal.plant.units import (
    INVERSE,
    PURE,
    Dimension,
    UnitError,
    channel_unit,
    check_formula,
    dimension,
    sound_unit_of,
    times,
)


@dataclass(frozen=True)
class Element:
    """A set-valued friction element; off while all parameters in `strengths` are 0 (never, where it is None)."""

    velocity: Node
    per_force: Mapping[str, Node]
    forward: Node
    backward: Node
    strengths: tuple[str, ...] | None


@dataclass(frozen=True)
class Model:
    """Equations with all effects in them.

    strengths: parameters that are 0 where an effect's internal state or memory does not matter. kinks: the same for
    kinked formulas that only effects bring. delays, skews: by channel. settled: states that start where
    other states put them.
    """

    structure: Structure
    parameters: tuple[str, ...]
    states: Mapping[str, State]
    rates: Mapping[str, Node]
    definitions: Mapping[str, Node]
    memories: Mapping[str, Memory]
    elements: tuple[Element, ...]
    outputs: Mapping[str, Node]
    strengths: Mapping[str, tuple[str, ...]]
    kinks: Mapping[Node, tuple[str, ...]]
    delays: Mapping[str, Node]
    skews: Mapping[str, Node]
    settled: Mapping[str, Settled]


@dataclass(frozen=True, order=True)
class Fault:
    """What a channel reads instead of `y`; `filtered` is `y` through a first-order filter of this time constant."""

    rank: int
    prefix: str
    formula: Node = field(compare=False)
    low_pass: Node | None = field(compare=False)
    strengths: tuple[str, ...] = field(compare=False)


@dataclass
class _Additions:
    """What the effects bring, collected before it is put into the equations."""

    forces: dict[str, list[Node]] = field(default_factory=dict)
    inertias: dict[str, list[Node]] = field(default_factory=dict)
    dry: list[tuple[Balance, Node, Node, tuple[str, ...] | None]] = field(default_factory=list)
    definitions: dict[str, Node] = field(default_factory=dict)
    terms: dict[str, list[Node]] = field(default_factory=dict)
    factors: dict[str, list[Node]] = field(default_factory=dict)
    states: dict[str, State] = field(default_factory=dict)
    rates: dict[str, Node] = field(default_factory=dict)
    memories: dict[str, Memory] = field(default_factory=dict)
    strengths: dict[str, tuple[str, ...]] = field(default_factory=dict)
    kinks: dict[Node, tuple[str, ...]] = field(default_factory=dict)
    faults: dict[str, list[Fault]] = field(default_factory=dict)
    delays: dict[str, list[Node]] = field(default_factory=dict)
    skews: dict[str, list[Node]] = field(default_factory=dict)


MISSING_FORCE = "missing_force"


def compose(plant: Plant, missing_force: str | None = None) -> Model:
    """All equations of a plant with its effects; raises `PlantError`.

    `missing_force` names a balance that gets a constant unknown force, a state of that name.
    """
    structure = plant.structure
    found = _Additions()
    for friction in structure.friction:
        balance = structure.balances[friction.balance]
        found.dry.append((balance, friction.forward, friction.backward, None))
    for use in sorted(plant.effects, key=plant.prefix):
        _collect(plant, use, check_use(plant, use), found)
    if missing_force is not None:
        _missing(plant, missing_force, found)
    definitions = {name: _port(name, item, found) for name, item in structure.definitions.items()}
    definitions |= found.definitions
    inertias = [(structure.balances[name], add(*parts)) for name, parts in sorted(found.inertias.items())]
    corrected = heavier(inertias, definitions, structure)
    rates = _rates(structure, found, corrected)
    filters = Filters(_speeds(plant, rates))
    outputs = {
        channel: _faulty(channel, node, sorted(found.faults.get(channel, [])), filters)
        for channel, node in structure.outputs.items()
    }
    return Model(
        structure=structure,
        parameters=tuple(plant.flat()),
        states={**structure.states, **found.states, **filters.states},
        rates=rates | filters.rates,
        definitions=definitions,
        memories={**structure.memories, **found.memories},
        elements=_elements(found, corrected),
        outputs=outputs,
        strengths=found.strengths | filters.strengths,
        kinks={node: own for node, own in found.kinks.items() if node not in _kinks_of(structure)},
        delays={channel: add(*parts) for channel, parts in found.delays.items()},
        skews={channel: add(*parts) for channel, parts in found.skews.items()},
        settled=filters.settled,
    )


def _collect(plant: Plant, use: EffectUse, form: Form, found: _Additions) -> None:
    """Add one effect, its symbols replaced by the plant's."""
    effect = effect_of(plant, use)
    balance = plant.balance(effect, use.equation)
    prefix = plant.prefix(use)
    translate = _translator(plant, use, form, balance)
    strengths = tuple(f"{prefix}.{item.name}" for item in form.parameters if item.strength)
    for text in form.formulas():
        for node in walk(translate(text)):
            found.kinks[node] = (*found.kinks.get(node, ()), *strengths)
    _check_formulas(plant, use, form)
    found.definitions |= {f"{prefix}.{name}": translate(text) for name, text in form.local.items()}
    for name, state in form.states.items():
        own = f"{prefix}.{name}"
        found.states[own] = State(state.unit, translate(state.initial))
        found.rates[own] = while_acting(strengths, translate(state.rate))
        if strengths:
            found.strengths[own] = strengths
    for name, memory in form.memories.items():
        upper = None if memory.upper is None else translate(memory.upper)
        own = f"{prefix}.{name}"
        found.memories[own] = Memory(memory.unit, translate(memory.lower), upper, translate(memory.initial))
        if strengths:
            found.strengths[own] = strengths
    for ports, additions in ((form.terms, found.terms), (form.factors, found.factors)):
        for port, text in ports.items():
            additions.setdefault(port, []).append(translate(text))
    if balance is not None:
        if form.force:
            found.forces.setdefault(balance.name, []).append(translate(form.force))
        if form.inertia:
            found.inertias.setdefault(balance.name, []).append(translate(form.inertia))
        if form.dry:
            found.dry.append((balance, translate(form.dry[0]), translate(form.dry[1]), strengths or None))
    if use.channel is not None:
        if form.sensor:
            low_pass = translate(form.low_pass) if form.low_pass else None
            fault = Fault(effect.rank, prefix, translate(form.sensor), low_pass, strengths)
            found.faults.setdefault(use.channel, []).append(fault)
        for formula, late in ((form.delay, found.delays), (form.skew, found.skews)):
            if formula:
                late.setdefault(use.channel, []).append(translate(formula))


def _kinks_of(structure: Structure) -> set[Node]:
    """All formulas within the nominal equations."""
    whole = [*structure.rates.values(), *(item.value for item in structure.definitions.values())]
    whole += [node for item in structure.friction for node in (item.forward, item.backward)]
    return {node for formula in whole for node in walk(formula)}


def _translator(plant: Plant, use: EffectUse, form: Form, balance: Balance | None) -> Callable[[str], Node]:
    """Formula text of the effect → node in the plant's symbols."""
    prefix = plant.prefix(use)
    own = form.names()
    places = {} if balance is None else _places(plant.structure, balance)

    def symbol(name: str) -> Node:
        return Name(f"{prefix}.{name}") if name in own else places.get(name, Name(name))

    return lambda text: rename(parse(text), symbol)


def _places(structure: Structure, balance: Balance) -> dict[str, Node]:
    """What v, x and load mean in a balance."""
    load = balance.load
    if load is None and len(balance.per_force) == 1:
        state, per_force = next(iter(balance.per_force.items()))
        load = Op("/", (structure.rates[state], per_force))
    found = {"v": balance.velocity, "x": balance.position, "load": load}
    return {name: node for name, node in found.items() if node is not None}


#: Units of a rotation, whose dimension does not show that it is one.
ANGULAR = {("velocity", unit_text(dimension("1/s"))): "rad/s", ("position", unit_text(PURE)): "rad"}


def place_units(plant: Plant, use: EffectUse, form: Form) -> dict[str, str]:
    """Unit of each of the effect's parameters at its place; raises `PlantError` where it does not fit."""
    effect = effect_of(plant, use)
    tokens = _unit_tokens(plant, use, plant.balance(effect, use.equation))
    found = {}
    for item in form.parameters:
        text = re.sub(r"[a-z_]+", lambda match: tokens.get(match[0], match[0]), item.unit)
        if text == item.unit:
            found[item.name] = text
            continue
        try:
            unit = unit_text(dimension(text))
            found[item.name] = ANGULAR.get((item.unit, unit), unit)
        except UnitError as error:
            raise PlantError(f"{plant.source}: effects: {use.physics_id}.{item.name}: {error}") from None
    return found


def _unit_tokens(plant: Plant, use: EffectUse, balance: Balance | None) -> dict[str, str]:
    tokens = {}
    symbols = plant.structure.units()
    if balance is not None:
        tokens["force"] = f"({balance.unit})"
        for name, node in (("velocity", balance.velocity), ("position", balance.position)):
            if node is not None:
                tokens[name] = f"({unit_text(sound_unit_of(node, symbols) or PURE)})"
    if use.channel is not None:
        tokens["channel"] = f"({channel_unit(use.channel)})"
    return tokens


def _check_formulas(plant: Plant, use: EffectUse, form: Form) -> None:
    """Refuse an effect whose formulas do not have the unit of their place."""
    effect = effect_of(plant, use)
    balance = plant.balance(effect, use.equation)
    symbols = _effect_symbols(plant, use, form, balance)
    force = dimension(balance.unit) if balance is not None else PURE
    definitions = plant.structure.definitions
    expected: list[tuple[str | None, Dimension]] = [(form.force, force)]
    expected += [(text, force) for text in form.dry or ()]
    expected += [(text, dimension(definitions[port].unit)) for port, text in form.terms.items()]
    expected += [(text, PURE) for text in form.factors.values()]
    second = dimension("s")
    expected += [(item.rate, times(dimension(item.unit), second, INVERSE)) for item in form.states.values()]
    if balance is not None and form.inertia:
        expected.append((form.inertia, times(times(force, second), symbols["v"], INVERSE)))
    if use.channel is not None:
        expected += [(form.sensor, dimension(channel_unit(use.channel))), (form.delay, second)]
        expected += [(form.skew, PURE), (form.low_pass, second)]
    for text, unit in expected:
        try:
            if text is not None:
                check_formula(parse(text), symbols, unit)
        except ExpressionError as error:
            raise PlantError(f"{plant.source}: effects: {use.physics_id}: {error}") from None


def _effect_symbols(
    plant: Plant, use: EffectUse, form: Form, balance: Balance | None
) -> dict[str, Dimension]:
    symbols = plant.structure.units()
    if balance is not None:
        places = _places(plant.structure, balance)
        symbols = symbols | {name: sound_unit_of(node, symbols) or PURE for name, node in places.items()}
    if use.channel is not None:
        symbols["y"] = symbols[FILTERED] = dimension(channel_unit(use.channel))
    symbols |= {name: dimension(unit) for name, unit in place_units(plant, use, form).items()}
    symbols |= {name: dimension(item.unit) for name, item in form.states.items()}
    symbols |= {name: dimension(item.unit) for name, item in form.memories.items()}
    for name, text in form.local.items():
        symbols[name] = sound_unit_of(parse(text), symbols) or PURE
    return symbols


def _missing(plant: Plant, name: str, found: _Additions) -> None:
    """A constant unknown force in a balance, as a state."""
    if name not in plant.structure.balances:
        known = ", ".join(plant.structure.balances)
        raise PlantError(
            f"{plant.source}: {name!r} is no balance that a missing force may enter; known: {known}"
        )
    balance = plant.structure.balances[name]
    found.states[MISSING_FORCE] = State(balance.unit, Num(0.0))
    found.rates[MISSING_FORCE] = Num(0.0)
    if balance.port is not None:
        found.terms.setdefault(balance.port, []).append(Name(MISSING_FORCE))
    else:
        found.forces.setdefault(name, []).append(Name(MISSING_FORCE))


def _port(name: str, definition: Definition, found: _Additions) -> Node:
    scaled = multiply(definition.value, *found.factors.get(name, []))
    return add(scaled, *found.terms.get(name, []))


def _rates(structure: Structure, found: _Additions, corrected: Correction) -> dict[str, Node]:
    """Rates with all forces added, then corrected where inertia was added."""
    rates = dict(structure.rates)
    for name in structure.balances:
        for state, per_force in structure.balances[name].per_force.items():
            for force in found.forces.get(name, []):
                rates[state] = add(rates[state], multiply(per_force, force))
    return {**rates, **corrected(rates), **found.rates}


def _speeds(plant: Plant, rates: Mapping[str, Node]) -> dict[str, Name]:
    """States whose rate is a state, of a rig that may have been moving before; the built-in kinds begin at rest."""
    if plant.kind != "equations":
        return {}
    states = plant.structure.states
    return {own: rate for own, rate in rates.items() if isinstance(rate, Name) and rate.id in states}


def _elements(found: _Additions, corrected: Correction) -> tuple[Element, ...]:
    """Friction elements, those with the same relative velocity and the same effect merged."""
    merged: dict[tuple[object, ...], Element] = {}
    for balance, forward, backward, strengths in found.dry:
        if balance.velocity is None:
            raise PlantError(f"balance {balance.name}: dry friction needs a velocity")
        per_force = corrected(balance.per_force)
        key = (balance.velocity, *per_force.items())
        if key not in merged:
            merged[key] = Element(balance.velocity, per_force, forward, backward, strengths)
            continue
        old = merged[key]
        both = None if old.strengths is None or strengths is None else (*old.strengths, *strengths)
        merged[key] = replace(
            old, forward=add(old.forward, forward), backward=add(old.backward, backward), strengths=both
        )
    return tuple(merged.values())


def _faulty(channel: str, node: Node, faults: Sequence[Fault], filters: Filters) -> Node:
    """What a channel reads with its faults, applied one after the other."""
    for fault in faults:
        values = {"y": node}
        if fault.low_pass is not None:
            name = f"{fault.prefix}.{FILTERED}"
            values[name] = filters.add(channel, name, node, fault.low_pass, fault.strengths)

        def symbol(name: str, values: Mapping[str, Node] = values) -> Node:
            return values.get(name, Name(name))

        node = rename(fault.formula, symbol)
    return node
