"""Two watchdogs under one stroke.

The supervisor outside the computer (a watchdog timer and a latch, docs/bring-up.md) feeds the actuators. It wants
an edge on the heartbeat pin within its time; else it takes the supply away for good. A pulse on the arm pin gives
it back, and is sent once, with the first stroke after opening. The kernel's watchdog resets a computer that hangs.
"""

from __future__ import annotations

from hal.errors import DeviceError
from hal.raspberry_pi.device import PiDevice
from hal.raspberry_pi.ports import Pins, WatchdogDevice
from hal.raspberry_pi.settings import WatchdogSettings


class PiWatchdog(PiDevice):
    """Heartbeat and kernel watchdog. Before the first stroke, and after the last, the actuators have no supply."""

    def __init__(self, name: str, pins: Pins, device: WatchdogDevice, settings: WatchdogSettings) -> None:
        super().__init__(name)
        self._pins, self._device, self._settings = pins, device, settings
        self._armed = False
        self._level = False
        pins.claim_output(settings.heartbeat_pin, False)
        pins.claim_output(settings.arm_pin, False)

    @property
    def timeout_s(self) -> float:
        """Longest allowed time between two strokes."""
        return self._settings.timeout_s

    def stroke(self) -> None:
        """Say that the flight software is alive. Raises `DeviceError` when that could not be said."""
        self._require_open()
        try:
            self._level = not self._level
            self._pins.write(self._settings.heartbeat_pin, self._level)
            self._device.keep_alive()
            if not self._armed:
                self._pins.write(self._settings.arm_pin, True)
                self._pins.write(self._settings.arm_pin, False)
                self._armed = True
        except OSError as error:
            raise DeviceError(f"{self._name}: the heartbeat does not get out ({error})") from error

    def _make_safe(self) -> None:
        # no more edges: the supervisor takes the supply; nothing is left for the kernel to guard
        self._device.disarm()
