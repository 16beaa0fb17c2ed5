"""A value with its uncertainty, kept apart by source, so that a common error stays common.

First-order propagation (GUM, JCGM 100:2008, 5.1): each named source is one independent standard normal
error; `parts[name]` is how far one sigma of it moves the value. Two values that share a source are correlated
by it, and a source that cancels in a ratio cancels here too.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Uncertain:
    """A value and its signed one-sigma contributions by source, both in the value's unit."""

    value: float
    parts: Mapping[str, float] = field(default_factory=dict)

    @staticmethod
    def of(value: float, sigma: float, source: str) -> Uncertain:
        """A value with one source of error."""
        return Uncertain(value, {source: sigma})

    @property
    def sigma(self) -> float:
        """Standard uncertainty: all sources together."""
        return math.sqrt(sum(part * part for part in self.parts.values()))

    def sigma_of(self, sources: Iterable[str]) -> float:
        """Standard uncertainty by these sources alone."""
        return math.sqrt(sum(self.parts.get(name, 0.0) ** 2 for name in sources))

    def covariance(self, other: Uncertain) -> float:
        """By the sources that both share."""
        return sum(part * other.parts.get(name, 0.0) for name, part in self.parts.items())

    def with_part(self, source: str, sigma: float) -> Uncertain:
        """The same value with one more independent source."""
        return Uncertain(self.value, {**self.parts, source: math.hypot(sigma, self.parts.get(source, 0.0))})

    def __add__(self, other: Uncertain | float) -> Uncertain:
        other = exactly(other)
        return combine(self.value + other.value, (self, 1.0), (other, 1.0))

    def __sub__(self, other: Uncertain | float) -> Uncertain:
        other = exactly(other)
        return combine(self.value - other.value, (self, 1.0), (other, -1.0))

    def __mul__(self, other: Uncertain | float) -> Uncertain:
        other = exactly(other)
        return combine(self.value * other.value, (self, other.value), (other, self.value))

    def __truediv__(self, other: Uncertain | float) -> Uncertain:
        other = exactly(other)
        ratio = self.value / other.value
        return combine(ratio, (self, 1.0 / other.value), (other, -ratio / other.value))

    def __pow__(self, power: float) -> Uncertain:
        return combine(self.value**power, (self, power * self.value ** (power - 1.0)))

    def __neg__(self) -> Uncertain:
        return self * -1.0

    def __radd__(self, other: float) -> Uncertain:
        return self + other

    def __rsub__(self, other: float) -> Uncertain:
        return exactly(other) - self

    def __rmul__(self, other: float) -> Uncertain:
        return self * other

    def __rtruediv__(self, other: float) -> Uncertain:
        return exactly(other) / self


def exactly(value: Uncertain | float) -> Uncertain:
    """A plain number as a value without error."""
    return value if isinstance(value, Uncertain) else Uncertain(float(value))


def combine(value: float, *terms: tuple[Uncertain, float]) -> Uncertain:
    """`value` with the errors of several values, each times its derivative."""
    parts: dict[str, float] = {}
    for term, derivative in terms:
        for name, part in term.parts.items():
            parts[name] = parts.get(name, 0.0) + derivative * part
    return Uncertain(value, parts)


def mean_of(values: Iterable[Uncertain]) -> Uncertain:
    """Plain mean; what the values share does not average out."""
    together = list(values)
    if not together:
        raise ValueError("the mean of no values was asked for")
    total = Uncertain(0.0)
    for value in together:
        total = total + value
    return total / float(len(together))


def learnt(values: Iterable[Uncertain], predicted: Uncertain, seen: Uncertain) -> tuple[Uncertain, ...]:
    """Values after something that follows from them was measured: best linear estimate, correlations kept.

    `predicted` is the measured quantity as the values give it, `seen` the measurement.
    """
    apart = seen - predicted
    variance = apart.sigma**2
    if variance == 0.0:
        return tuple(values)
    return tuple(value - apart * (value.covariance(apart) / variance) for value in values)
