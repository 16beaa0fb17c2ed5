"""Frames on a serial line: consistent overhead byte stuffing (Cheshire and Baker 1999) and CRC-16-CCITT.

A zero byte ends each frame and stands nowhere else, so that a receiver is in step again after the next one, whatever
was lost.
"""

from __future__ import annotations

import binascii
from collections.abc import Iterator

_CRC_BYTES = 2
END = b"\0"


def framed(packet: bytes) -> bytes:
    """A packet as a frame: check sum appended, zeros stuffed, end mark."""
    return _stuffed(packet + _check(packet)) + END


class Deframer:
    """Takes bytes as they come and gives packets whose check sum holds. Keeps at most one frame of bytes."""

    def __init__(self, longest: int) -> None:
        self._longest = longest + _CRC_BYTES + longest // 254 + 2
        self._pending = bytearray()
        self._skipping = False
        self.damaged = 0
        """Frames that were cut, changed or too long."""

    @property
    def held_bytes(self) -> int:
        """Bytes of the unfinished frame."""
        return len(self._pending)

    def feed(self, data: bytes) -> Iterator[bytes]:
        """The packets completed by these bytes."""
        *ended, rest = data.split(END)
        for piece in ended:
            self._keep(piece)
            frame, skipped = bytes(self._pending), self._skipping
            self._pending.clear()
            self._skipping = False
            if skipped:
                self.damaged += 1
            elif frame:
                packet = _unframed(frame)
                if packet is None:
                    self.damaged += 1
                else:
                    yield packet
        self._keep(rest)

    def _keep(self, piece: bytes) -> None:
        if len(self._pending) + len(piece) > self._longest:
            self._skipping = True
            self._pending.clear()
        if not self._skipping:
            self._pending += piece


def _unframed(frame: bytes) -> bytes | None:
    content = _unstuffed(frame)
    if content is None or len(content) <= _CRC_BYTES:
        return None
    packet, check = content[:-_CRC_BYTES], content[-_CRC_BYTES:]
    return packet if check == _check(packet) else None


def _check(packet: bytes) -> bytes:
    return binascii.crc_hqx(packet, 0xFFFF).to_bytes(_CRC_BYTES, "big")


def _stuffed(data: bytes) -> bytes:
    out = bytearray()
    for block in data.split(END):
        whole = len(block) // 254 * 254
        for start in range(0, whole, 254):
            out += b"\xff" + block[start : start + 254]
        out.append(len(block) - whole + 1)
        out += block[whole:]
    return bytes(out)


def _unstuffed(frame: bytes) -> bytes | None:
    out, at = bytearray(), 0
    while at < len(frame):
        code = frame[at]
        if code == 0 or at + code > len(frame):
            return None
        out += frame[at + 1 : at + code]
        at += code
        if code != 255 and at < len(frame):
            out.append(0)
    return bytes(out)
