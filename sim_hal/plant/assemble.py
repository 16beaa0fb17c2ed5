"""From a composed model to the program that the engine runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sim_hal.plant import expressions
from sim_hal.plant.compose import Element, Model
from sim_hal.plant.expressions import ExpressionError, Name, Node, Num, Op
from sim_hal.plant.program import Builder, Ints, Layout, Program, Section, margin
from sim_hal.plant.structure import PlantError, State

_START = "t_start"


@dataclass(frozen=True)
class Assembled:
    """A program and where in its registers things are that Python fills in or reads before a run.

    parameters: symbols of the parameter block, in order (the last is the start time).
    initial, memory_initial, delays: registers of values that depend on parameters alone.
    """

    program: Program
    parameters: tuple[str, ...]
    flags: tuple[str, ...]
    initial: Mapping[str, int]
    memory_initial: tuple[int, ...]
    delays: Mapping[str, int]


def assemble(model: Model, outputs: Mapping[str, Node], source: str) -> Assembled:
    """Build the program; `outputs` are the formulas to give at the samples. Raises `PlantError`."""
    builder = Builder()
    builder.definitions = {**model.definitions, "elapsed": Op("-", (Name("t"), Name(_START)))}
    flags = (*model.structure.flags, *model.structure.events)
    own = (*model.structure.parameters, *(name for name in model.parameters if "." in name))
    parameters = (*dict.fromkeys(own), *model.structure.known, _START)
    layout = _reserve(builder, model, parameters, flags)
    try:
        program, memory_initial = _program(builder, model, layout, outputs)
        initial = {
            name: builder.emit(state.initial, Section.STATIC)
            for name, state in model.states.items()
            if not isinstance(state.initial, str)
        }
        delays = {channel: builder.emit(node, Section.STATIC) for channel, node in model.delays.items()}
    except ExpressionError as error:
        raise PlantError(f"{source}: {error}") from None
    _require_static(builder, source, {**initial, **delays})
    code, sections = builder.code()
    program = program._replace(code=code, sections=sections, registers=builder.registers())
    return Assembled(program, parameters, flags, initial, memory_initial, delays)


def _reserve(builder: Builder, model: Model, parameters: tuple[str, ...], flags: tuple[str, ...]) -> Layout:
    """Registers of all leaves. Time must be the first: the engine's `since` reads register 0."""
    time = builder.block(["t"], Section.DYNAMIC)
    parameter = builder.block(parameters, Section.STATIC)
    inputs = builder.block(tuple(model.structure.inputs), Section.DYNAMIC)
    flag = builder.block(flags, Section.DYNAMIC)
    times = [builder.anonymous(Section.DYNAMIC) for _ in flags]
    state = builder.block(tuple(model.states), Section.DYNAMIC)
    memory = [builder.anonymous(Section.DYNAMIC) for _ in model.memories]
    rates = [builder.anonymous(Section.OUTPUT) for _ in model.states]
    builder.flag_of = {name: (flag + n, times[n]) for n, name in enumerate(flags)}
    builder.rate_of = dict(zip(model.states, rates, strict=True))
    for name, register in zip(model.memories, memory, strict=True):
        builder.symbols[_stored(name)] = register
    spare = builder.anonymous(Section.STATIC)  # a block may be empty: its start must still be a register
    return Layout(
        time=time,
        parameter=parameter,
        input=inputs,
        flag=flag,
        flag_time=times[0] if times else spare,
        state=state,
        memory=memory[0] if memory else spare,
        rate=rates[0] if rates else spare,
    )


def _stored(memory: str) -> str:
    return f"stored({memory})"


def _program(
    builder: Builder, model: Model, layout: Layout, outputs: Mapping[str, Node]
) -> tuple[Program, tuple[int, ...]]:
    """Emit everything, section by section, so that an earlier section never needs a later one."""
    states = tuple(model.states)
    limits = _memories(builder, model, states)
    rates = _registers(builder, [model.rates[name] for name in states])
    elements = [_element(builder, element, model, states) for element in model.elements]
    conditions = [builder.emit(margin(flag), Section.CONDITION) for flag in model.structure.flags.values()]
    conditions += [-1] * len(model.structure.events)
    output_registers = [builder.emit(node, Section.OUTPUT) for node in outputs.values()]
    ns, m, q = len(states), len(elements), len(model.memories)
    columns = list(zip(*elements, strict=True)) or [()] * 5
    program = Program(
        code=np.empty((0, 5), np.int64),
        sections=np.zeros(5, np.int64),
        registers=np.empty(0),
        layout=layout,
        rates=rates,
        velocity=_table(columns[0], (m, ns)),
        velocity_offset=_table(columns[1], (m,)),
        per_force=_table(columns[2], (m, ns)),
        forward=_table(columns[3], (m,)),
        backward=_table(columns[4], (m,)),
        lower=_table([limit[0] for limit in limits], (q,)),
        upper=_table([limit[1] for limit in limits], (q,)),
        lower_slope=_table([limit[2] for limit in limits], (q, ns)),
        upper_slope=_table([limit[3] for limit in limits], (q, ns)),
        conditions=_table(conditions, (len(conditions),)),
        outputs=_table(output_registers, (len(output_registers),)),
    )
    initial = [builder.emit(memory.initial, Section.STATIC) for memory in model.memories.values()]
    return program, tuple(initial)


def _table(rows: object, shape: tuple[int, ...]) -> Ints:
    return np.array(rows, dtype=np.int64).reshape(shape)


def _registers(builder: Builder, nodes: list[Node]) -> Ints:
    return np.array([builder.emit(node, Section.DYNAMIC) for node in nodes], dtype=np.int64)


def _memories(
    builder: Builder, model: Model, states: tuple[str, ...]
) -> list[tuple[int, int, list[int], list[int]]]:
    """For each memory its limits and their slopes; the symbol becomes the clipped value."""
    found = []
    for name, memory in model.memories.items():
        lower = builder.emit(memory.lower, Section.DYNAMIC)
        stored: Node = Op("max", (Name(_stored(name)), memory.lower))
        slopes = _slopes(builder, memory.lower, model, states)
        if memory.upper is None:
            upper, upper_slopes = builder.constant(np.inf), [builder.constant(0.0)] * len(states)
        else:
            upper = builder.emit(memory.upper, Section.DYNAMIC)
            upper_slopes = _slopes(builder, memory.upper, model, states)
            stored = Op("min", (stored, memory.upper))
        builder.symbols[name] = builder.emit(stored, Section.DYNAMIC)
        found.append((lower, upper, slopes, upper_slopes))
    return found


def _element(
    builder: Builder, element: Element, model: Model, states: tuple[str, ...]
) -> tuple[list[int], int, list[int], int, int]:
    coefficients, offset = _linear(element.velocity, model)
    velocity = [builder.emit(coefficients.get(name, Num(0.0)), Section.STATIC) for name in states]
    constant = builder.emit(offset, Section.STATIC)
    per_force = [builder.emit(element.per_force.get(name, Num(0.0)), Section.DYNAMIC) for name in states]
    forward = builder.emit(element.forward, Section.DYNAMIC)
    backward = builder.emit(element.backward, Section.DYNAMIC)
    return velocity, constant, per_force, forward, backward


def _slopes(builder: Builder, node: Node, model: Model, states: tuple[str, ...]) -> list[int]:
    coefficients, _ = _linear(node, model)
    return [builder.emit(coefficients.get(name, Num(0.0)), Section.STATIC) for name in states]


def _linear(node: Node, model: Model) -> tuple[dict[str, Node], Node]:
    """Coefficients of an expression linear in the states, with coefficients of parameters alone."""

    def open_up(name: str) -> Node:
        found = model.definitions.get(name)
        return Name(name) if found is None else expressions.rename(found, open_up)

    opened = expressions.rename(node, open_up)
    coefficients, offset = expressions.linear_in(opened, frozenset(model.states))
    fixed = set(model.structure.parameters) | set(model.parameters)
    for part in (*coefficients.values(), offset):
        if expressions.names(part) - fixed:
            raise ExpressionError(
                "must be linear in the states, with parameters only", expressions.to_text(node), 0
            )
    return coefficients, offset


def _require_static(builder: Builder, source: str, registers: Mapping[str, int]) -> None:
    for name, register in registers.items():
        if not builder.is_static(register):
            raise PlantError(
                f"{source}: initial value of {name}: may use parameters and known quantities only"
            )


def fitted(states: Mapping[str, State]) -> tuple[str, ...]:
    """States whose initial value is to be fitted."""
    return tuple(name for name, state in states.items() if isinstance(state.initial, str))
