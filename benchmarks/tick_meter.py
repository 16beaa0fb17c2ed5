"""What a tick of the flight software costs in processor time, without the devices."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from hal.board import Board
from hal.calls import board_calls


class Expense:
    """Adds up the processor time that devices take, and how often they are asked."""

    def __init__(self) -> None:
        self.spent_ns = self.calls = 0

    def pay(self, call: Callable[..., Any], plain: tuple[Any, ...], named: dict[str, Any]) -> Any:
        """Make a call of a device at its own expense."""
        start_ns = time.thread_time_ns()
        try:
            return call(*plain, **named)
        finally:
            self.spent_ns += time.thread_time_ns() - start_ns
            self.calls += 1


class _Metered:
    def __init__(self, device: Any, expense: Expense) -> None:
        self._device, self._expense = device, expense

    def __getattr__(self, name: str) -> Any:
        member = getattr(self._device, name)
        if not callable(member):
            return member

        def call(*plain: Any, **named: Any) -> Any:
            return self._expense.pay(member, plain, named)

        setattr(self, name, call)
        return call


class _Idle:
    def read(self) -> None:
        """Do nothing."""


def metering_ns() -> float:
    """What metering adds to a call of a device outside the device's own time, at the least."""

    def outside_ns(read: Callable[[], Any], expense: Expense) -> float:
        start_ns = time.thread_time_ns()
        for _ in range(500):
            read()
        return (time.thread_time_ns() - start_ns - expense.spent_ns) / 500

    idle, found = _Idle(), []
    for _ in range(20):
        expense = Expense()
        found.append(outside_ns(_Metered(idle, expense).read, expense) - outside_ns(idle.read, Expense()))
    return max(0.0, min(found))


class TickMeter:
    """Stands between tap and board: notes each tick's processor time without the devices' and its own."""

    def __init__(self, board: Board) -> None:
        self.ticks_us: list[float] = []
        self._own_ns, self._expense = metering_ns(), Expense()
        devices: dict[str, Any] = {
            name: _Metered(getattr(board, name), self._expense) for name in board_calls() if name != "clock"
        }
        self.board = Board(name=board.name, clock=_TickClock(board.clock, self), **devices)
        self._began_ns = time.thread_time_ns()

    def wait(self, call: Callable[[float], None], time_s: float) -> None:
        """End a tick, let time pass, and begin the next."""
        took_ns, expense = time.thread_time_ns() - self._began_ns, self._expense
        self.ticks_us.append((took_ns - expense.spent_ns - expense.calls * self._own_ns) / 1e3)
        call(time_s)
        expense.spent_ns = expense.calls = 0
        self._began_ns = time.thread_time_ns()


class _TickClock:
    def __init__(self, clock: Any, meter: TickMeter) -> None:
        self._clock, self._meter = clock, meter
        self.now_s = clock.now_s

    def sleep_until_s(self, time_s: float) -> None:
        """Wait; the tick ends here."""
        self._meter.wait(self._clock.sleep_until_s, time_s)
