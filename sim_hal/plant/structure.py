"""The structure of a plant: its equations, as read from a kind's YAML or from a plant file of `kind: equations`.

Checked as a whole on reading: names, formulas, units, circular definitions.
"""

from __future__ import annotations

import keyword
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from hal.config import build_settings
from hal.errors import ConfigError
from sim_hal.plant import expressions
from sim_hal.plant.between import LINEAR
from sim_hal.plant.expressions import ExpressionError, Node, Num, Op
from sim_hal.plant.units import (
    BOOLEAN,
    INVERSE,
    Dimension,
    UnitError,
    channel_unit,
    check_formula,
    check_unit,
    dimension,
    times,
)

_NAME = re.compile(r"[^\W\d]\w*")
_RESERVED = {*expressions.FUNCTIONS, "pi", "t", "elapsed", "and", "or", "not"}
FIT = "fit"


class PlantError(ConfigError):
    """A plant file was refused. The message names file, key, value and limit, and points into formulas."""


@dataclass(frozen=True)
class Quantity:
    """What a kind says of a parameter: its unit and the limits that its value must keep."""

    unit: str
    low: float | None = None
    high: float | None = None
    optional: bool = False


@dataclass(frozen=True)
class Known:
    """Something that a recording's sidecar tells of the start, `state:` there."""

    unit: str
    default: float | None = None


@dataclass(frozen=True)
class Input:
    """A channel that drives the simulation; `interpolation` between samples is one of `INTERPOLATIONS`."""

    unit: str
    interpolation: str = LINEAR


@dataclass(frozen=True)
class State:
    """A state; `initial` is a formula of parameters and known quantities, a channel's name, or FIT."""

    unit: str
    initial: Node | str


@dataclass(frozen=True)
class Definition:
    """A named algebraic formula; effects may add a term or multiply a factor where it is a port."""

    value: Node
    unit: str
    port: bool = False


@dataclass(frozen=True)
class Balance:
    """A place where a missing force may enter: a rate equation, a force between several, or a port.

    `per_force` gives, by state, what one unit of the force adds to the rate; empty for a port.
    `load` is the force that load-dependent friction follows.
    """

    name: str
    equation: str
    unit: str
    per_force: Mapping[str, Node]
    velocity: Node | None
    position: Node | None
    load: Node | None
    port: str | None = None


@dataclass(frozen=True)
class Friction:
    """Dry friction of the nominal plant on a balance: resisting force when moving forward and backward."""

    balance: str
    forward: Node
    backward: Node


@dataclass(frozen=True)
class Memory:
    """A play operator: keeps its value while within [lower, upper], limits linear in the states."""

    unit: str
    lower: Node
    upper: Node | None
    initial: Node


@dataclass(frozen=True)
class Structure:
    """All equations of a plant. Mappings keep the order of the file."""

    parameters: Mapping[str, Quantity]
    known: Mapping[str, Known] = field(default_factory=dict)
    inputs: Mapping[str, Input] = field(default_factory=dict)
    events: tuple[str, ...] = ()
    flags: Mapping[str, Node] = field(default_factory=dict)
    states: Mapping[str, State] = field(default_factory=dict)
    rates: Mapping[str, Node] = field(default_factory=dict)
    definitions: Mapping[str, Definition] = field(default_factory=dict)
    memories: Mapping[str, Memory] = field(default_factory=dict)
    balances: Mapping[str, Balance] = field(default_factory=dict)
    friction: tuple[Friction, ...] = ()
    outputs: Mapping[str, Node] = field(default_factory=dict)
    surface_parameters: tuple[str, ...] = ()

    def units(self) -> dict[str, Dimension]:
        """Dimension of each symbol that formulas may use (flags and events are true or false)."""
        found = {"t": dimension("s"), "elapsed": dimension("s")}
        found |= {name: dimension(item.unit) for name, item in self.known.items()}
        for group in (self.parameters, self.inputs, self.states, self.definitions, self.memories):
            found |= {name: dimension(item.unit) for name, item in group.items()}
        return found | dict.fromkeys((*self.flags, *self.events), BOOLEAN)


#: Text of a force's unit, by dimension of the rate it enters divided by `per_force`.
_USUAL_UNITS = (
    *("N", "N*m", "V", "A", "Pa", "W", "1", "K", "m", "m/s"),
    *("N*s/m", "N*s^2/m^2", "N/m", "N*m*s", "N*m*s^2", "ohm", "V*s", "H"),
)
_FORCE_UNITS = {dimension(unit): unit for unit in _USUAL_UNITS}


_DERIVED = ("N", "V")
_DERIVED_OF_HEAT = ("W", "J")


def unit_text(dim: Dimension) -> str:
    """A unit with this dimension as a person would write it: the usual ones, else with the fewest factors."""
    if dim in _FORCE_UNITS:
        return _FORCE_UNITS[dim]
    ways: list[tuple[str | None, int, Dimension]] = [(None, 0, dim)]
    ways += [
        (unit, power, times(dim, dimension(unit), Fraction(-power)))
        for unit in (_DERIVED_OF_HEAT if "kelvin" in dict(dim) else _DERIVED)
        for power in (1, -1, 2, -2, 3, -3)
    ]
    texts = {_product(unit, power, rest): len(rest) + (power != 0) for unit, power, rest in ways}
    return min(texts, key=lambda text: (texts[text], len(text)))


def _product(unit: str | None, power: int, rest: Dimension) -> str:
    """A derived unit to a power, times base units: `N*s^3/m^3`."""
    letters = {"kilogram": "kg", "meter": "m", "second": "s", "ampere": "A", "kelvin": "K", "mole": "mol"}
    factors = [(unit, Fraction(power))] if unit else []
    factors += [(letters.get(name, name), exponent) for name, exponent in rest]
    above = [name + _exponent(p) for name, p in factors if p > 0]
    below = ["/" + name + _exponent(-p) for name, p in factors if p < 0]
    return ("*".join(above) or "1") + "".join(below)


def _exponent(power: Fraction) -> str:
    return "" if power == 1 else f"^{float(power):g}"


class Reader:
    """Reads the keys of a structure from a mapping; every refusal names file and key."""

    def __init__(self, data: Mapping[str, Any], source: str) -> None:
        self.data = data
        self.source = source

    def error(self, key: str, reason: str) -> PlantError:
        return PlantError(f"{self.source}: {key}: {reason}")

    def entries(self, key: str, names: Iterable[str] | None = None) -> dict[str, Any]:
        """The mapping under `key` with checked names (an absent one is empty)."""
        found = self.data.get(key, {})
        if not isinstance(found, dict):
            raise self.error(key, f"{found!r} must be a mapping")
        for name in found:
            self.check_name(f"{key}.{name}", name)
        return found

    def check_name(self, key: str, name: object) -> None:
        if not isinstance(name, str) or not _NAME.fullmatch(name) or keyword.iskeyword(name):
            raise self.error(key, f"{name!r} is not a name (letters, digits, _; no reserved word)")
        if name in _RESERVED:
            raise self.error(key, f"{name!r} has a meaning of its own in formulas; choose another name")

    def settings(self, value: Any, cls: type[Any], key: str) -> Any:
        try:
            return build_settings(value, cls, self.source, key + ".")
        except PlantError:
            raise
        except ConfigError as error:
            raise PlantError(str(error)) from None

    def formula(self, value: Any, key: str) -> Node:
        if isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value):
            return Num(float(value)) if value >= 0 else Op("neg", (Num(-float(value)),))
        if not isinstance(value, str):
            raise self.error(key, f"{value!r} must be a formula in text")
        try:
            return expressions.parse(value)
        except ExpressionError as error:
            raise self.error(key, str(error)) from None

    def optional(self, entry: Mapping[str, Any], name: str, key: str) -> Node | None:
        return self.formula(entry[name], f"{key}.{name}") if entry.get(name) is not None else None

    def unit(self, text: Any, key: str) -> Dimension:
        try:
            return dimension(str(text))
        except UnitError as error:
            raise self.error(key, str(error)) from None

    def check(self, node: Node, symbols: Mapping[str, Dimension], expected: Dimension, key: str) -> None:
        try:
            check_formula(node, symbols, expected)
        except ExpressionError as error:
            raise self.error(key, str(error)) from None


def definition_order(definitions: Mapping[str, Node]) -> list[str]:
    """Definitions so that each comes after those it uses; raises ValueError naming a circle."""
    order: list[str] = []
    path: list[str] = []

    def visit(name: str) -> None:
        if name in path:
            raise ValueError(" → ".join([*path[path.index(name) :], name]))
        if name in order:
            return
        path.append(name)
        for used in sorted(expressions.names(definitions[name]) & definitions.keys()):
            visit(used)
        path.pop()
        order.append(name)

    for name in definitions:
        visit(name)
    return order


def check_structure(structure: Structure, reader: Reader) -> None:
    """Refuse what does not fit together: names twice, circles, units, formulas with unknown names."""
    groups = ("parameters", "inputs", "flags", "states", "definitions", "memories")
    seen: dict[str, str] = dict.fromkeys(structure.events, "events")
    for group in groups:
        for name in getattr(structure, group):
            if name in seen:
                raise reader.error(f"{group}.{name}", f"the name is taken already under {seen[name]}")
            seen[name] = group
    for name in structure.states:
        if name not in structure.rates:
            raise reader.error("equations", f"no equation gives the rate of state {name}")
    try:
        definition_order({name: item.value for name, item in structure.definitions.items()})
    except ValueError as error:
        raise reader.error("definitions", f"refer to each other in a circle: {error}") from None
    _check_units(structure, reader)


class _Notes(Reader):
    """Notes which formulas fit their place only if a number in them has a unit."""

    def __init__(self) -> None:
        super().__init__({}, "")
        self.found: list[str] = []

    def check(self, node: Node, symbols: Mapping[str, Dimension], expected: Dimension, key: str) -> None:
        try:
            check_unit(node, symbols, expected)
        except ExpressionError as error:
            self.found.append(f"{key}: {error.reason}")


def bare_numbers(structure: Structure) -> tuple[str, ...]:
    """Where a sound structure's formulas have numbers whose units nothing states, and what does not fit without."""
    notes = _Notes()
    _check_units(structure, notes)
    return tuple(notes.found)


def _check_units(structure: Structure, reader: Reader) -> None:
    symbols = structure.units()
    second = dimension("s")
    for name, definition in structure.definitions.items():
        _no_rate(definition.value, f"definitions.{name}.value", reader)
        reader.check(definition.value, symbols, dimension(definition.unit), f"definitions.{name}.value")
    for name, rate in structure.rates.items():
        _no_rate(rate, f"the rate of {name}", reader)
        reader.check(rate, symbols, times(symbols[name], second, INVERSE), f"equations: rate of {name}")
    for name, flag in structure.flags.items():
        reader.check(flag, symbols, BOOLEAN, f"flags.{name}.when")
    start = {name: dimension(item.unit) for name, item in structure.parameters.items()}
    start |= {name: dimension(item.unit) for name, item in structure.known.items()}
    start |= {name: dimension(item.unit) for name, item in structure.definitions.items()}
    for name, state in structure.states.items():
        if not isinstance(state.initial, str) and not is_number(state.initial):
            reader.check(state.initial, start, symbols[name], f"states.{name}.initial")
    for name, memory in structure.memories.items():
        if not is_number(memory.initial):
            reader.check(memory.initial, start, symbols[name], f"memories.{name}.initial")
        for key, limit in (("lower", memory.lower), ("upper", memory.upper)):
            if limit is not None:
                reader.check(limit, symbols, symbols[name], f"memories.{name}.{key}")
    _check_balances(structure, reader, symbols)
    for channel, value in structure.outputs.items():
        try:
            expected = dimension(channel_unit(channel))
        except UnitError as error:
            raise reader.error(f"outputs.{channel}", str(error)) from None
        reader.check(value, symbols, expected, f"outputs.{channel}.value")


def _check_balances(structure: Structure, reader: Reader, symbols: Mapping[str, Dimension]) -> None:
    second = dimension("s")
    for name, balance in structure.balances.items():
        force = dimension(balance.unit)
        for state, node in balance.per_force.items():
            rate = times(symbols[state], second, INVERSE)
            reader.check(node, symbols, times(rate, force, INVERSE), f"{name}.per_force ({state})")
        for key, place in (("velocity", balance.velocity), ("position", balance.position)):
            if place is not None:
                _known(place, symbols, f"{name}.{key}", reader)
        if balance.load is not None:
            reader.check(balance.load, symbols, force, f"{name}.load")
    for friction in structure.friction:
        force = dimension(structure.balances[friction.balance].unit)
        reader.check(friction.forward, symbols, force, f"friction.{friction.balance}.forward")
        reader.check(friction.backward, symbols, force, f"friction.{friction.balance}.backward")


def _known(node: Node, symbols: Mapping[str, Dimension], key: str, reader: Reader) -> None:
    for name in sorted(expressions.names(node)):
        if name not in symbols:
            raise reader.error(key, f"{name!r} is not known here (known: {', '.join(sorted(symbols))})")


def _no_rate(node: Node, key: str, reader: Reader) -> None:
    for item in expressions.walk(node):
        if isinstance(item, Op) and item.op == "rate":
            raise reader.error(key, "rate(…) may stand in outputs only")


def is_number(node: Node) -> bool:
    """Whether an initial value is a plain number, which then is in the unit of what it starts."""
    return isinstance(node, Num) or (
        isinstance(node, Op) and node.op == "neg" and isinstance(node.args[0], Num)
    )
