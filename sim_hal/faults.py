"""Planted faults: a device that is broken from one time to another.

| kind | a sensor | an actuator |
| --- | --- | --- |
| `fail` | reads raise `ReadFailed` | commands raise `DeviceError` |
| `stick` | keeps delivering its last value | stays as it was last commanded |
| `silent` | delivers no new sample | loses its power |
| `offset` | reads `size` too much (units of its channel) | |
| `scale` | reads `size` times the truth | |
| `noise` | carries more noise: `size` (1 sigma) | |
| `flicker` | each read fails with probability `size` | |
| `short` | | magnet: `size` times its current shows |

and of what is neither: `lock` `fail`: it does not take the string when the nut is at home; `supply` `sag` by
`size` volts; `clock` `jump` forward by `size` seconds at once; `clock` `late`: each wait lasts `size` seconds too
long. `crash`: a driver raises what no driver should.

A motor without power is one at 0 V: its driver shorts the terminals, so it brakes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from hal.errors import ConfigError
from sim_hal.settings import FaultSettings

KINDS = (
    "fail",
    "stick",
    "silent",
    "offset",
    "scale",
    "noise",
    "flicker",
    "short",
    "sag",
    "jump",
    "late",
    "crash",
)
DEVICES = (
    "motor",
    "magnet",
    "nut_encoder",
    "motor_current",
    "spring",
    "accelerometer",
    "magnet_current",
    "switches",
    "lock",
    "supply",
    "clock",
)


@dataclass(frozen=True)
class Fault:
    """One fault of one device, active while `from_s` <= now < `until_s`."""

    device: str
    kind: str
    from_s: float
    until_s: float = math.inf
    size: float = 0.0


class Faults:
    """The faults of one board; more can be planted while it runs."""

    def __init__(self) -> None:
        self._faults: dict[str, list[Fault]] = {}  # by device
        self.planted = False
        """Whether there is any: looked at by each device at each call."""
        self.effects_s: dict[Fault, float] = {}
        """When each first changed what the flight software reads, or what an actuator does; not, if it never did."""

    def plant(
        self, device: str, kind: str, from_s: float, until_s: float | None = None, size: float = 0.0
    ) -> None:
        """Add a fault. Raises `ConfigError` for a device or kind that does not exist."""
        if device not in DEVICES:
            raise ConfigError(f"faults: device = {device!r} is unknown; known here: {', '.join(DEVICES)}")
        if kind not in KINDS:
            raise ConfigError(f"faults: kind = {kind!r} is unknown; known here: {', '.join(KINDS)}")
        fault = Fault(device, kind, from_s, math.inf if until_s is None else until_s, size)
        self._faults.setdefault(device, []).append(fault)
        self.planted = True

    def note(self, fault: Fault, now_s: float) -> None:
        """A fault makes a difference now."""
        self.effects_s.setdefault(fault, now_s)

    def plant_all(self, faults: tuple[FaultSettings, ...]) -> None:
        """Add the faults of a settings file."""
        for fault in faults:
            self.plant(fault.device, fault.kind, fault.from_s, fault.until_s, fault.size)

    def active(self, device: str, now_s: float) -> str | None:
        """Kind of the fault that `device` has at `now_s` (the first planted wins), or None."""
        fault = self.of(device, now_s)
        return fault.kind if fault else None

    def of(self, device: str, now_s: float) -> Fault | None:
        """The fault that `device` has at `now_s` (the first planted wins), or None."""
        for fault in self._faults.get(device, ()):
            if fault.from_s <= now_s < fault.until_s:
                return fault
        return None
