"""What carries the bytes: a serial line, or a pair of ends in one process. Neither ever waits."""

from __future__ import annotations

import os
from typing import Protocol

import serial

from hal.errors import BoardUnavailable, DeviceError


class ByteStream(Protocol):
    """Bytes in, bytes out, without waiting."""

    def read(self, most: int) -> bytes:
        """What has arrived, at most so many bytes. Raises `DeviceError` when the line is gone."""

    def write(self, data: bytes) -> int:
        """Hand over what fits now; returns how many bytes. Raises `DeviceError` when the line is gone."""

    def close(self) -> None:
        """Give the line back. May be called again."""


class LoopbackEnd:
    """One end of a line within a process; what does not fit `depth` bytes waits with the writer."""

    def __init__(self, depth: int) -> None:
        self._depth = depth
        self._arrived = bytearray()
        self.other: LoopbackEnd | None = None

    def read(self, most: int) -> bytes:
        """What has arrived, at most so many bytes."""
        taken = bytes(self._arrived[:most])
        del self._arrived[:most]
        return taken

    def write(self, data: bytes) -> int:
        """Hand over what fits."""
        if self.other is None:
            return 0
        fits = data[: max(0, self._depth - len(self.other._arrived))]
        self.other._arrived += fits
        return len(fits)

    def close(self) -> None:
        """Nothing to give back."""


def loopback(depth: int = 65536) -> tuple[LoopbackEnd, LoopbackEnd]:
    """The two ends of a line."""
    ends = LoopbackEnd(depth), LoopbackEnd(depth)
    ends[0].other, ends[1].other = ends[1], ends[0]
    return ends


class SerialLine:
    """A serial port."""

    def __init__(self, port: str, baud: int) -> None:
        try:
            self._port = serial.Serial(port, baud, timeout=0, write_timeout=0)
        except (serial.SerialException, ValueError) as error:
            raise BoardUnavailable(f"{port}: the serial line cannot be opened ({error})") from error

    def read(self, most: int) -> bytes:
        """What has arrived, at most so many bytes."""
        try:
            return bytes(self._port.read(most))
        except (serial.SerialException, OSError) as error:
            raise DeviceError(f"{self._port.port}: {error}") from error

    def write(self, data: bytes) -> int:
        """Hand over what fits now."""
        try:  # the port's own write goes round in circles for as long as a line is full
            return os.write(self._port.fileno(), data)
        except BlockingIOError:
            return 0
        except (serial.SerialException, OSError) as error:
            raise DeviceError(f"{self._port.port}: {error}") from error

    def close(self) -> None:
        """Close the port."""
        self._port.close()
