"""What the push against the ground shows beside its energy: contact time, peak, sinkage, and the ground's stiffness.

The body's rise (accelerometer, twice integrated) and the spring's compression give the foot's path: z_l = z_b +
delta. While the foot is pressed in, m_l y'' = k s + c s' - k_l y holds for its way y below where it stood, with the
spring's force k s + c s' beyond the weight: k_l is the stiffness with which that force sinks the foot as deep as it
sank.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flight.evaluation import HopEnergies
from flight.push import NoPush, find_push
from flight.record import HopRecord
from flight.settings import FlightSettings

Array = NDArray[np.float64]

_LEAST_SAMPLES = 6
_STIFFNESS_ERROR = 0.04  # of ln stiffness by the method itself
_STEP_S = 1e-4
_GRID = np.linspace(math.log(2e3), math.log(2e7), 93)
_MARGIN_S = 1e-3
_PATH_ERROR = 2.0  # of the foot's way, in units of the spring sensor's noise: the opening's time adds to that
_PER_SINKAGE = 1.6  # change of ln stiffness per change of ln sinkage


@dataclass(frozen=True)
class Stance:
    """The push: from the lock's opening to take-off [s], peak specific force, sinkage, ln of the stiffness in N/m.

    Where the foot hardly sinks `log_stiffness` is as high as could be seen, with a wide error.
    """

    contact_time_s: float
    peak_specific_force_m_s2: float
    sinkage_m: float
    log_stiffness: float
    log_stiffness_sigma: float

    def as_payload(self) -> dict[str, float]:
        """As JSON-able data."""
        return {
            "contact_time_s": self.contact_time_s,
            "peak_specific_force_m_s2": self.peak_specific_force_m_s2,
            "sinkage_m": self.sinkage_m,
            "log_stiffness": self.log_stiffness,
            "log_stiffness_sigma": self.log_stiffness_sigma,
        }


def stance_of(record: HopRecord, seen: HopEnergies, settings: FlightSettings) -> Stance | None:
    """The push of a hop; None where its flight was not seen, or a sensor says too little about the push."""
    fit, held = seen.flight.fit, seen.compression_m
    if fit is None or held is None or seen.flight.verdict == "rejected":
        return None
    try:
        push = find_push(record, fit, held.value)
    except NoPush:
        return None
    opening_s, end_s = float(push.times_s[0]), float(push.times_s[-1])
    since_s = record.spring_times_s - record.fire_s
    spring = (since_s > opening_s) & (since_s < end_s + _MARGIN_S)
    if int(spring.sum()) < _LEAST_SAMPLES:
        return None
    times = np.arange(opening_s, end_s, _STEP_S)
    rise = _twice(np.interp(times, push.times_s, push.acceleration_m_s2))
    moments = np.concatenate(([opening_s], since_s[spring]))
    compression = np.interp(times, moments, np.concatenate(([held.value], record.compression_m[spring])))
    sunk = held.value - compression - rise
    pushing = (record.times_s >= record.fire_s + opening_s) & (record.times_s < record.fire_s + end_s)
    error_m = _PATH_ERROR * settings.sensors.spring_hop_noise_m
    sinkage_m = max(float(np.max(sunk)), error_m)
    return Stance(
        contact_time_s=end_s - opening_s,
        peak_specific_force_m_s2=float(np.max(record.specific_force_m_s2[pushing])),
        sinkage_m=sinkage_m,
        log_stiffness=_log_stiffness(sinkage_m, compression, settings),
        log_stiffness_sigma=math.hypot(_STIFFNESS_ERROR, _PER_SINKAGE * error_m / sinkage_m),
    )


def _log_stiffness(sinkage_m: float, compression: Array, settings: FlightSettings) -> float:
    """ln k_l at which the spring's force, as it was, presses the foot in as deep as it went."""
    rig = settings.rig
    stiffness = np.exp(_GRID)
    force = rig.spring_stiffness_n_m * compression + rig.spring_damping_n_s_m * np.gradient(
        compression, _STEP_S
    )
    way, speed, deepest, change = (np.zeros(_GRID.size) for _ in range(4))
    for push_n in force.tolist():  # in place: half the time
        np.subtract(push_n, np.multiply(stiffness, way, out=change), out=change)
        change *= _STEP_S
        change /= rig.leg_mass_kg
        speed += change
        way += np.multiply(_STEP_S, speed, out=change)
        np.maximum(deepest, way, out=deepest)
    return float(np.interp(-math.log(sinkage_m), -np.log(deepest), _GRID))


def _twice(y: Array) -> Array:
    """y integrated twice over the grid, from nothing."""
    for _ in range(2):
        y = np.concatenate(([0.0], np.cumsum(0.5 * (y[1:] + y[:-1])))) * _STEP_S
    return y
