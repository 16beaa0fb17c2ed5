"""A serial line of the kernel without hardware: the far end of a pseudo-terminal, and a clock that stands still."""

from __future__ import annotations

import os
import tty
from dataclasses import dataclass


@dataclass(frozen=True)
class StillClock:
    time_s: float = 1.0

    def now_s(self) -> float:
        return self.time_s

    def sleep_until_s(self, time_s: float) -> None:
        raise AssertionError("the link never waits")


class FarEnd:
    """The end of the line that no device file names, as a link sees a stream: reading and writing never wait."""

    def __init__(self, handle: int) -> None:
        self._handle = handle
        os.set_blocking(handle, False)

    def read(self, most: int) -> bytes:
        try:
            return os.read(self._handle, most)
        except BlockingIOError:
            return b""

    def write(self, data: bytes) -> int:
        return os.write(self._handle, data)

    def close(self) -> None:
        os.close(self._handle)


def open_line() -> tuple[FarEnd, int]:
    """The far end, and the handle of the near one, whose device file is `os.ttyname(handle)`."""
    far, near = os.openpty()
    tty.setraw(near)
    return FarEnd(far), near
