"""The packed form of the telemetry channels: what the robot says of itself several times a second.

Big-endian: time [s] (IEEE double), number of the phase (1 byte), index of the hop (2), then each channel of the
dictionary in its order: one byte for a bool, an IEEE single for anything else (not-a-number: no
reading).
`hopper dictionary export --xtce FILE` describes the same bytes to a mission control system.
"""

from __future__ import annotations

import json
import math
import struct
from functools import cache
from typing import Any

from hal.dictionary import dictionary
from hal.link.packets import BadPacket

TOPIC = "channels"
_HEAD = "dBH"


def pack_channels(text: str) -> bytes:
    """The bytes of a message that is JSON text. Raises `BadPacket` when a channel or the phase is not there."""
    message = json.loads(text)
    try:
        head = (message["time_s"], dictionary().phases[message["phase"]], message["hop_index"])
        values = [_packed(message[name]) for name in dictionary().channels]
        return _layout().pack(*head, *values)
    except (KeyError, TypeError, struct.error) as error:
        raise BadPacket(f"the channels cannot be packed: {type(error).__name__} {error}") from error


def unpack_channels(data: bytes) -> str:
    """The message as JSON text. Raises `BadPacket`."""
    if len(data) != _layout().size:
        raise BadPacket(f"channels of {len(data)} bytes; by this dictionary they have {_layout().size}")
    time_s, number, hop_index, *values = _layout().unpack(data)
    phase = next((name for name, each in dictionary().phases.items() if each == number), None)
    if phase is None:
        raise BadPacket(f"phase {number} is not in the dictionary")
    message: dict[str, Any] = {"time_s": time_s, "phase": phase, "hop_index": hop_index}
    for (name, entry), value in zip(dictionary().channels.items(), values, strict=True):
        message[name] = bool(value) if entry.unit == "bool" else (value if math.isfinite(value) else None)
    return json.dumps(message)


@cache
def _layout() -> struct.Struct:
    units = [entry.unit for entry in dictionary().channels.values()]
    return struct.Struct(">" + _HEAD + "".join("B" if unit == "bool" else "f" for unit in units))


def _packed(value: float | None) -> float:
    return math.nan if value is None else value
