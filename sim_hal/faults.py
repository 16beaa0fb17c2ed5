"""Planted faults: a device that fails, sticks or goes silent from a time on.

| kind | a sensor | an actuator |
| --- | --- | --- |
| `fail` | reads raise `ReadFailed` | commands raise `DeviceError` |
| `stick` | keeps delivering its last value | stays as it was last commanded |
| `silent` | delivers no new sample | loses its power |

A motor without power is one at 0 V: its driver shorts the terminals, so it brakes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from hal.errors import ConfigError
from sim_hal.settings import FaultSettings

KINDS = ("fail", "stick", "silent")
DEVICES = (
    "motor",
    "magnet",
    "nut_encoder",
    "motor_current",
    "spring",
    "accelerometer",
    "magnet_current",
    "switches",
)


@dataclass(frozen=True)
class Fault:
    """One fault of one device, active while `from_s` <= now < `until_s`."""

    device: str
    kind: str
    from_s: float
    until_s: float = math.inf


class Faults:
    """The faults of one board; more can be planted while it runs."""

    def __init__(self) -> None:
        self._faults: list[Fault] = []

    def plant(self, device: str, kind: str, from_s: float, until_s: float | None = None) -> None:
        """Add a fault. Raises `ConfigError` for a device or kind that does not exist."""
        if device not in DEVICES:
            raise ConfigError(f"faults: device = {device!r} is unknown; known here: {', '.join(DEVICES)}")
        if kind not in KINDS:
            raise ConfigError(f"faults: kind = {kind!r} is unknown; known here: {', '.join(KINDS)}")
        self._faults.append(Fault(device, kind, from_s, math.inf if until_s is None else until_s))

    def plant_all(self, faults: tuple[FaultSettings, ...]) -> None:
        """Add the faults of a settings file."""
        for fault in faults:
            self.plant(fault.device, fault.kind, fault.from_s, fault.until_s)

    def active(self, device: str, now_s: float) -> str | None:
        """Kind of the fault that `device` has at `now_s` (the first planted wins), or None."""
        for fault in self._faults:
            if fault.device == device and fault.from_s <= now_s < fault.until_s:
                return fault.kind
        return None
