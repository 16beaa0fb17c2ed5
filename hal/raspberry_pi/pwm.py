"""Hardware PWM by the kernel's files (Documentation/driver-api/pwm.rst, "Using PWMs with the sysfs interface").

A channel is asked for by its number in `export`; then its folder `pwmN` holds `period` and `duty_cycle` in
nanoseconds and `enable`. A duty longer than the period, or a period shorter than the duty, is refused.
"""

from __future__ import annotations

import contextlib
import errno

from hal.raspberry_pi.ports import Sysfs
from hal.raspberry_pi.settings import PwmSettings


class PwmChannel:
    """One channel, off from the start. All calls raise `OSError` as the kernel answers."""

    def __init__(self, sysfs: Sysfs, settings: PwmSettings) -> None:
        self._sysfs = sysfs
        self._chip = f"class/pwm/pwmchip{settings.chip}"
        self._channel = settings.channel
        self._folder = f"{self._chip}/pwm{settings.channel}"
        self._period_ns = round(1e9 / settings.frequency_hz)
        if not sysfs.exists(self._folder):  # it stays exported when a program dies
            with contextlib.suppress(FileExistsError):
                self._export()
        self.off()
        self._write("period", self._period_ns)

    def _export(self) -> None:
        try:
            self._sysfs.write(f"{self._chip}/export", str(self._channel))
        except OSError as error:
            if error.errno != errno.EBUSY:  # somebody else exported it meanwhile
                raise

    def set_duty(self, share: float) -> None:
        """High for this share (0 to 1) of each period, from the next period on."""
        self._write("duty_cycle", round(share * self._period_ns))
        self._write("enable", 1)

    def off(self) -> None:
        """Low. Each way is tried."""
        try:
            self._write("duty_cycle", 0)
        finally:
            # a channel that was never given a period cannot be enabled, and need not be disabled
            if self._sysfs.read(f"{self._folder}/enable") != "0":
                self._write("enable", 0)

    def _write(self, name: str, value: int) -> None:
        self._sysfs.write(f"{self._folder}/{name}", str(value))
