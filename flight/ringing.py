"""The two-mass robot in free flight, and how touching the ground at either end shows at the body.

In flight the spring rings freely: delta'' + 2 lambda delta' + omega_0^2 delta = 0 with
omega_0^2 = k (1/m_b + 1/m_l), and the body's specific force is
(k delta + c delta')/m_b = (m_l/M)(omega_0^2 delta + 2 lambda delta').
A contact force F adds F/m_l to delta'': the body feels it only through spring and damper, so it shows late
and softly. Both ends are therefore found by what they do to the ringing, not by a threshold. Close to an end
the motion is a power series in the time since (before) it, exact to the terms kept.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_TERMS = 14  # omega tau stays below 2.5 within the windows used


@dataclass(frozen=True)
class TwoMass:
    """Mass ratios and gravity of the robot (SI)."""

    leg_share: float  # m_l/M
    body_per_leg: float  # m_b/m_l
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
        return amplitude * complex(np.exp(self.pole * (time_s - self.reference_s)))

    def acceleration_m_s2(self, times_s: Array) -> Array:
        tau = times_s - self.reference_s
        wave = self.cosine_m_s2 * np.cos(self.omega_rad_s * tau)
        wave += self.sine_m_s2 * np.sin(self.omega_rad_s * tau)
        return np.asarray(np.exp(-self.decay_1_s * tau) * wave, dtype=np.float64)

    def compression(self, time_s: float, robot: TwoMass) -> tuple[float, float]:
        """Spring compression delta [m] and its rate [m/s] at a time: delta = -(M/m_l) a/p^2 in phasors."""
        delta = -self.phasor(time_s) / (robot.leg_share * self.pole**2)
        return delta.real, (delta * self.pole).real


def before_take_off(tau_s: Array, ramp: float, bend: float, ringing: Ringing, robot: TwoMass) -> Array:
    """Extra acceleration of the body (m,) at `tau_s` >= 0 before take-off, running backwards in time.

    The ground's force per leg mass grows as ramp tau + bend tau^2/2, away from take-off.
    """
    stiffness, damping = ringing.stiffness_1_s2, -2.0 * ringing.decay_1_s
    force = np.zeros(_TERMS)
    force[1], force[2] = ramp, 0.5 * bend
    delta = np.zeros(_TERMS + 2)
    for n in range(_TERMS):
        rest = force[n] - stiffness * delta[n] - damping * (n + 1) * delta[n + 1]
        delta[n + 2] = rest / ((n + 1) * (n + 2))
    return _felt(tau_s, delta, stiffness, damping, robot)


def after_soft_touchdown(
    tau_s: Array,
    touchdown_s: float,
    impact_m_s: float,
    ground_1_s2: float,
    ground_1_s: float,
    ringing: Ringing,
    robot: TwoMass,
) -> Array:
    """Extra acceleration of the body (m,) at `tau_s` >= 0 after touchdown on ground that gives way.

    The ground pushes with F/m_l = ground_1_s2 y + ground_1_s y' at the depth y, entered with `impact_m_s`.
    """
    stiffness, damping = ringing.stiffness_1_s2, 2.0 * ringing.decay_1_s
    free = ringing.phasor(touchdown_s) * np.cumprod(
        np.concatenate(([1.0 + 0.0j], ringing.pole / np.arange(1, _TERMS)))
    )
    delta, depth = np.zeros(_TERMS + 2), np.zeros(_TERMS + 2)
    depth[1] = impact_m_s
    for n in range(_TERMS):
        force = ground_1_s2 * depth[n] + ground_1_s * (n + 1) * depth[n + 1]
        pulled = stiffness * delta[n] + damping * (n + 1) * delta[n + 1]
        weight = robot.gravity_m_s2 if n == 0 else 0.0
        body = free[n].real + robot.leg_share * pulled
        delta[n + 2] = (force - pulled) / ((n + 1) * (n + 2))
        depth[n + 2] = (robot.body_per_leg * body + weight - force) / ((n + 1) * (n + 2))
    return _felt(tau_s, delta, stiffness, damping, robot)


def after_hard_touchdown(
    tau_s: Array, impact_m_s: float, contact_rad_s: float, ringing: Ringing, robot: TwoMass
) -> Array:
    """Extra acceleration of the body (m,) at `tau_s` >= 0 after touchdown on hard ground.

    The leg bounces off as a mass on a stiff spring would (half a sine of `contact_rad_s`); its speed turns
    round from `impact_m_s` before the drive spring can do much.
    """
    phase = np.minimum(contact_rad_s * tau_s, np.pi)
    rate = impact_m_s * (1.0 - np.cos(phase))
    rise = impact_m_s * (phase - np.sin(phase)) / contact_rad_s
    rise += 2.0 * impact_m_s * np.maximum(tau_s - np.pi / contact_rad_s, 0.0)
    pulled = ringing.stiffness_1_s2 * rise + 2.0 * ringing.decay_1_s * rate
    return np.asarray(robot.leg_share * pulled, dtype=np.float64)


def _felt(tau_s: Array, delta: Array, stiffness: float, damping: float, robot: TwoMass) -> Array:
    """The body's share (m_l/M)(omega_0^2 delta + 2 lambda delta') of a power series delta(tau)."""
    rate = delta[1:] * np.arange(1, delta.size)
    terms = stiffness * delta[:-1] + damping * rate
    return np.asarray(robot.leg_share * np.polynomial.polynomial.polyval(tau_s, terms), dtype=np.float64)
