"""What a hop costs: electrical energy and time of tensioning under the power limit, and of driving home."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flight.settings import FlightSettings
from flight.tensioning import compression_for_energy_m, moving_current_a

Array = NDArray[np.float64]

_POINTS = 40


class HopCosts:
    """Cost of a hop over its usable energy, for one rig."""

    def __init__(self, settings: FlightSettings) -> None:
        tension, planner = settings.tension, settings.surface.planner
        self._energies = np.linspace(0.0, tension.max_energy_j, _POINTS)
        most_m = compression_for_energy_m(tension.max_energy_j, settings.rig)
        at = np.linspace(0.0, most_m, 4 * _POINTS)
        speed, power = np.array([_speed_and_power(float(s), settings) for s in at]).T
        pace = settings.rig.travel_per_compression / speed  # seconds per metre of compression
        seconds, joules = _integrated(pace, at), _integrated(pace * power, at)
        home_w = _speed_and_power(0.0, settings)[1]
        seconds = seconds + at * settings.rig.travel_per_compression / settings.drive.homing_speed_m_s
        joules = joules + at * settings.rig.travel_per_compression / settings.drive.homing_speed_m_s * home_w
        reached = [compression_for_energy_m(float(energy_j), settings.rig) for energy_j in self._energies]
        self._seconds = np.interp(reached, at, seconds) + planner.overhead_s
        self._joules = np.interp(reached, at, joules) + planner.overhead_j

    def energy_j(self, used_j: float | Array) -> Array:
        """Electrical energy of a hop with so much usable energy."""
        return np.asarray(np.interp(used_j, self._energies, self._joules))

    def time_s(self, used_j: float | Array) -> Array:
        """Time that a hop takes."""
        return np.asarray(np.interp(used_j, self._energies, self._seconds))


def _speed_and_power(compression_m: float, settings: FlightSettings) -> tuple[float, float]:
    """Nut speed and electrical power at a compression: full speed, or what the power limit leaves."""
    drive = settings.drive
    wanted = drive.tensioning_speed_m_s
    current_a = moving_current_a(wanted, compression_m, settings)
    limit_v = drive.power_margin * drive.power_limit_w / current_a
    back_v = drive.torque_constant_n_m_a * wanted / drive.travel_per_radian_m
    voltage_v = min(back_v + drive.resistance_ohm * current_a, limit_v, drive.max_voltage_v)
    omega = (voltage_v - drive.resistance_ohm * current_a) / drive.torque_constant_n_m_a
    return max(omega * drive.travel_per_radian_m, drive.creep_speed_m_s), voltage_v * current_a


def _integrated(y: Array, x: Array) -> Array:
    return np.concatenate(([0.0], np.cumsum(0.5 * (y[1:] + y[:-1]) * np.diff(x))))
