"""What the spring sensor adds to the accelerometer: in flight it weighs the leg against the robot.

Both see the same ringing, a = -(m_l/M) delta'', so the ratio of their amplitudes is the leg's share of the mass.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from flight.edge_search import EndOfFlight
from flight.flight_search import Expectation
from flight.record import HopRecord
from flight.settings import FlightSettings

_LEAST_SAMPLES = 12
_BELIEVED_SIGMAS = 5.0


@dataclass(frozen=True)
class LegShare:
    """m_l/M: the settings' masses weighed with what was measured, and that alone (sigma infinite for nothing)."""

    share: float
    measured: float = math.nan
    measured_sigma: float = math.inf


def leg_share_seen(
    record: HopRecord, end: EndOfFlight, settings: FlightSettings, expected: Expectation
) -> LegShare:
    """The leg's share by the ringing next to one end of the flight, weighed against the configured masses."""
    share = expected.robot.leg_share
    prior_sigma = math.sqrt(2.0) * settings.rig.mass_std_share * share * (1.0 - share)
    configured = LegShare(share)
    times = record.spring_times_s - record.fire_s
    inside = (times >= end.inner_s[0]) & (times <= end.inner_s[1])
    ringing = end.local.ringing
    tau, values = times[inside] - ringing.reference_s, record.compression_m[inside]
    if tau.size < _LEAST_SAMPLES or not np.all(np.isfinite(values)):
        return configured
    wave = np.exp(ringing.pole * tau)
    columns = np.column_stack((wave.real, wave.imag, np.ones_like(tau)))
    cosine, sine, level = np.linalg.lstsq(columns, values, rcond=None)[0]
    left = values - columns @ np.array((cosine, sine, level))
    noise = max(float(np.std(left)), settings.sensors.spring_step_m / math.sqrt(12.0))
    bent = -(ringing.pole**2) * complex(cosine, -sine)  # -delta'' as a phasor
    felt = complex(ringing.cosine_m_s2, -ringing.sine_m_s2)
    if abs(bent) == 0.0:
        return configured
    measured = (felt / bent).real
    scatter = noise * math.sqrt(2.0 / tau.size) / max(math.hypot(cosine, sine), 1e-12)
    sigma = abs(measured) * math.hypot(scatter, settings.sensors.scale_std_share)
    if abs(measured - share) > _BELIEVED_SIGMAS * math.hypot(sigma, prior_sigma):
        return configured
    weight = prior_sigma**2 / (prior_sigma**2 + sigma**2)
    return LegShare(share + weight * (measured - share), measured, sigma)
