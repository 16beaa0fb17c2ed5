"""CCSDS space packets (CCSDS 133.0-B-2, section 4): a header of six bytes, and data.

Written here because this header is all that the link needs of the standard; the tests hold it to the `spacepackets`
library, which would bring a compiled extension on board.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

_HEADER = struct.Struct(">HHH")
HEADER_BYTES = _HEADER.size
APID_LIMIT, COUNT_LIMIT = 1 << 11, 1 << 14
UNSEGMENTED = 3


class BadPacket(ValueError):
    """Bytes that are no packet of this link; the message says why."""


@dataclass(frozen=True)
class SpacePacket:
    """One packet: telecommand or telemetry, its application (0-2047), its count (0-16383) and its data."""

    telecommand: bool
    apid: int
    count: int
    data: bytes

    def encode(self) -> bytes:
        """The packet as bytes. Raises `BadPacket` for a number that does not fit, or no data."""
        if not (0 <= self.apid < APID_LIMIT and 0 <= self.count < COUNT_LIMIT):
            raise BadPacket(f"apid {self.apid} or count {self.count} does not fit the header")
        if not 1 <= len(self.data) <= 65536:
            raise BadPacket(f"{len(self.data)} bytes of data do not fit a packet")
        first = (int(self.telecommand) << 12) | self.apid
        return _HEADER.pack(first, (UNSEGMENTED << 14) | self.count, len(self.data) - 1) + self.data

    @classmethod
    def decode(cls, raw: bytes) -> SpacePacket:
        """The packet in exactly these bytes. Raises `BadPacket`."""
        if len(raw) <= HEADER_BYTES:
            raise BadPacket(f"{len(raw)} bytes are too few for a packet")
        first, second, length = _HEADER.unpack_from(raw)
        if first >> 13:
            raise BadPacket(f"packet version {first >> 13} is unknown")
        if first & 0x0800:
            raise BadPacket("a secondary header is not used here")
        if second >> 14 != UNSEGMENTED:
            raise BadPacket("segmented packets are not used here")
        if length + 1 != len(raw) - HEADER_BYTES:
            raise BadPacket(
                f"the header promises {length + 1} bytes of data, there are {len(raw) - HEADER_BYTES}"
            )
        return cls(bool(first & 0x1000), first & 0x07FF, second & 0x3FFF, raw[HEADER_BYTES:])
