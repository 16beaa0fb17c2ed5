"""The coil of the lock's electromagnet."""

from __future__ import annotations

import math
from collections.abc import Sequence

from sim_hal.plant.simulate import Plant

_NOTHING_A = 1e-15
"""A current this close to where it goes counts as there: many orders below what a sensor can tell."""


class Coil:
    """The magnet's coil between two switchings: L di/dt = u − R i, solved exactly."""

    def __init__(self, hop: Plant) -> None:
        resistance_ohm, inductance_h, supply_v = (
            hop.parameters[name].value for name in ("R_em", "L_em", "u_em")
        )
        self._full_a = supply_v / resistance_ohm
        self._time_constant_s = inductance_h / resistance_ohm
        self._goal_a = self._start_a = 0.0
        self.since_s = 0.0

    def switch(self, on: bool, at_s: float, current_a: float) -> None:
        """Apply or take the supply, at a given current."""
        self._goal_a = self._full_a if on else 0.0
        self._start_a = current_a
        self.since_s = at_s

    def current_a(self, at_s: float) -> float:
        """Current at a time after the last switching."""
        if self._start_a == self._goal_a:
            return self._goal_a
        left_a = (self._start_a - self._goal_a) * math.exp(-(at_s - self.since_s) / self._time_constant_s)
        if abs(left_a) < _NOTHING_A:
            self._start_a = self._goal_a
            return self._goal_a
        return self._goal_a + left_a

    def currents_a(self, instants: Sequence[float]) -> Sequence[float] | float:
        """Current at some times, or the one that holds all the time."""
        if self._start_a == self._goal_a:
            return self._goal_a
        return [self.current_a(at_s) for at_s in instants]
