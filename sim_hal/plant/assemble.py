"""From a composed model to the program that the engine runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sim_hal.plant import expressions
from sim_hal.plant.compose import Element, Model
from sim_hal.plant.expressions import ExpressionError, Name, Node, Num, Op
from sim_hal.plant.program import Builder, Ints, Layout, Program, Section, margin
from sim_hal.plant.structure import PlantError, State
from sim_hal.plant.tangents import Follower, tangents

_START = "t_start"


@dataclass(frozen=True)
class Assembled:
    """A program and where in its registers things are that Python fills in or reads before a run.

    parameters: symbols of the parameter block, in order (the last is the start time).
    initial, memory_initial, delays, skews: registers of values that depend on parameters alone. settled: registers of
    what states start at that other states tell. kinks: formulas watched.
    """

    program: Program
    parameters: tuple[str, ...]
    flags: tuple[str, ...]
    initial: Mapping[str, int]
    memory_initial: tuple[int, ...]
    delays: Mapping[str, int]
    skews: Mapping[str, int]
    settled: Mapping[str, int]
    kinks: tuple[Node, ...]


def assemble(model: Model, outputs: Mapping[str, Node], source: str) -> Assembled:
    """Build the program; `outputs` are the formulas to give at the samples. Raises `PlantError`."""
    builder = Builder()
    builder.definitions = {**model.definitions, "elapsed": Op("-", (Name("t"), Name(_START)))}
    flags = (*model.structure.flags, *model.structure.events)
    own = (*model.structure.parameters, *(name for name in model.parameters if "." in name))
    parameters = (*dict.fromkeys(own), *model.structure.known, _START)
    layout = _reserve(builder, model, parameters, flags)
    try:
        layout, table, kinks = _emit(builder, model, layout, outputs)
        initial = {
            name: builder.emit(state.initial, Section.STATIC)
            for name, state in model.states.items()
            if not isinstance(state.initial, str)
        }
        memories = [builder.emit(memory.initial, Section.STATIC) for memory in model.memories.values()]
        delays, skews = (
            {channel: builder.emit(node, Section.STATIC) for channel, node in late.items()}
            for late in (model.delays, model.skews)
        )
        settled = {
            name: builder.emit(settled.start, Section.DYNAMIC, watch=False)
            for name, settled in model.settled.items()
        }
    except ExpressionError as error:
        raise PlantError(f"{source}: {error}") from None
    _require_static(
        builder, source, initial | delays | skews | dict(zip(model.memories, memories, strict=True))
    )
    read_by_python = (*initial.values(), *memories, *delays.values(), *skews.values(), *settled.values())
    code, ends = builder.code((*table[len(layout) :].tolist(), *read_by_python))
    layout = layout._replace(
        modal=ends[0], dynamic=ends[1], derivative=ends[2], condition=ends[3], output=ends[4], end=ends[5]
    )
    table[: len(layout)] = layout
    program = Program(code, table, builder.registers(), layout)
    return Assembled(program, parameters, flags, initial, tuple(memories), delays, skews, settled, kinks)


def _reserve(builder: Builder, model: Model, parameters: tuple[str, ...], flags: tuple[str, ...]) -> Layout:
    """Registers of all leaves. Time must be the first: the engine's `since` reads register 0."""
    inputs, states, dynamic = tuple(model.structure.inputs), tuple(model.states), Section.DYNAMIC
    nu, nf = len(inputs), len(flags)
    layout = Layout(
        ns=len(states),
        nu=nu,
        nf=nf,
        m=len(model.elements),
        q=len(model.memories),
        time=builder.block(["t"], dynamic),
        parameter=builder.block(parameters, Section.STATIC),
        input=builder.block(inputs, dynamic),
        start_value=builder.room(nu, dynamic),
        slope=builder.room(nu, dynamic),
        segment=builder.room(1, dynamic),
        flag=builder.block(flags, Section.MODAL),
        flag_time=builder.room(nf, dynamic),
        state=builder.block(states, dynamic),
        memory=builder.block([_stored(name) for name in model.memories], dynamic),
        at_lower=builder.room(len(model.memories), Section.MODAL),
        at_upper=builder.room(len(model.memories), Section.MODAL),
        rate=builder.room(len(states), Section.CONDITION),
        force=builder.room(len(model.elements), dynamic),
    )
    builder.flag_of = {name: (layout.flag + n, layout.flag_time + n) for n, name in enumerate(flags)}
    builder.rate_of = {name: layout.rate + n for n, name in enumerate(states)}
    return layout


def _stored(memory: str) -> str:
    return f"stored({memory})"


def _emit(
    builder: Builder, model: Model, layout: Layout, outputs: Mapping[str, Node]
) -> tuple[Layout, Ints, tuple[Node, ...]]:
    """Emit everything, section by section, so that an earlier section never needs a later one."""
    states = tuple(model.states)
    limits = _columns([*_memories(builder, model, states)], 4)
    rates = [builder.emit(model.rates[name], Section.DYNAMIC) for name in states]
    elements = _columns([_element(builder, element, model, states) for element in model.elements], 5)
    followers = _followers(builder, model, layout, limits)
    slopes = _derivatives(builder, layout, followers, [*rates, *elements[3], *elements[4]])
    watches, kinks = builder.watches()
    conditions = [builder.emit(margin(flag), Section.CONDITION) for flag in model.structure.flags.values()]
    trends = _trends(builder, layout, followers, [*watches, *conditions])
    zero = builder.constant(0.0)
    by = range(len(states) + 1)
    lists = {
        "rates": rates,
        "jacobian": [slopes[direction].get(rate, zero) for rate in rates for direction in by],
        "forward_slope": [slopes[direction].get(level, zero) for level in elements[3] for direction in by],
        "backward_slope": [slopes[direction].get(level, zero) for level in elements[4] for direction in by],
        **dict(
            zip(("velocity", "velocity_offset", "per_force", "forward", "backward"), elements, strict=True)
        ),
        **dict(zip(("lower", "upper", "lower_slope", "upper_slope"), limits, strict=True)),
        "conditions": conditions + [-1] * len(model.structure.events),
        "watches": watches,
        "trends": trends + [zero] * len(model.structure.events),
        "outputs": [builder.emit(node, Section.OUTPUT) for node in outputs.values()],
    }
    starts = np.cumsum([len(layout), *(len(entries) for entries in lists.values())]).tolist()
    places = [entry for entries in lists.values() for entry in entries]
    table = np.array([*layout, *places], dtype=np.int64)
    layout = layout._replace(nw=len(watches), **dict(zip(lists, starts[:-1], strict=True)))
    return layout, table, tuple(kinks)


def _followers(
    builder: Builder, model: Model, layout: Layout, limits: list[list[int]]
) -> dict[int, Follower]:
    """What each memory follows, by the register of its value."""
    lower, upper = limits[:2]
    return {
        builder.symbols[name]: Follower(layout.at_lower + q, layout.at_upper + q, lower[q], upper[q])
        for q, name in enumerate(model.memories)
    }


def _clock(builder: Builder, layout: Layout) -> dict[int, int]:
    """Tangents of time and, along their slopes, of the inputs."""
    return {layout.time: builder.constant(1.0)} | {
        layout.input + k: layout.slope + k for k in range(layout.nu)
    }


def _derivatives(
    builder: Builder, layout: Layout, followers: dict[int, Follower], wanted: list[int]
) -> list[dict[int, int]]:
    """Tangents of dynamic registers by each state and, last, by time."""
    one = builder.constant(1.0)
    seeds = [{layout.state + s: one} for s in range(layout.ns)]
    return [
        tangents(builder, seed, followers, wanted, Section.JACOBIAN)
        for seed in (*seeds, _clock(builder, layout))
    ]


def _trends(
    builder: Builder, layout: Layout, followers: dict[int, Follower], watched: list[int]
) -> list[int]:
    """Registers of the rates of watched registers along the solution, the rates of the states being given."""
    seeds = _clock(builder, layout) | {layout.state + s: layout.rate + s for s in range(layout.ns)}
    found = tangents(builder, seeds, followers, watched, Section.CONDITION)
    return [found.get(register, builder.constant(0.0)) for register in watched]


def _columns(rows: Sequence[tuple[int | list[int], ...]], count: int) -> list[list[int]]:
    """The rows' columns, each flattened into one list of registers."""
    columns: list[list[int]] = [[] for _ in range(count)]
    for row in rows:
        for column, entry in zip(columns, row, strict=True):
            column.extend(entry if isinstance(entry, list) else [entry])
    return columns


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
        builder.symbols[name] = builder.emit(stored, Section.DYNAMIC, watch=False)
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
