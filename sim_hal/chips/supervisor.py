"""What guards the actuators' supply: the supervisor on its two pins, and the kernel's watchdog."""

from __future__ import annotations

import math

from sim_hal.chips.rig import ChipRig


class Supervisor:
    """A timer that each edge of the heartbeat restarts, and a latch on the supply that a pulse on the arm pin sets.

    When the timer runs out the latch drops and stays down until it is armed again.
    """

    def __init__(self, rig: ChipRig, timeout_s: float) -> None:
        self._rig, self._timeout_s = rig, timeout_s
        self._edge_s = -math.inf
        self._level = False

    def heartbeat(self, level: bool) -> None:
        """The heartbeat pin was written."""
        if level != self._level:
            self._level, self._edge_s = level, self._rig.now_s

    def arm(self, level: bool) -> None:
        """The arm pin was written; the latch takes only while the heart beats."""
        if level and self._rig.now_s < self._edge_s + self._timeout_s:
            self._rig.switch_supply(True)

    def deadline_s(self) -> float:
        """When the supply is taken away."""
        return self._edge_s + self._timeout_s if self._rig.supply_on else math.inf

    def act(self) -> None:
        """Take the supply."""
        self._rig.switch_supply(False)


class EmulatedWatchdog:
    """/dev/watchdog: a computer that is reset lets go of all its pins, so the supply is gone."""

    def __init__(self, rig: ChipRig, timeout_s: int) -> None:
        self._rig, self._timeout_s = rig, timeout_s
        self._alive_s = rig.now_s
        self.armed = True
        self.has_reset = False
        rig.guards.append(self)

    def keep_alive(self) -> None:
        """Restart its time."""
        self._alive_s = self._rig.now_s

    def disarm(self) -> None:
        """Stop it without a reset."""
        self.armed = False

    def deadline_s(self) -> float:
        """When the computer is reset."""
        return self._alive_s + self._timeout_s if self.armed and not self.has_reset else math.inf

    def act(self) -> None:
        """Reset the computer."""
        self.has_reset = True
        self._rig.switch_supply(False)
