"""Records of hops as the sensors would give them, from the exact two-mass motion."""

from __future__ import annotations

import numpy as np
from two_mass import Array, TwoMassHop

from flight.record import HopRecord

RATE_HZ, STEP_M_S2, RANGE_M_S2 = 1666.0, 0.00957, 313.8


def record_of(
    hop: TwoMassHop,
    rng: np.random.Generator,
    *,
    opening_s: float = 0.0069,
    range_m_s2: float = RANGE_M_S2,
    arm: tuple[float, float] | None = None,
) -> HopRecord:
    """Fire command at 0, noise and steps of the parts. `arm`: sensor gain rho/L and local gravity."""
    times = np.arange(-0.25, hop.duration_s - 0.05, 1.0 / RATE_HZ) + rng.uniform(0.0, 1.0 / RATE_HZ)
    force, compression = hop.read(times - opening_s)
    if arm is not None:
        gain, local = arm
        # Sensor on the arm: rho theta'' + g cos(theta), theta small: the body's acceleration times rho/L.
        force = gain * (force - hop.gravity) + local
    return seen(times, force, compression, rng, range_m_s2)


def seen(
    times: Array, force: Array, compression: Array, rng: np.random.Generator, range_m_s2: float
) -> HopRecord:
    """What the sensors make of true values."""
    noisy = np.round((force + rng.normal(0.0, 0.035, times.size)) / STEP_M_S2) * STEP_M_S2
    return HopRecord(
        0.0,
        times,
        np.clip(noisy, -range_m_s2, range_m_s2),
        np.abs(noisy) >= range_m_s2,
        times,
        compression + rng.normal(0.0, 50e-6, times.size),
    )
