"""Reading a plant's structure from YAML: a built-in kind (config/kinds) or a plant file of `kind: equations`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any

from hal.config import config_root, read_yaml
from sim_hal.plant.between import INTERPOLATIONS
from sim_hal.plant.expressions import ExpressionError, Name, Node, Num
from sim_hal.plant.structure import (
    FIT,
    Balance,
    Definition,
    Friction,
    Input,
    Known,
    Memory,
    PlantError,
    Quantity,
    Reader,
    State,
    Structure,
    check_structure,
    unit_text,
)
from sim_hal.plant.structure_entries import (
    BalanceEntry,
    DefinitionEntry,
    EquationEntry,
    FlagEntry,
    FrictionEntry,
    MemoryEntry,
    OutputEntry,
    PlaceEntry,
    StateEntry,
)
from sim_hal.plant.units import INVERSE, Dimension, dimension, sound_unit_of, times


def read_structure(
    data: Mapping[str, Any],
    source: str,
    parameters: Mapping[str, Quantity],
    surface_parameters: tuple[str, ...] = (),
) -> Structure:
    """Build and check the structure in `data`; raises `PlantError`."""
    reader = Reader(data, source)
    for name, quantity in parameters.items():
        reader.check_name(f"parameters.{name}", name)
        reader.unit(quantity.unit, f"parameters.{name}.unit")
    channels = reader.entries("outputs")
    structure = Structure(
        parameters=parameters,
        known=_read(reader, "known", Known),
        inputs=_read_inputs(reader),
        events=_read_events(reader),
        flags=_formulas(reader, "flags", FlagEntry, "when"),
        states={
            key: _state(reader, key, entry, channels)
            for key, entry in _read(reader, "states", StateEntry).items()
        },
        definitions={
            key: _definition(reader, key, entry)
            for key, entry in _read(reader, "definitions", DefinitionEntry).items()
        },
        memories={
            key: _memory(reader, key, entry) for key, entry in _read(reader, "memories", MemoryEntry).items()
        },
        outputs=_formulas(reader, "outputs", OutputEntry, "value"),
        surface_parameters=surface_parameters,
    )
    structure = _with_first_samples(structure, reader)
    equations = _read(reader, "equations", EquationEntry)
    structure = replace(structure, rates=_rates(reader, structure, equations))
    structure = replace(structure, balances=_balances(reader, structure, equations))
    structure = replace(structure, friction=_friction(reader, structure))
    check_structure(structure, reader)
    return structure


def _read(reader: Reader, key: str, cls: type[Any]) -> dict[str, Any]:
    found = {}
    for name, value in reader.entries(key).items():
        entry = reader.settings(value, cls, f"{key}.{name}")
        if hasattr(entry, "unit"):
            reader.unit(entry.unit, f"{key}.{name}.unit")
        found[name] = entry
    return found


def _formulas(reader: Reader, key: str, cls: type[Any], field: str) -> dict[str, Node]:
    """Entries that hold nothing but one formula, under `field`."""
    return {
        name: reader.formula(getattr(entry, field), f"{key}.{name}.{field}")
        for name, entry in _read(reader, key, cls).items()
    }


def _read_inputs(reader: Reader) -> dict[str, Input]:
    """Inputs: `NAME: unit`, or `NAME: {unit: …, interpolation: …}`."""
    found = {}
    for name, value in reader.entries("inputs").items():
        entry = Input(value) if isinstance(value, str) else reader.settings(value, Input, f"inputs.{name}")
        reader.unit(entry.unit, f"inputs.{name}.unit")
        if entry.interpolation not in INTERPOLATIONS:
            reason = (
                f"{entry.interpolation!r} must be {', '.join(INTERPOLATIONS[:-1])} or {INTERPOLATIONS[-1]}"
            )
            raise reader.error(f"inputs.{name}.interpolation", reason)
        found[name] = entry
    return found


def _read_events(reader: Reader) -> tuple[str, ...]:
    events = reader.data.get("events", [])
    if not isinstance(events, list):
        raise reader.error("events", f"{events!r} must be a list of names")
    for name in events:
        reader.check_name("events", name)
    return tuple(events)


def _state(reader: Reader, key: str, entry: StateEntry, channels: Mapping[str, Any]) -> State:
    if entry.initial == FIT:
        return State(entry.unit, FIT)
    initial = reader.formula(entry.initial, f"states.{key}.initial")
    if isinstance(initial, Name) and initial.id not in reader.entries("known"):
        if initial.id in channels:
            return State(entry.unit, Name(first_sample(initial.id)))
        _start_of_something(reader, f"states.{key}.initial", initial.id, channels)
    return State(entry.unit, initial)


def _start_of_something(reader: Reader, key: str, name: str, channels: Mapping[str, Any]) -> None:
    """Refuse a start that is one name, if it stands for nothing that could give one."""
    quantities = [name for group in ("parameters", "known", "definitions") for name in reader.entries(group)]
    quantities += [name for surface in reader.entries("surfaces").values() for name in surface]
    if name not in (*quantities, "pi"):
        known = ", ".join([FIT, *channels, *quantities])
        raise reader.error(key, f"{name!r} is no start; known: a number, {known}, or a formula of parameters")


def first_sample(channel: str) -> str:
    """The symbol that stands for a channel's smoothed first value."""
    return f"first({channel})"


def _with_first_samples(structure: Structure, reader: Reader) -> Structure:
    """Make the first samples that initial values use known quantities with their state's unit."""
    known = dict(structure.known)
    for name, state in structure.states.items():
        if isinstance(state.initial, Name) and state.initial.id.startswith("first("):
            known[state.initial.id] = Known(structure.states[name].unit)
    return replace(structure, known=known)


def _definition(reader: Reader, key: str, entry: DefinitionEntry) -> Definition:
    return Definition(reader.formula(entry.value, f"definitions.{key}.value"), entry.unit, entry.port)


def _memory(reader: Reader, key: str, entry: MemoryEntry) -> Memory:
    place = f"memories.{key}"
    upper = None if entry.upper is None else reader.formula(entry.upper, f"{place}.upper")
    lower = reader.formula(entry.lower, f"{place}.lower")
    return Memory(entry.unit, lower, upper, reader.formula(entry.initial, f"{place}.initial"))


def _rates(reader: Reader, structure: Structure, equations: Mapping[str, EquationEntry]) -> dict[str, Node]:
    rates: dict[str, Node] = {}
    for name, entry in equations.items():
        if entry.state not in structure.states:
            raise reader.error(f"equations.{name}.state", f"{entry.state!r} is not a state")
        if entry.state in rates:
            raise reader.error(f"equations.{name}.state", f"{entry.state} has a rate already")
        rates[entry.state] = reader.formula(entry.rate, f"equations.{name}.rate")
    return {state: rates[state] for state in structure.states if state in rates}


def _balances(
    reader: Reader, structure: Structure, equations: Mapping[str, EquationEntry]
) -> dict[str, Balance]:
    found: dict[str, Balance] = {}
    for name, entry in equations.items():
        if entry.balance:
            if entry.per_force is None:
                raise reader.error(f"equations.{name}", "a balance needs per_force")
            per_force = {entry.state: reader.formula(entry.per_force, f"equations.{name}.per_force")}
            found[name] = _place(reader, structure, f"equations.{name}", name, name, entry, per_force)
        else:
            _needs_balance(reader, name, entry)
    for name, between in _read(reader, "balances", BalanceEntry).items():
        key = f"balances.{name}"
        if not isinstance(between.per_force, dict) or not between.per_force.keys() <= structure.states.keys():
            raise reader.error(
                f"{key}.per_force", "must give, for each state that the force acts on, a formula"
            )
        per_force = {
            state: reader.formula(value, f"{key}.per_force.{state}")
            for state, value in between.per_force.items()
        }
        found[name] = _place(reader, structure, key, name, between.equation or name, between, per_force)
    for name, definition in _read(reader, "definitions", DefinitionEntry).items():
        if definition.equation is not None:
            key = f"definitions.{name}"
            found[definition.equation] = replace(
                _place(reader, structure, key, definition.equation, definition.equation, definition, {}),
                unit=definition.unit,
                port=name,
            )
    return found


def _needs_balance(reader: Reader, name: str, entry: EquationEntry) -> None:
    """Refuse an equation that says what a missing force would do in it, and not whether one may be missing."""
    if entry.per_force is not None and "balance" not in reader.entries("equations")[name]:
        raise reader.error(f"equations.{name}.per_force", "stands there without balance: true")


def _place(
    reader: Reader,
    structure: Structure,
    key: str,
    name: str,
    equation: str,
    entry: PlaceEntry,
    per_force: Mapping[str, Node],
) -> Balance:
    """A balance, its force's unit found from the first rate that the force enters."""
    symbols = structure.units()
    unit = ""
    for state, node in per_force.items():
        if node == Num(0.0):
            raise reader.error(f"{key}.per_force", f"is 0 for {state}: no force would act on it")
        try:
            found = sound_unit_of(node, symbols) or ()
        except ExpressionError as error:
            raise reader.error(f"{key}.per_force", str(error)) from None
        unit = unit or unit_text(_force(symbols[state], found))
    fields = vars(entry)
    velocity = reader.optional(fields, "velocity", key)
    if velocity is None and len(per_force) == 1:
        velocity = Name(next(iter(per_force)))
    position = reader.optional(fields, "position", key)
    return Balance(name, equation, unit, per_force, velocity, position, reader.optional(fields, "load", key))


def _force(state: Dimension, per_force: Dimension) -> Dimension:
    return times(times(state, dimension("s"), INVERSE), per_force, INVERSE)


def _friction(reader: Reader, structure: Structure) -> tuple[Friction, ...]:
    found = []
    for name, entry in _read(reader, "friction", FrictionEntry).items():
        if name not in structure.balances or structure.balances[name].velocity is None:
            raise reader.error(f"friction.{name}", "names no balance that has a velocity")
        forward = reader.formula(entry.forward, f"friction.{name}.forward")
        backward = reader.formula(entry.backward, f"friction.{name}.backward")
        found.append(Friction(name, forward, backward))
    return tuple(found)


def check_kind(kind: str, source: str) -> None:
    """Raise `PlantError` for a kind of plant that is not known; `source` names the file that says it."""
    kinds = ["equations", *sorted(item.stem for item in (config_root() / "kinds").glob("*.yaml"))]
    if kind not in kinds:
        raise PlantError(f"{source}: kind = {kind!r} is not known; known here: {', '.join(kinds)}")


@lru_cache(maxsize=16)
def load_kind(kind: str, geometry: str) -> Structure:
    """Structure of a built-in kind in one of its geometries; raises `PlantError` for an unknown one."""
    check_kind(kind, kind)
    path = config_root() / "kinds" / f"{kind}.yaml"
    data = dict(read_yaml(path))
    variants = data.pop("geometry", {"vertical": {}})
    if geometry not in variants:
        raise PlantError(
            f"geometry = {geometry!r} is not known for kind {kind}; known: {', '.join(variants)}"
        )
    for key, changes in variants[geometry].items():
        data[key] = data.get(key, {}) | changes
    reader = Reader(data, str(path))
    parameters = _read(reader, "parameters", Quantity)
    return read_structure(data, str(path), parameters, tuple(data.get("surface_parameters", ())))
