"""A mission that does not come to its end: stopped by hand between two ticks, its log kept and named."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from flight.log import parts_of, read_log
from hal.devices import Clock
from hal.log import LogError


class StoppableClock:
    """A clock at which Ctrl-C ends the flight, at the end of a tick: on record like all that a clock answers.

    So the log shows where the flight was stopped, and its replay stops there, too.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._asked = False

    def now_s(self) -> float:
        """The clock's time."""
        return self._clock.now_s()

    def sleep_until_s(self, time_s: float) -> None:
        """Wait as the clock does. Raises `KeyboardInterrupt` once Ctrl-C was pressed."""
        self._clock.sleep_until_s(time_s)
        if self._asked:
            raise KeyboardInterrupt("stopped by hand")

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Take Ctrl-C meanwhile; one pressed again does not wait for the tick to end."""
        if threading.current_thread() is not threading.main_thread():  # only there can handlers be set
            yield
            return
        before = signal.signal(signal.SIGINT, self._ask)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, before)

    def _ask(self, number: int, frame: FrameType | None) -> None:
        if self._asked:
            raise KeyboardInterrupt
        self._asked = True


@contextmanager
def log_kept(log: Path, folder: Path) -> Iterator[None]:
    """When the block fails, put a log that holds anything beside `folder`, and say so in a note of the error."""
    try:
        yield
    except BaseException as error:
        if _holds_messages(log):
            kept = _free_name(folder.with_name(f"{folder.name}.stopped"))
            kept.mkdir()
            for part in parts_of(log):
                part.rename(kept / part.name)
            error.add_note(f"the log of the flight is kept: {kept / log.name}")
        raise


def _holds_messages(log: Path) -> bool:
    try:
        return log.exists() and bool(read_log(log, recover=True).messages)
    except LogError:
        return False


def _free_name(path: Path) -> Path:
    number, free = 1, path
    while free.exists():
        number += 1
        free = path.with_name(f"{path.name}-{number}")
    return free
