"""What a piece of physics is: one declaration that simulation, diagnosis, report and plant file share.

Formulas are written in canonical symbols: `v` velocity, `x` position and `load` of the balance entered, `t` time,
`elapsed` time since the run's start, `y` the channel of a sensor fault, the effect's own parameters, states and
memories, and, where an effect belongs to one kind of plant, that plant's own symbols.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from sim_hal.plant.expressions import Name, Node, Num, Op, parse


@dataclass(frozen=True)
class EffectParameter:
    """A parameter of an effect.

    `unit` may use `force`, `velocity`, `position` and `channel`, the units of the place it enters. `start`, `low`,
    `high` span what is plausible, as formulas of the plant's parameters and the scales F (force), M (inertia),
    V (velocity), T (duration), Y (channel), X (travel, within X_low … X_high, X_mid its middle). A strength is
    zero where the effect is absent; a `constant` (air density, say) is not fitted.
    """

    name: str
    unit: str
    start: str
    low: str
    high: str
    strength: bool = False
    constant: bool = False


@dataclass(frozen=True)
class EffectState:
    """An internal state: unit, rate and initial value, as formulas."""

    unit: str
    rate: str
    initial: str = "0"


@dataclass(frozen=True)
class EffectMemory:
    """An internal play operator, limits linear in the plant's states."""

    unit: str
    lower: str
    upper: str | None
    initial: str


@dataclass(frozen=True)
class Form:
    """One way in which an effect acts; used where the plant has the symbols it needs.

    force: added to the balance's force. dry: resisting force when moving forward and backward (set-valued).
    terms, factors: what is added to, multiplied with, the named ports. inertia: added moving inertia.
    sensor: what the channel reads instead of `y`. delay: how late the channel is, in seconds.
    """

    parameters: tuple[EffectParameter, ...]
    states: Mapping[str, EffectState] = field(default_factory=dict)
    memories: Mapping[str, EffectMemory] = field(default_factory=dict)
    force: str | None = None
    dry: tuple[str, str] | None = None
    terms: Mapping[str, str] = field(default_factory=dict)
    factors: Mapping[str, str] = field(default_factory=dict)
    inertia: str | None = None
    sensor: str | None = None
    delay: str | None = None
    needs: tuple[str, ...] = ()

    def formulas(self) -> list[str]:
        """All formula texts that act on the plant."""
        single = [self.force, self.inertia, self.sensor, self.delay, *(self.dry or ())]
        inner = [item.rate for item in self.states.values()]
        inner += [text for item in self.memories.values() for text in (item.lower, item.upper) if text]
        texts = [text for text in single if text]
        return [*texts, *self.terms.values(), *self.factors.values(), *inner]


@dataclass(frozen=True)
class Effect:
    """A piece of physics (or a sensor fault) of the taxonomy.

    equation: the taxonomy's place. balances: names of balances it enters by preference; empty: any mechanical one.
    rank: order of several faults on one channel. sentence: for a person, with {parameter} placeholders.
    """

    physics_id: str
    equation: str
    forms: tuple[Form, ...]
    says: str
    sentence: str
    citation: str
    kind: Literal["physics", "sensor"] = "physics"
    balances: tuple[str, ...] = ()
    mechanical: bool = True
    rank: int = 0

    def form(self, symbols: frozenset[str]) -> Form | None:
        """The first form whose needs the plant's symbols meet."""
        return next((form for form in self.forms if symbols.issuperset(form.needs)), None)

    def describe(self, values: Mapping[str, float]) -> str:
        """The sentence with the effect's size; `values` by own parameter name, SI units."""
        return self.sentence.format(**{name: f"{value:.3g}" for name, value in values.items()})


def prior(parameter: EffectParameter, scales: Mapping[str, float]) -> tuple[float, float, float]:
    """Start value and plausible range of a parameter for given scales (SI); raises KeyError for a missing scale."""
    start, low, high = (
        _number(parse(text), scales) for text in (parameter.start, parameter.low, parameter.high)
    )
    return start, low, high


def _number(node: Node, scales: Mapping[str, float]) -> float:
    """Value of a formula of scales: numbers, names and the four operations."""
    if isinstance(node, Num):
        return node.value
    if isinstance(node, Name):
        return scales[node.id]
    values = [_number(arg, scales) for arg in node.args]
    return _apply(node, values)


def _apply(node: Op, values: list[float]) -> float:
    match node.op:
        case "neg":
            return -values[0]
        case "+":
            return values[0] + values[1]
        case "-":
            return values[0] - values[1]
        case "*":
            return values[0] * values[1]
        case "/":
            return values[0] / values[1]
        case "**":
            return float(values[0] ** values[1])
    raise ValueError(f"{node.op} is not allowed in a range")
