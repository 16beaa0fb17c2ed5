"""What all drivers share: being closed once and for all."""

from __future__ import annotations

from hal.errors import DeviceClosed


class PiDevice:
    """A device with a name; `close` makes it safe and unusable."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._closed = False

    def close(self) -> None:
        """Leave the device safe and unusable. May be called again."""
        if not self._closed:
            self._closed = True
            self._make_safe()

    def _make_safe(self) -> None:
        """Take the power from an actuator, end what samples a sensor."""

    def _require_open(self) -> None:
        if self._closed:
            raise DeviceClosed(f"{self._name}: used after it was closed")
