"""Home switch and latch sensor: contacts to ground on two pins that are pulled up."""

from __future__ import annotations

from hal.devices import Clock
from hal.raspberry_pi.device import PiDevice
from hal.raspberry_pi.ports import Pins
from hal.raspberry_pi.settings import SwitchSettings
from hal.raspberry_pi.wire import named_fault
from hal.readings import Switches


class GpioSwitches(PiDevice):
    """The two contacts. A broken wire reads as an open contact: not at home, not latched."""

    def __init__(self, name: str, pins: Pins, clock: Clock, settings: SwitchSettings) -> None:
        super().__init__(name)
        self._pins, self._clock, self._settings = pins, clock, settings
        pins.claim_input(settings.home_pin)
        pins.claim_input(settings.latch_pin)

    def read(self) -> Switches:
        """The state of both contacts now."""
        self._require_open()
        try:
            home, latch = (
                self._pins.read(pin) for pin in (self._settings.home_pin, self._settings.latch_pin)
            )
        except OSError as error:
            raise named_fault(error, self._name) from error
        return Switches(self._clock.now_s(), not home, not latch)
