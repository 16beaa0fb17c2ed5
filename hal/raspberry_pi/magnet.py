"""The release magnet on a PWM: full supply until the lock has surely opened, then a duty that holds it."""

from __future__ import annotations

from collections.abc import Callable

from hal.devices import Clock
from hal.errors import DeviceError
from hal.raspberry_pi.device import PiDevice
from hal.raspberry_pi.ports import Sampler
from hal.raspberry_pi.pwm import PwmChannel
from hal.raspberry_pi.settings import MagnetSettings
from hal.raspberry_pi.wire import commanded


class PwmMagnet(PiDevice):
    """The magnet; off from the start.

    At the end of the peak the coil's current is looked at; one that is too small makes the next command raise
    `DeviceError`, after it was carried out.
    """

    def __init__(
        self,
        name: str,
        pwm: PwmChannel,
        clock: Clock,
        sampler: Sampler,
        current_a: Callable[[], float | None],
        settings: MagnetSettings,
    ) -> None:
        """`current_a` tells the newest measured current [A], None when there is none."""
        super().__init__(name)
        self._pwm, self._clock, self._sampler = pwm, clock, sampler
        self._current_a, self._settings = current_a, settings
        self._call_off: Callable[[], None] = lambda: None
        self._complaint = ""
        commanded(name, pwm.off)

    def switch_on(self) -> None:
        """Apply the supply to the coil."""
        self._require_open()
        self._call_off()
        commanded(self._name, lambda: self._pwm.set_duty(1.0))
        self._call_off = self._sampler.once(self._clock.now_s() + self._settings.peak_s, self._hold)
        self._complain()

    def switch_off(self) -> None:
        """Take the supply from the coil."""
        self._require_open()
        self._make_safe()
        self._complain()

    def _make_safe(self) -> None:
        self._call_off()
        commanded(self._name, self._pwm.off)

    def _hold(self, _now_s: float) -> None:
        measured_a, least_a = self._current_a(), self._settings.min_current_a
        if measured_a is None or abs(measured_a) < least_a:
            shown = "not measured" if measured_a is None else f"{measured_a:.3f} A"
            self._complaint = f"{self._name}: its current was {shown} at full supply, {least_a:g} A are due"
        try:
            self._pwm.set_duty(self._settings.hold_duty)
        except OSError as error:
            self._complaint = f"{self._name}: cannot be held ({error})"

    def _complain(self) -> None:
        complaint, self._complaint = self._complaint, ""
        if complaint:
            raise DeviceError(complaint)
