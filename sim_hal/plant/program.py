"""From formulas to a flat program for a register machine.

Each distinct subexpression is computed once and has its own register. What depends on parameters alone runs
once per run (section STATIC), on flags too once an event (MODAL), what the rates need at every evaluation (DYNAMIC),
their derivatives once a step (JACOBIAN), what only locating events needs (CONDITION) and what only the outputs need
(OUTPUT) when those are asked for.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_hal.plant.expressions import Name, Node, Num, Op
from sim_hal.plant.fuse import FUSED, WIDTH, shortened

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Section(IntEnum):
    """When a piece of the program runs."""

    STATIC = 0
    MODAL = 1
    DYNAMIC = 2
    JACOBIAN = 3
    CONDITION = 4
    OUTPUT = 5


_ARITHMETIC = (
    "+",
    "-",
    "*",
    "/",
    "**",
    "neg",
    "abs",
    "sign",
    "sqrt",
    "exp",
    "log",
    "sin",
    "cos",
    "tan",
    "tanh",
)
_CHOICES = ("min", "max", "where", "<", "<=", ">", ">=", "and", "or", "not", "since", "square")

#: Operation codes of the machine; `engine.machine` executes them.
OPCODES: Mapping[str, int] = {name: code for code, name in enumerate((*_ARITHMETIC, *_CHOICES, *FUSED))}

#: Functions of a kink where their arguments meet (or theirs meets 0).
KINKS = ("min", "max", "abs", "<", "<=", ">", ">=")


class Layout(NamedTuple):
    """Sizes; first register of each block; where each list starts in the table; where each section starts.

    The table begins with these numbers themselves, in this order: the engine finds them there.
    """

    ns: int  # states
    nu: int  # inputs
    nf: int  # flags and events
    m: int  # friction elements
    q: int  # memories
    nw: int = 0  # kinks to watch
    time: int = 0  # registers from here on
    parameter: int = 0
    input: int = 0
    start_value: int = 0  # inputs at the segment's start, and their slope
    slope: int = 0
    segment: int = 0  # time of the segment's start
    flag: int = 0
    flag_time: int = 0
    state: int = 0
    memory: int = 0
    at_lower: int = 0  # of each memory: whether it follows its lower limit, and the same for the upper
    at_upper: int = 0
    rate: int = 0
    force: int = 0
    rates: int = 0  # table from here on: (ns,)
    jacobian: int = 0  # (ns, ns + 1): derivatives of the rates by each state and, last, by time
    velocity: int = 0  # (m, ns): coefficients of the relative velocity
    velocity_offset: int = 0  # (m,)
    per_force: int = 0  # (m, ns)
    forward: int = 0  # (m,)
    backward: int = 0  # (m,)
    forward_slope: int = 0  # (m, ns + 1): derivatives as above
    backward_slope: int = 0  # (m, ns + 1)
    lower: int = 0  # (q,)
    upper: int = 0  # (q,)
    lower_slope: int = 0  # (q, ns): coefficients of the lower limit
    upper_slope: int = 0  # (q, ns)
    conditions: int = 0  # (nf,), −1 for an event, which latches at a given time
    watches: int = 0  # (nw,): what changes sign at a kink of the rates
    trends: int = 0  # (nw + nf,): rates of these and of the flags' conditions along the solution
    outputs: int = 0  # (no,)
    modal: int = 0  # instructions from here on; the static section begins at 0
    dynamic: int = 0
    derivative: int = 0
    condition: int = 0
    output: int = 0
    end: int = 0


class Program(NamedTuple):
    """All that the engine needs to know of a plant."""

    code: Ints  # (instructions, WIDTH): operation, target, operands
    table: Ints  # the layout, then registers in lists that it tells apart
    registers: Floats  # initial content: the constants
    layout: Layout


class Builder:
    """Collects instructions; equal subexpressions get the same register."""

    def __init__(self) -> None:
        self.symbols: dict[str, int] = {}
        self.flag_of: dict[str, tuple[int, int]] = {}
        self.rate_of: dict[str, int] = {}
        self.definitions: Mapping[str, Node] = {}
        self._constants: dict[float, int] = {}
        self._section: dict[int, Section] = {}
        self._memo: dict[tuple[str, tuple[int, ...], bool], int] = {}
        self._code: dict[Section, list[tuple[int, ...]]] = {section: [] for section in Section}
        self._size = 0
        self._kinks: dict[tuple[int, ...], Node] = {}

    def block(self, symbols: Sequence[str], section: Section) -> int:
        """Reserve registers for leaf symbols; returns the first."""
        first = self.room(len(symbols), section)
        self.symbols |= {name: first + offset for offset, name in enumerate(symbols)}
        return first

    def room(self, count: int, section: Section) -> int:
        """Reserve registers without symbols; returns the first."""
        first = self._size
        for _ in range(count):
            self.anonymous(section)
        return first

    def anonymous(self, section: Section) -> int:
        """Reserve one register whose value is available from `section` on."""
        self._section[self._size] = section
        self._size += 1
        return self._size - 1

    def constant(self, value: float) -> int:
        if value not in self._constants:
            self._constants[value] = self.anonymous(Section.STATIC)
        return self._constants[value]

    def emit(
        self, node: Node, section: Section, watch: bool = True, beside: frozenset[Node] = frozenset()
    ) -> int:
        """Register that holds the node's value from `section` on; `watch` its kinks.

        `beside` are the factors of a product that the node belongs to: |x| beside x has no kink.
        """
        if isinstance(node, Num):
            return self.constant(node.value)
        if isinstance(node, Name):
            if node.id not in self.symbols:
                self.symbols[node.id] = self.emit(self.definitions[node.id], section)
            return self.symbols[node.id]
        if node.op == "rate":
            return self.rate_of[_name(node)]
        if node.op == "since":
            return self.instruction("since", self.flag_of[_name(node)], section)
        factors = _factors(node) | beside if node.op == "*" else frozenset[Node]()
        operands = tuple(self.emit(arg, section, watch, factors) for arg in node.args)
        if node.op == "**" and node.args[1] == Num(2.0):
            return self.instruction("square", operands[:1], section)
        if node.op in ("min", "max", "and", "or"):
            result = operands[0]
            for operand in operands[1:]:
                if watch:
                    self._kink(node, (result, operand), section)
                result = self.instruction(node.op, (result, operand), section)
            return result
        if watch and not (node.op == "abs" and node.args[0] in beside):
            self._kink(node, operands, section)
        return self.instruction(node.op, operands, section)

    def _kink(self, node: Op, operands: tuple[int, ...], section: Section) -> None:
        """Note where the rates have a kink: steps shall end there."""
        moving = any(self._section[operand] > Section.MODAL for operand in operands)
        if node.op in KINKS and section is Section.DYNAMIC and moving:
            self._kinks.setdefault(operands, node)

    def watches(self) -> tuple[list[int], list[Node]]:
        """Registers (from CONDITION on) that change sign where the rates have a kink, and the kinked formulas."""
        registers = [
            operands[0] if len(operands) == 1 else self.instruction("-", operands, Section.CONDITION)
            for operands in self._kinks
        ]
        return registers, list(self._kinks.values())

    def instruction(self, op: str, operands: tuple[int, ...], section: Section) -> int:
        """Register of an operation's result, available from `section` on.

        Derivatives are computed at other times than the rest of what comes after the rates: they share nothing.
        """
        if op == "-" and operands[1] == self._constants.get(0.0):
            return operands[0]
        known = max(self._section[operand] for operand in operands)
        # A time since a flag also reads the clock, so it always moves.
        own = known if known <= Section.MODAL and op != "since" else max(section, known)
        derivative = own is Section.JACOBIAN
        target = self._memo.get((op, operands, False), self._memo.get((op, operands, True)))
        if target is None or not self._is_there(target, derivative):
            target = self._memo.get((op, operands, derivative))
        if target is None:
            target = self.anonymous(own)
            self._code[own].append((OPCODES[op], target, *operands, *(0,) * (3 - len(operands))))
            self._memo[op, operands, derivative] = target
        return target

    def _is_there(self, register: int, derivative: bool) -> bool:
        section = self._section[register]
        return section <= Section.DYNAMIC or (section is Section.JACOBIAN) is derivative

    def lines(self, section: Section) -> list[tuple[int, ...]]:
        """The instructions of a section so far: operation, target, operands."""
        return list(self._code[section])

    def is_static(self, register: int) -> bool:
        """Whether the register's value depends on parameters alone."""
        return self._section[register] is Section.STATIC

    def code(self, asked: Iterable[int]) -> tuple[Ints, list[int]]:
        """All instructions, and where each section ends; `asked` are registers that are read from elsewhere."""
        sections = shortened([self._code[section] for section in Section], OPCODES, asked)
        ends = np.cumsum([len(lines) for lines in sections]).tolist()
        return np.array([line for lines in sections for line in lines], dtype=np.int64).reshape(
            -1, WIDTH
        ), ends

    def registers(self) -> Floats:
        """Initial content of the register file."""
        content = np.zeros(self._size)
        for value, register in self._constants.items():
            content[register] = value
        return content


def _factors(node: Node) -> frozenset[Node]:
    """Factors of a product, or the node itself."""
    if isinstance(node, Op) and node.op == "*":
        return frozenset[Node]().union(*(_factors(arg) for arg in node.args))
    return frozenset([node])


def _name(node: Op) -> str:
    arg = node.args[0]
    assert isinstance(arg, Name)
    return arg.id


def margin(condition: Node) -> Node:
    """A quantity that is ≥ 0 where the condition holds and crosses 0 where it changes."""
    if isinstance(condition, Op):
        match condition.op, condition.args:
            case ">=" | ">", (left, right):
                return Op("-", (left, right))
            case "<=" | "<", (left, right):
                return Op("-", (right, left))
            case "and", args:
                return Op("min", tuple(margin(arg) for arg in args))
            case "or", args:
                return Op("max", tuple(margin(arg) for arg in args))
            case "not", (arg,):
                return Op("neg", (margin(arg),))
    return Op("where", (condition, Num(1.0), Num(-1.0)))
