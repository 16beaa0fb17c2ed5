"""How the centre of mass flies: its fall as the accelerometer saw it, and the speed that a time of flight means.

On a vertical line z'' = -g; on an arm the arc z of the centre of mass falls with g cos(z/L). What else acts slowly on
the robot shows in flight as a level of the accelerometer other than what the weight taken away leaves, and as its
slope.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flight.flight_search import NoFlight, Stretch, evened, slide

Array = NDArray[np.float64]

_TRIM_S = 0.005  # at both ends: what the ground does there is not yet told from the flight
_SLOPE_STD_M_S3 = 0.5  # of slow forces in flight, over the mass: drag on the way up against the way down
_LEVEL_NOISE = 1.5  # a level's noise over that of a plain mean, as the ringing is fitted along with it


@dataclass(frozen=True)
class Level:
    """Mean specific force along the leg in flight: value at `middle_s`, slope, and their sigmas."""

    value_m_s2: float
    sigma_m_s2: float
    slope_m_s3: float
    slope_sigma_m_s3: float
    middle_s: float

    def at(self, time_s: float) -> float:
        return self.value_m_s2 + self.slope_m_s3 * (time_s - self.middle_s)


def flight_level(times_s: Array, motion: Array, stretch: Stretch, pole: complex, noise_m_s2: float) -> Level:
    """The level by windows of one period of the ringing, laid end to end over the flight."""
    inside = (times_s > stretch.first_s + _TRIM_S) & (times_s < stretch.last_s - _TRIM_S)
    middle = 0.5 * (stretch.first_s + stretch.last_s)
    for periods in (1.0, 0.6, 0.4):
        try:
            windows = slide(*evened(times_s[inside], motion[inside]), pole, periods)
            break
        except (NoFlight, IndexError):
            continue
    else:
        return Level(0.0, math.inf, 0.0, _SLOPE_STD_M_S3, middle)
    step = max(1, min(windows.width, windows.level_m_s2.size // 2 or 1))
    level = windows.level_m_s2[::step]
    at = windows.starts_s[::step] + 0.5 * windows.width * windows.step_s - middle
    one = _LEVEL_NOISE * noise_m_s2 / math.sqrt(min(step, windows.width))
    spread = float(np.std(level)) if level.size > 2 else 0.0
    one = max(one, spread)
    # A line through the levels, its slope held to what slow forces may do.
    normal = np.array([[level.size, at.sum()], [at.sum(), float(at @ at) + (one / _SLOPE_STD_M_S3) ** 2]])
    covariance = np.linalg.inv(normal) * one**2
    value, slope = np.linalg.solve(normal, np.array([level.sum(), float(level @ at)]))
    return Level(float(value), math.sqrt(covariance[0, 0]), float(slope), math.sqrt(covariance[1, 1]), middle)


@dataclass(frozen=True)
class FreeFall:
    """The fall of the centre of mass [m/s^2] at times from the fire command; `radius_m` of an arm, else infinite."""

    gravity_m_s2: float
    slope_m_s3: float
    middle_s: float
    radius_m: float

    def take_off_speed_m_s(self, take_off_s: float, flight_s: float, rise_m: float) -> float:
        """Speed [m/s] with which the centre of mass is `rise_m` higher after `flight_s`.

        The arc's z counts from level; the hop starts close to it.
        """
        speed = rise_m / flight_s + 0.5 * self.gravity_m_s2 * flight_s
        offset = take_off_s - self.middle_s
        speed -= self.slope_m_s3 * (flight_s**2 / 6.0 + 0.5 * offset * flight_s)
        if math.isfinite(self.radius_m):
            speed -= self._arc_share(flight_s, speed) / flight_s
        return speed

    def _arc_share(self, flight_s: float, speed: float) -> float:
        """Integral of (T - t) g (1 - cos(z/L)) over the flight [m]."""
        t = np.linspace(0.0, flight_s, 33)
        z = speed * t - 0.5 * self.gravity_m_s2 * t**2
        less = self.gravity_m_s2 * (1.0 - np.cos(z / self.radius_m)) * (flight_s - t)
        return float(np.sum(less) * t[1])
