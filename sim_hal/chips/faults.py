"""Faults of the wire, planted by place and time.

| kind | on I²C | on the serial line of the motor controller |
| --- | --- | --- |
| `nack` | nobody acknowledges the address | |
| `timeout` | a clock held low until the kernel gives up | no answer |
| `stuck` | a line of the whole bus held low | |
| `short` | a block comes with half of its bytes (words have no such fault) | half of an answer |
| `crc` | bits of data turn over | bits of an answer turn over |
| `unplug` | gone amid a read: the rest reads as ones, then nobody acknowledges | half of an answer, then none |
| `brown_out` | once: all registers as at power-up | once: settings and count as at power-up |
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from hal.errors import ConfigError

I2C_BLOCKS = ("nack", "timeout", "stuck", "short", "crc", "unplug", "brown_out")
I2C_WORDS = tuple(kind for kind in I2C_BLOCKS if kind != "short")
SERIAL = ("timeout", "short", "crc", "unplug", "brown_out")
"""The faults of each kind of wire."""


@dataclass
class WireFault:
    """One fault at one place, active while `from_s` <= now < `until_s`; `used` counts how often it struck."""

    place: str
    kind: str
    from_s: float
    until_s: float
    used: int = 0


class WireFaults:
    """The faults of one board's wires; more can be planted while it runs."""

    def __init__(self, places: Mapping[str, tuple[str, ...]]) -> None:
        """`places`: names of devices, and the kinds of faults that their wires can have."""
        self._places = places
        self._faults: list[WireFault] = []

    def plant(self, place: str, kind: str, from_s: float, until_s: float | None = None) -> WireFault:
        """Add a fault. Raises `ConfigError` for a place or kind that does not exist."""
        kinds = self._places.get(place, ())
        for value, known, what in ((place, tuple(self._places), "place"), (kind, kinds, "kind")):
            if value not in known:
                raise ConfigError(
                    f"wire faults: {what} = {value!r} is unknown; known here: {', '.join(known)}"
                )
        fault = WireFault(place, kind, from_s, math.inf if until_s is None else until_s)
        self._faults.append(fault)
        return fault

    def active(self, place: str, now_s: float) -> WireFault | None:
        """The fault that `place` has at `now_s` (the first planted wins), or None; a brown-out strikes once."""
        for fault in self._faults:
            if fault.place == place and fault.from_s <= now_s < fault.until_s:
                if fault.kind == "brown_out" and fault.used:
                    continue
                return fault
        return None
