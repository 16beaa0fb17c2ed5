"""Derivatives of the rates: the program differentiated instruction by instruction, forward.

Each register of the dynamic section is written once, so its tangent along one direction is a formula of its operands
and their tangents. Zeros are left out and equal formulas shared: what stays is what a careful hand would write down.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from sim_hal.plant.program import OPCODES, Builder, Section

_NAMES = {code: name for name, code in OPCODES.items()}
_ARITY = {"where": 3} | dict.fromkeys(("+", "-", "*", "/", "**", "min", "max"), 2)


class Follower(NamedTuple):
    """Registers that tell what a memory follows: whether its lower, whether its upper limit, and these limits."""

    at_lower: int
    at_upper: int
    lower: int
    upper: int


def tangents(
    builder: Builder,
    seeds: Mapping[int, int],
    memories: Mapping[int, Follower],
    wanted: Iterable[int],
    section: Section,
) -> dict[int, int]:
    """Registers of the tangents along one direction, by register; where there is none the tangent is 0.

    `seeds` gives those of the leaves, `memories` the registers that hold a memory's value. Found are those of the
    `wanted` registers and of what they are made of, available in a section: JACOBIAN or CONDITION.
    """
    rules = _Rules(builder, section)
    found = dict(seeds)
    lines = builder.lines(Section.DYNAMIC)
    if section is Section.CONDITION:
        lines += builder.lines(section)
    needed = _ancestors(lines, memories, wanted)
    for code, target, *operands in lines:
        if target not in needed:
            continue
        if target in memories:
            tangent = rules.memory(memories[target], found)
        else:
            tangent = rules.tangent(_NAMES[code], target, operands, found)
        if tangent is not None:
            found[target] = tangent
    return found


def _ancestors(
    lines: Iterable[tuple[int, ...]], memories: Mapping[int, Follower], wanted: Iterable[int]
) -> set[int]:
    """The wanted registers and all that they are made of."""
    made_of = {target: operands[: _ARITY.get(_NAMES[code], 1)] for code, target, *operands in lines}
    found: set[int] = set()
    waiting = list(wanted)
    while waiting:
        register = waiting.pop()
        if register not in found:
            found.add(register)
            follower = memories.get(register)
            limits = (follower.lower, follower.upper) if follower else made_of.get(register, ())
            waiting.extend(limits)
    return found


class _Rules:
    """Rules of differentiation; a tangent of None is 0."""

    def __init__(self, builder: Builder, section: Section) -> None:
        self._builder = builder
        self._section = section
        self._one = builder.constant(1.0)
        self._zero = builder.constant(0.0)

    def memory(self, follower: Follower, found: Mapping[int, int]) -> int | None:
        low, high = found.get(follower.lower), found.get(follower.upper)
        if low is None and high is None:
            return None
        above = self._choose(follower.at_upper, high, None)
        return self._choose(follower.at_lower, low, above)

    def tangent(self, op: str, target: int, operands: list[int], found: Mapping[int, int]) -> int | None:
        a, b, _ = operands
        parts = [found.get(operand) for operand in operands[: _ARITY.get(op, 1)]]
        if all(part is None for part in parts):
            return self._clock(op, operands, found)
        match op:
            case "+":
                return self._add(parts[0], parts[1])
            case "-":
                return self._subtract(parts[0], parts[1])
            case "*":
                return self._add(self._times(parts[0], b), self._times(parts[1], a))
            case "/":
                return self._over(self._subtract(parts[0], self._times(parts[1], target)), b)
            case "**":
                return self._power(target, a, b, parts)
            case "where":
                return self._choose(a, parts[1], parts[2])
            case "min" | "max":
                first = self._emit("<" if op == "min" else ">", a, b)
                return self._choose(first, parts[0], parts[1])
        outer = self._outer(op, target, a)
        return None if outer is None else self._times(parts[0], outer)

    def _clock(self, op: str, operands: list[int], found: Mapping[int, int]) -> int | None:
        """A time since a flag goes with the clock, register 0, once the flag is set."""
        return self._choose(operands[0], found.get(0), None) if op == "since" else None

    def _outer(self, op: str, target: int, a: int) -> int | None:
        """Derivative of a function of one argument; comparisons and signs have none."""
        match op:
            case "neg":
                return self._emit("neg", self._one)
            case "abs":
                return self._emit("sign", a)
            case "square":
                return self._emit("*", self._builder.constant(2.0), a)
            case "sqrt":
                return self._emit("/", self._builder.constant(0.5), target)
            case "exp":
                return target
            case "log":
                return self._emit("/", self._one, a)
            case "sin":
                return self._emit("cos", a)
            case "cos":
                return self._emit("neg", self._emit("sin", a))
            case "tan":
                return self._emit("+", self._one, self._emit("square", target))
            case "tanh":
                return self._emit("-", self._one, self._emit("square", target))
        return None

    def _power(self, target: int, a: int, b: int, parts: list[int | None]) -> int | None:
        lowered = self._emit("*", b, self._emit("**", a, self._emit("-", b, self._one)))
        exponent = None
        if parts[1] is not None:
            exponent = self._times(parts[1], self._emit("*", target, self._emit("log", a)))
        return self._add(self._times(parts[0], lowered), exponent)

    def _emit(self, op: str, *operands: int) -> int:
        return self._builder.instruction(op, operands, self._section)

    def _add(self, a: int | None, b: int | None) -> int | None:
        if a is None or b is None:
            return b if a is None else a
        return self._emit("+", a, b)

    def _subtract(self, a: int | None, b: int | None) -> int | None:
        if b is None:
            return a
        return self._emit("neg", b) if a is None else self._emit("-", a, b)

    def _times(self, tangent: int | None, factor: int) -> int | None:
        if tangent is None or tangent == self._one:
            return None if tangent is None else factor
        return self._emit("*", tangent, factor)

    def _over(self, tangent: int | None, divisor: int) -> int | None:
        return None if tangent is None else self._emit("/", tangent, divisor)

    def _choose(self, condition: int, a: int | None, b: int | None) -> int | None:
        if a is None and b is None:
            return None
        if a == b:
            return a
        where = (self._zero if tangent is None else tangent for tangent in (a, b))
        return self._emit("where", condition, *where)
