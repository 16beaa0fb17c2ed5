"""From formulas to a flat program for a register machine.

Each distinct subexpression is computed once and has its own register. What depends on parameters alone runs
once per run (section STATIC), what the rates need at every evaluation (DYNAMIC), what only locating events needs
(CONDITION) and what only the outputs need (OUTPUT) when those are asked for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_hal.plant.expressions import Name, Node, Num, Op

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Section(IntEnum):
    """When a piece of the program runs."""

    STATIC = 0
    DYNAMIC = 1
    CONDITION = 2
    OUTPUT = 3


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

#: Operation codes of the machine; `engine.py` executes them.
OPCODES: Mapping[str, int] = {name: code for code, name in enumerate((*_ARITHMETIC, *_CHOICES))}


class Layout(NamedTuple):
    """First register of each block of leaves."""

    time: int
    parameter: int
    input: int
    flag: int
    flag_time: int
    state: int
    memory: int
    rate: int


class Program(NamedTuple):
    """All that the engine needs to know of a plant; entries of the index arrays are registers.

    Sizes: ns states, m friction elements, q memories, nf flags, no outputs.
    """

    code: Ints  # (instructions, 5): operation, target, operands
    sections: Ints  # (5,): where each section starts, and the end
    registers: Floats  # initial content: the constants
    layout: Layout
    rates: Ints  # (ns,)
    velocity: Ints  # (m, ns): coefficients of the relative velocity
    velocity_offset: Ints  # (m,)
    per_force: Ints  # (m, ns)
    forward: Ints  # (m,)
    backward: Ints  # (m,)
    lower: Ints  # (q,)
    upper: Ints  # (q,)
    lower_slope: Ints  # (q, ns): coefficients of the lower limit
    upper_slope: Ints  # (q, ns)
    conditions: Ints  # (nf,), −1 for an event, which latches at a given time
    outputs: Ints  # (no,)


class Builder:
    """Collects instructions; equal subexpressions get the same register."""

    def __init__(self) -> None:
        self.symbols: dict[str, int] = {}
        self.flag_of: dict[str, tuple[int, int]] = {}
        self.rate_of: dict[str, int] = {}
        self.definitions: Mapping[str, Node] = {}
        self._constants: dict[float, int] = {}
        self._section: dict[int, Section] = {}
        self._memo: dict[tuple[str, tuple[int, ...]], int] = {}
        self._code: dict[Section, list[tuple[int, ...]]] = {section: [] for section in Section}
        self._size = 0

    def block(self, symbols: Sequence[str], section: Section) -> int:
        """Reserve registers for leaf symbols; returns the first."""
        first = self._size
        for name in symbols:
            self.symbols[name] = self.anonymous(section)
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

    def emit(self, node: Node, section: Section) -> int:
        """Register that holds the node's value from `section` on."""
        if isinstance(node, Num):
            return self.constant(node.value)
        if isinstance(node, Name):
            if node.id not in self.symbols:
                self.symbols[node.id] = self.emit(self.definitions[node.id], section)
            return self.symbols[node.id]
        if node.op == "rate":
            return self.rate_of[_name(node)]
        if node.op == "since":
            return self._instruction("since", self.flag_of[_name(node)], section)
        operands = tuple(self.emit(arg, section) for arg in node.args)
        if node.op == "**" and node.args[1] == Num(2.0):
            return self._instruction("square", operands[:1], section)
        if node.op in ("min", "max", "and", "or"):
            result = operands[0]
            for operand in operands[1:]:
                result = self._instruction(node.op, (result, operand), section)
            return result
        return self._instruction(node.op, operands, section)

    def _instruction(self, op: str, operands: tuple[int, ...], section: Section) -> int:
        key = (op, operands)
        if key not in self._memo:
            known = max(self._section[operand] for operand in operands)
            # A time since a flag also reads the clock, so it never is static.
            own = Section.STATIC if known is Section.STATIC and op != "since" else max(section, known)
            target = self.anonymous(own)
            self._code[own].append((OPCODES[op], target, *operands, *(0,) * (3 - len(operands))))
            self._memo[key] = target
        return self._memo[key]

    def is_static(self, register: int) -> bool:
        """Whether the register's value depends on parameters alone."""
        return self._section[register] is Section.STATIC

    def code(self) -> tuple[Ints, Ints]:
        """All instructions, and where each section starts."""
        lines = [line for section in Section for line in self._code[section]]
        counts = [0, *(len(self._code[section]) for section in Section)]
        return np.array(lines, dtype=np.int64).reshape(-1, 5), np.cumsum(counts)

    def registers(self) -> Floats:
        """Initial content of the register file."""
        content = np.zeros(self._size)
        for value, register in self._constants.items():
            content[register] = value
        return content


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
