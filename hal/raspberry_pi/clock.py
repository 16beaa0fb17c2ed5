"""The computer's monotonic clock, from when the board was opened, and tasks that run at its instants."""

from __future__ import annotations

import heapq
import itertools
import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from hal.errors import CommandRefused
from hal.raspberry_pi.ports import Task


class MonotonicClock:
    """CLOCK_MONOTONIC: not set, never going back, at the rate that time servers keep."""

    def __init__(self) -> None:
        self._start_s = time.monotonic()

    def now_s(self) -> float:
        """Seconds since the board was opened."""
        return time.monotonic() - self._start_s

    def sleep_until_s(self, time_s: float) -> None:
        """Return when `now_s()` has reached `time_s`. Raises `CommandRefused` for a time that is not finite."""
        if not math.isfinite(time_s):
            raise CommandRefused(f"clock: cannot sleep until {time_s!r} s")
        while (left_s := time_s - self.now_s()) > 0.0:
            time.sleep(left_s)


@dataclass(order=True)
class Due:
    """A task and when it is next due; of two at one instant, the one entered first."""

    at_s: float
    entry: int
    task: Task = field(compare=False)
    rate_hz: float = field(compare=False, default=0.0)
    cancelled: bool = field(compare=False, default=False)

    def cancel(self) -> None:
        """Run it no more."""
        self.cancelled = True

    def following(self, now_s: float) -> Due | None:
        """When a repeated task is due again: at whole multiples of its period; those missed are left out.

        A call-off must reach the same object, so it is moved on, not copied.
        """
        if not self.rate_hz:
            return None
        self.at_s = (math.floor(max(now_s, self.at_s) * self.rate_hz + 1e-6) + 1) / self.rate_hz
        return self


class Agenda:
    """Tasks by their due time; not thread-safe."""

    def __init__(self) -> None:
        self._due: list[Due] = []
        self._entries = itertools.count()

    def every(self, rate_hz: float, task: Task, now_s: float) -> Due:
        """Enter a task for each whole multiple of its period after `now_s`."""
        due = Due(now_s, next(self._entries), task, rate_hz)
        due.following(now_s)
        heapq.heappush(self._due, due)
        return due

    def once(self, at_s: float, task: Task) -> Due:
        """Enter a task for one instant."""
        due = Due(at_s, next(self._entries), task)
        heapq.heappush(self._due, due)
        return due

    def next_s(self) -> float:
        """When something is due next; infinity when nothing is."""
        while self._due and self._due[0].cancelled:
            heapq.heappop(self._due)
        return self._due[0].at_s if self._due else math.inf

    def run_next(self, now_s: float) -> None:
        """Run what is due next; `now_s` is the time that it is told."""
        due = heapq.heappop(self._due)
        if due.cancelled:
            return
        due.task(now_s)
        if not due.cancelled and due.following(now_s):
            heapq.heappush(self._due, due)


class ThreadSampler:
    """Runs tasks on a thread of its own. A task that is late is run late; instants that were missed are skipped."""

    def __init__(self, clock: MonotonicClock) -> None:
        self._clock = clock
        self._agenda = Agenda()
        self._change = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="sampler", daemon=True)
        self._thread.start()

    def every(self, rate_hz: float, task: Task) -> Callable[[], None]:
        """Run `task` at whole multiples of the period; returns what ends it."""
        with self._change:
            due = self._agenda.every(rate_hz, task, self._clock.now_s())
            self._change.notify()
        return due.cancel

    def once(self, at_s: float, task: Task) -> Callable[[], None]:
        """Run `task` at one instant; returns what calls it off."""
        with self._change:
            due = self._agenda.once(at_s, task)
            self._change.notify()
        return due.cancel

    def close(self) -> None:
        """Run nothing any more. May be called again."""
        with self._change:
            self._closed = True
            self._change.notify()
        if threading.current_thread() is not self._thread:
            self._thread.join()

    def _run(self) -> None:
        with self._change:
            while not self._closed:
                left_s = self._agenda.next_s() - self._clock.now_s()
                if left_s > 0.0:
                    self._change.wait(None if math.isinf(left_s) else left_s)
                else:
                    self._agenda.run_next(self._clock.now_s())
