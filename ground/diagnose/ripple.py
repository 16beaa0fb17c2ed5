"""A ripple, read from the recording itself: the sine of position that explains most of what surprises a filter.

A force that was smoothed from readings has lost what is quick. Here the readings at full rate judge: how much of a
Kalman filter's innovations is the answer to a force sin(2 pi x / period), to a cosine, and how large both are
(generalised least squares by filtering each regressor, P. de Jong, Annals of Statistics 19 (1991) 1073). The force
that wanders in the filter takes what is slow.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ground.diagnose.smoothing import Passed, Update

Float = NDArray[np.float64]

CYCLE_STEP = 0.25
"""Spacing of the periods tried, in cycles over the travel: no peak of the spectrum is narrower than one."""
LEAST_CYCLES, MOST_CYCLES = 2.0, 500.0
"""What is not seen to repeat along the travel is no ripple, but some smooth law."""
CYCLES_PER_SAMPLE = 1.0 / 3.0
"""What turns faster between samples is not seen as what it is."""
FAST = 90.0
"""Percentile of the motion between samples that counts as fast."""
TENTHS = 10
"""Stretches that are dealt to the two halves in turn."""
SEEN = 20.0
"""Least drop in chi-square on either half by what the other half says, in what an innovation has of it."""
USUAL = 2.0
"""Sigmas beyond which an innovation counts less (P. J. Huber, Annals of Mathematical Statistics 35 (1964) 73)."""


@dataclass(frozen=True)
class Ripple:
    """Period [unit of position], and the parts by sine and cosine of 2 pi x / period [unit of force]."""

    period: float
    sine: float
    cosine: float

    @property
    def size(self) -> float:
        """Amplitude [unit of force]."""
        return float(np.hypot(self.sine, self.cosine))


def strongest_ripple(passed: Passed, position: Float) -> Ripple | None:
    """The sine that explains most along a filter's way, by its position (samples,); None where none does.

    It must do so on each half of the recording as the other half has it: where friction lets go, a single moment asks
    for a force, which is a sine of any period.
    """
    travel = float(np.ptp(position))
    fast = float(np.percentile(np.abs(np.diff(position)), FAST))
    if travel == 0.0 or fast == 0.0:
        return None
    most = min(MOST_CYCLES, CYCLES_PER_SAMPLE * travel / fast)
    cycles = np.arange(LEAST_CYCLES, most, CYCLE_STEP)
    if cycles.size == 0:
        return None
    halves = answers(passed, position, 2.0 * np.pi * cycles / travel)
    gain = halves[1].gain_of(*halves[0].parts) + halves[0].gain_of(*halves[1].parts)
    best = int(np.argmax(gain))
    if not gain[best] >= SEEN * max(1.0, dispersion(passed)):
        return None
    sine, cosine = Sums(halves[0].own + halves[1].own, halves[0].told + halves[1].told).parts
    return Ripple(travel / float(cycles[best]), float(sine[best]), float(cosine[best]))


@dataclass(frozen=True)
class Sums:
    """Normal equations of the sine and the cosine of each wave number.

    `own` (3, waves): sine by sine, sine by cosine, cosine by cosine; `told` (2, waves): by the innovations.
    """

    own: Float
    told: Float

    @property
    def parts(self) -> tuple[Float, Float]:
        """By sine and by cosine, (waves,) each."""
        ss, sc, cc = self.own
        determinant = ss * cc - sc**2
        whole = np.where(determinant > 1e-9 * ss * cc, determinant, np.inf)
        return (cc * self.told[0] - sc * self.told[1]) / whole, (
            ss * self.told[1] - sc * self.told[0]
        ) / whole

    def gain_of(self, sine: Float, cosine: Float) -> Float:
        """Drop in chi-square with given parts, (waves,)."""
        ss, sc, cc = self.own
        linear = 2.0 * (sine * self.told[0] + cosine * self.told[1])
        return np.asarray(linear - ss * sine**2 - 2.0 * sc * sine * cosine - cc * cosine**2)


def answers(passed: Passed, position: Float, waves: Float) -> tuple[Sums, Sums]:
    """What the two halves of a filter's way say of each wave number (waves,)."""
    count = len(passed.updates)
    halves = tuple(Sums(np.zeros((3, waves.size)), np.zeros((2, waves.size))) for _ in range(2))
    moved = np.zeros((passed.mean.shape[1], 2 * waves.size))
    for k, update in enumerate(passed.updates):
        if update is not None:
            answer = update.sensitivity @ moved
            weighed = np.linalg.solve(update.spread, answer) * weight_of(update)
            (s, c), (ws, wc) = np.split(answer, 2, axis=1), np.split(weighed, 2, axis=1)
            half = halves[k * TENTHS // count % 2]
            half.own[:] += [np.sum(s * ws, axis=0), np.sum(s * wc, axis=0), np.sum(c * wc, axis=0)]
            half.told[:] += [update.innovation @ ws, update.innovation @ wc]
            moved = moved - update.gain @ answer
        if k + 1 < count:
            phase = waves * (0.5 * (position[k] + position[k + 1]))
            push = np.append(passed.slope[k][:-1, -1], 0.0)
            moved = passed.slope[k] @ moved + np.outer(push, np.concatenate([np.sin(phase), np.cos(phase)]))
    return halves[0], halves[1]


def dispersion(passed: Passed) -> float:
    """Mean weighed square of the innovations: above 1 where the filter's plant is wrong otherwise."""
    seen = [update for update in passed.updates if update is not None]
    squares = [weight_of(one) * surprise_of(one) for one in seen]
    return float(sum(squares) / max(1, sum(one.innovation.size for one in seen)))


def surprise_of(update: Update) -> float:
    """Chi-square of an innovation."""
    return float(update.innovation @ np.linalg.solve(update.spread, update.innovation))


def weight_of(update: Update) -> float:
    """1, and less for an innovation that no noise makes."""
    return float(min(1.0, USUAL / max(np.sqrt(surprise_of(update) / update.innovation.size), 1e-300)))
