"""The simulated clock: waiting is what makes the simulated world go on."""

from __future__ import annotations

import math

from hal.errors import CommandRefused
from sim_hal.rig import Rig


class SimClock:
    """Clock of the simulated board; as fast as the machine can, and the same on each run."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig

    def now_s(self) -> float:
        """Simulated seconds since the board was opened."""
        rig = self._rig
        if not rig.faults.planted:
            return rig.now_s
        fault = rig.faults.of("clock", rig.now_s)
        jumped_s = fault.size if fault and fault.kind == "jump" else 0.0
        return rig.now_s + jumped_s

    def sleep_until_s(self, time_s: float) -> None:
        """Advance the world to `time_s`. Raises `CommandRefused` for a time that is not finite."""
        if not math.isfinite(time_s):
            raise CommandRefused(f"clock: cannot sleep until {time_s!r} s")
        if self._rig.faults.planted:
            time_s = self._disturbed_s(time_s)
        self._rig.advance(time_s)

    def _disturbed_s(self, time_s: float) -> float:
        """Until when a clock sleeps that may be broken."""
        rig = self._rig
        fault = rig.faults.of("clock", rig.now_s)
        if fault and fault.kind == "jump":
            time_s = max(rig.now_s, time_s - fault.size)
        elif fault and fault.kind == "late":
            time_s += fault.size
        if fault:
            rig.note_effect("clock")
        return time_s
