"""What a piece of physics is: one declaration that simulation, diagnosis, report and plant file share.

Formulas are written in canonical symbols: `v` velocity, `x` position and `load` of the balance entered, `t` time,
`elapsed` time since the recording's start, `y` the channel of a sensor fault, the effect's own parameters, states and
memories, and, where an effect belongs to one kind of plant, that plant's own symbols.

Every effect has strengths: parameters that are 0 where it is absent. Where its nominal limit lies elsewhere (a
filter's time constant going to 0, a clip's level to infinity) the strength is a constant `share` of the effect that
acts: 1 is the whole of it, and a small share tells in which direction the effect would move the readings.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from sim_hal.plant.expressions import Name, Node, Num, Op, parse

#: What a filter's output is called in the formula of its channel.
FILTERED = "filtered"


@dataclass(frozen=True)
class EffectParameter:
    """A parameter of an effect.

    `unit` may use `force`, `velocity`, `position` and `channel`, the units of the place it enters. `start`, `low`,
    `high` span what is plausible, as formulas of the plant's parameters and the scales F (force), M (inertia),
    V (velocity), T (duration), Y (channel, Y_max its largest reading), X (travel, within X_low … X_high, X_mid its
    middle, P a period in it; S a sample). A strength is zero where the effect is absent; a `constant` (air density,
    say) is not fitted. `also` lists further values to start from, of a constant to try. `least`, `most` and `above`
    (which itself is excluded) bound what is physical at all. `usual`, with the further scale D (duration of a whole
    recording), is a size that real ones seldom exceed by much.
    """

    name: str
    unit: str
    start: str
    low: str
    high: str
    strength: bool = False
    constant: bool = False
    also: tuple[str, ...] = ()
    least: float | None = None
    most: float | None = None
    above: float | None = None
    usual: str | None = None

    def fault(self, value: float) -> str | None:
        """What is unphysical about a value, or None."""
        if not math.isfinite(value):
            return f"{value!r} is not a finite number"
        if self.above is not None and not value > self.above:
            return f"{value!r} must be above {self.above:g}"
        if self.least is not None and not value >= self.least:
            return f"{value!r} must not be below {self.least:g}"
        if self.most is not None and not value <= self.most:
            return f"{value!r} must not be above {self.most:g}"
        return None


#: Strength of an effect whose own parameters are not 0 where it is absent: all of it acts.
WHOLE = EffectParameter("share", "1", "1", "1", "1", strength=True, constant=True, least=0.0, most=1.0)


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
    sensor: what the channel reads instead of `y`. delay: how late the channel is, in seconds; skew: by how much later
    with each second. low_pass: time constant of a first-order filter of the channel, whose output is `filtered`.
    local: names for parts of the formulas, later ones may use earlier ones. needs, lacks: symbols that the plant must
    and must not have. unit: of the channels it may act on. sentence: where the effect's own does not fit.
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
    skew: str | None = None
    low_pass: str | None = None
    local: Mapping[str, str] = field(default_factory=dict)
    needs: tuple[str, ...] = ()
    lacks: tuple[str, ...] = ()
    unit: str | None = None
    sentence: str | None = None

    def formulas(self) -> list[str]:
        """All formula texts that act on the plant."""
        single = [
            self.force,
            self.inertia,
            self.sensor,
            self.delay,
            self.skew,
            self.low_pass,
            *(self.dry or ()),
        ]
        inner = [item.rate for item in self.states.values()]
        inner += [text for item in self.memories.values() for text in (item.lower, item.upper) if text]
        texts = [text for text in single if text]
        return [*texts, *self.terms.values(), *self.factors.values(), *inner, *self.local.values()]

    def names(self) -> frozenset[str]:
        """Symbols that the form brings along."""
        own = (*(item.name for item in self.parameters), *self.states, *self.memories, *self.local)
        return frozenset(own) | ({FILTERED} if self.low_pass else frozenset())


@dataclass(frozen=True)
class Effect:
    """A piece of physics (or a sensor fault) of the taxonomy.

    equation: the taxonomy's place. balances: names of balances it enters by preference; empty: any mechanical one.
    rank: order of several faults on one channel. along_line: for forces along a line only, no torques.
    sentence: for a person, with {parameter} placeholders.
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
    along_line: bool = False

    def form(self, symbols: frozenset[str], unit: str | None = None) -> Form | None:
        """The first form whose needs the plant's symbols meet, and the unit of the channel, if it has one."""
        fitting = (form for form in self.forms if form.unit is None or form.unit == unit)
        return next((f for f in fitting if symbols.issuperset(f.needs) and symbols.isdisjoint(f.lacks)), None)

    def describe(self, values: Mapping[str, float]) -> str:
        """The sentence with the effect's size; `values` by own parameter name, SI units."""
        return self.template(values).format(**{name: f"{value:.3g}" for name, value in values.items()})

    def template(self, values: Mapping[str, object]) -> str:
        """The sentence of the form that has these parameters, with {parameter} placeholders."""
        own = (form.sentence for form in self.forms if values.keys() == {p.name for p in form.parameters})
        return next(own, None) or self.sentence


def prior(parameter: EffectParameter, scales: Mapping[str, float]) -> tuple[float, float, float]:
    """Start value and plausible range of a parameter for given scales (SI); raises KeyError for a missing scale."""
    start, low, high = (
        _number(parse(text), scales) for text in (parameter.start, parameter.low, parameter.high)
    )
    return start, low, high


def alternatives(parameter: EffectParameter, scales: Mapping[str, float]) -> tuple[float, ...]:
    """The values of a constant that are worth a try, the usual one first; raises KeyError for a missing scale."""
    return tuple(_number(parse(text), scales) for text in (parameter.start, *parameter.also))


def usual_size(parameter: EffectParameter, scales: Mapping[str, float]) -> float:
    """The size that real ones seldom exceed by much, infinite where none is known; KeyError for a missing scale."""
    return math.inf if parameter.usual is None else _number(parse(parameter.usual), scales)


def _number(node: Node, scales: Mapping[str, float]) -> float:
    """Value of a formula of scales: numbers, names, the four operations, powers and `min`."""
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
        case "min":
            return min(values)
    raise ValueError(f"{node.op} is not allowed in a range")
