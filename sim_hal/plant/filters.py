"""First-order low-pass filters of channels, as further states of the plant.

A filter's state follows f' = (y − f)/τ. Where the channel reads the rate of a state s, as an accelerometer does, the
filter needs no rate: the low-passed rate of s is (s − f)/τ with f the low-passed s itself, exactly.

A filter starts as if all had moved on steadily before: where the channel was τ ago, by the speeds that are given.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from sim_hal.plant.expressions import Name, Node, Num, Op, add, linear_in, multiply, rename, walk
from sim_hal.plant.structure import State

_RATE = "rate of "


class Settled(NamedTuple):
    """How a state starts that others tell: what it follows (a channel, or a state), and where that puts it."""

    follows: str
    start: Node


@dataclass
class Filters:
    """What filters add to a plant: states with their rates, strengths, and what each state starts at.

    `speeds`: states that moved before the start, and their rates, which are states.
    """

    speeds: Mapping[str, Name]
    states: dict[str, State] = field(default_factory=dict)
    rates: dict[str, Node] = field(default_factory=dict)
    strengths: dict[str, tuple[str, ...]] = field(default_factory=dict)
    settled: dict[str, Settled] = field(default_factory=dict)

    def add(
        self, channel: str, name: str, node: Node, time_constant: Node, strengths: tuple[str, ...]
    ) -> Node:
        """The low-passed channel, which reads `node`; `ExpressionError` where a rate does not enter it linearly."""
        rates, rest = linear_in(_rates_as_names(node), _rate_names(node))
        parts = []
        if rest != Num(0.0):
            parts.append(self._state(channel, name, rest, time_constant, strengths))
        for symbol, factor in rates.items():
            state = Name(symbol.removeprefix(_RATE))
            slow = self._state(state.id, f"{name}({state.id})", state, time_constant, strengths)
            parts.append(multiply(factor, Op("/", (Op("-", (state, slow)), time_constant))))
        return add(*parts)

    def _state(
        self, follows: str, name: str, node: Node, time_constant: Node, strengths: tuple[str, ...]
    ) -> Node:
        self.states[name] = State("1", Num(0.0))
        rate = Op("/", (Op("-", (node, Name(name))), time_constant))
        self.rates[name] = while_acting(strengths, rate)
        earlier = rename(node, lambda state: self._earlier(Name(state), time_constant))
        self.settled[name] = Settled(follows, earlier)
        self.strengths[name] = strengths
        return Name(name)

    def _earlier(self, symbol: Name, by: Node) -> Node:
        """What a symbol was some time before, where its rate is a state; else what it is."""
        speed = self.speeds.get(symbol.id)
        return symbol if speed is None else Op("-", (symbol, multiply(by, speed)))


def while_acting(strengths: tuple[str, ...], rate: Node) -> Node:
    """A state's rate, 0 while all strengths are 0: what nobody asks for must not run away unseen."""
    if not strengths:
        return rate
    sizes = tuple(Op("abs", (Name(name),)) for name in strengths)
    return Op("where", (sizes[0] if len(sizes) == 1 else Op("or", sizes), rate, Num(0.0)))


def _rate_of(node: Node) -> str | None:
    """The state whose rate a node is."""
    if isinstance(node, Op) and node.op == "rate" and isinstance(node.args[0], Name):
        return node.args[0].id
    return None


def _rate_names(node: Node) -> frozenset[str]:
    return frozenset(_RATE + state for part in walk(node) if (state := _rate_of(part)) is not None)


def _rates_as_names(node: Node) -> Node:
    """The formula with each rate as a symbol of its own."""
    state = _rate_of(node)
    if state is not None:
        return Name(_RATE + state)
    return Op(node.op, tuple(_rates_as_names(arg) for arg in node.args)) if isinstance(node, Op) else node
