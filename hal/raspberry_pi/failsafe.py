"""Outputs off however the program ends, as far as a program can see to that itself.

A signal that ends it (SIGTERM, SIGHUP, SIGINT) becomes an exception, so that every `finally` and `with` on the way
out is honoured; what is registered here is then done once more at the interpreter's exit. Against SIGKILL and a
hanging computer stand the motor controller's own timeout and the supervisor (`hal.raspberry_pi.watchdog`).
"""

from __future__ import annotations

import atexit
import signal
import threading
from collections.abc import Callable
from contextlib import suppress
from types import FrameType
from typing import Any

SIGNALS = (signal.SIGTERM, signal.SIGHUP)
"""SIGINT raises `KeyboardInterrupt` by itself."""


class FailSafe:
    """Ways to take the power from the actuators, tried at exit until `release`."""

    def __init__(self) -> None:
        self._ways: list[Callable[[], None]] = []
        self._before: dict[signal.Signals, Any] = {}
        atexit.register(self.make_safe)
        if threading.current_thread() is threading.main_thread():  # only there can handlers be set
            for number in SIGNALS:
                self._before[number] = signal.signal(number, _leave)

    def add(self, way: Callable[[], None]) -> None:
        """Register one way to take the power."""
        self._ways.append(way)

    def make_safe(self) -> None:
        """Try all ways; one that fails does not keep the others from being tried."""
        for way in self._ways:
            with suppress(Exception):  # there is nobody left to tell
                way()

    def release(self) -> None:
        """The board was closed in order: stand down. May be called again."""
        self._ways.clear()
        atexit.unregister(self.make_safe)
        for number, handler in self._before.items():
            if signal.getsignal(number) is _leave:
                signal.signal(number, handler)
        self._before.clear()


def _leave(number: int, _frame: FrameType | None) -> None:
    raise SystemExit(128 + number)
