"""The two-mass robot in free flight: its spring rings, and the body feels it.

delta'' + 2 lambda delta' + omega_0^2 delta = 0 with omega_0^2 = k (1/m_b + 1/m_l), and the body's specific force is
(k delta + c delta')/m_b = (m_l/M)(omega_0^2 delta + 2 lambda delta') = -(m_l/M) delta''.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TwoMass:
    """Share of the leg in the mass, m_l/M, and gravity [m/s^2]."""

    leg_share: float
    gravity_m_s2: float


@dataclass(frozen=True)
class Ringing:
    """Free ringing of the body's acceleration: Re(Z exp(p (t - reference_s))), p = -decay + i omega."""

    reference_s: float
    omega_rad_s: float
    decay_1_s: float
    cosine_m_s2: float
    sine_m_s2: float

    @property
    def pole(self) -> complex:
        return complex(-self.decay_1_s, self.omega_rad_s)

    @property
    def stiffness_1_s2(self) -> float:
        """omega_0^2 = k (1/m_b + 1/m_l)."""
        return self.omega_rad_s**2 + self.decay_1_s**2

    def phasor(self, time_s: float) -> complex:
        amplitude = complex(self.cosine_m_s2, -self.sine_m_s2)
        return amplitude * cmath.exp(self.pole * (time_s - self.reference_s))

    def seen_from(self, time_s: float) -> Ringing:
        """The same ringing with another reference time."""
        here = self.phasor(time_s)
        return Ringing(time_s, self.omega_rad_s, self.decay_1_s, here.real, -here.imag)

    def acceleration_m_s2(self, times_s: Array) -> Array:
        tau = times_s - self.reference_s
        wave = self.cosine_m_s2 * np.cos(self.omega_rad_s * tau)
        wave += self.sine_m_s2 * np.sin(self.omega_rad_s * tau)
        return np.asarray(np.exp(-self.decay_1_s * tau) * wave, dtype=np.float64)

    def half_turns(self, times_s: Array, from_s: float) -> Array:
        """Wave (n,) that one unit of dry friction over the body's mass adds away from `from_s`.

        Friction in the spring's guide turns round with the spring's speed, where the acceleration is at its
        extreme: there the amplitude falls by twice the friction, and between it rings as before.
        """
        zero = math.atan2(-self.sine_m_s2, self.cosine_m_s2)
        # The spring stands still a little after the acceleration's extreme: a = -(m_l/M) p (rate of delta).
        late = math.atan2(self.decay_1_s, self.omega_rad_s)
        phases = (
            self.omega_rad_s * (np.array((times_s.min(), times_s.max())) - self.reference_s) + zero - late
        )
        turns = np.arange(math.ceil(phases[0] / math.pi), math.floor(phases[1] / math.pi) + 1)
        turn_s = self.reference_s + (turns * math.pi + late - zero) / self.omega_rad_s
        away = times_s[:, None] - turn_s
        passed = np.where(turn_s >= from_s, -2.0 * (away > 0.0), 2.0 * (away < 0.0))
        share = np.sum(passed * np.exp(-self.decay_1_s * away), axis=1)
        wave = np.cos(self.omega_rad_s * (times_s - self.reference_s) + zero)
        return np.asarray(share * wave, dtype=np.float64)

    def compression(self, time_s: float, robot: TwoMass) -> tuple[float, float]:
        """Spring compression delta [m] and its rate [m/s] at a time: delta = -(M/m_l) a/p^2 in phasors."""
        delta = -self.phasor(time_s) / (robot.leg_share * self.pole**2)
        return delta.real, (delta * self.pole).real
