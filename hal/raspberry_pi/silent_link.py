"""A ground link without a radio: no command ever comes, telemetry goes nowhere but into the log."""

from __future__ import annotations

from hal.raspberry_pi.device import PiDevice
from hal.readings import GroundCommand


class SilentLink(PiDevice):
    """The robot flies the mission that it was started with."""

    def receive(self) -> tuple[GroundCommand, ...]:
        """No command."""
        self._require_open()
        return ()

    def send(self, topic: str, payload: str) -> None:
        """Let the message go."""
        self._require_open()
