"""How late the ticks of a loop begin in real time on this machine, for `benchmarks.onboard`."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flight import settings as flight_settings
from flight.executive import fly
from flight.mission import HopPlan, MissionPlan
from hal.config import config_path, read_yaml
from hal.log import LogMessage, MemoryLog
from hal.raspberry_pi.clock import MonotonicClock
from hal.replay import ReplayBoard
from hal.tap import tap_board
from sim_hal.board import SimBoard, open_sim

FLOATS = NDArray[np.float64]


def plan(hops: int) -> MissionPlan:
    """Hops of 6 J off sand."""
    return MissionPlan("onboard", (HopPlan(6.0, "quartz_sand"),) * hops)


def open_on_sand() -> SimBoard:
    """The simulated robot on sand."""
    settings = read_yaml(config_path("boards", "sim.yaml"))
    settings["spots"] = [{"surface": "quartz_sand", "foot": 1, "tilt_deg": 0.0}]
    settings["ground_link"] = {"depth": 100}  # what the simulated ground hears is none of the robot's memory
    return open_sim(settings)


@contextmanager
def real_time() -> Iterator[str]:
    """The real-time scheduler, where it is permitted, and no collector; gives the scheduler's name."""
    scheduler = "SCHED_FIFO"
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(50))
    except PermissionError:
        scheduler = "the usual scheduler (SCHED_FIFO is not permitted)"
    gc.collect()
    gc.disable()
    try:
        yield scheduler
    finally:
        gc.enable()
        os.sched_setscheduler(0, *before)


def jitter_us(duration_s: float) -> FLOATS:
    """How late a sleeper at 1 kHz wakes [us]."""
    clock, late = MonotonicClock(), []
    due_s = clock.now_s()
    for _ in range(round(duration_s * 1000.0)):
        due_s += 1e-3
        clock.sleep_until_s(due_s)
        late.append(1e6 * (clock.now_s() - due_s))
    return np.array(late)


class _Ending:
    """A clock that ends the flight at some time."""

    def __init__(self, clock: Any, end_s: float) -> None:
        self._clock, self._end_s = clock, end_s
        self.now_s = clock.now_s

    def sleep_until_s(self, time_s: float) -> None:
        """Wait, or end the flight, on record."""
        self._clock.sleep_until_s(time_s)
        if time_s >= self._end_s:
            raise KeyboardInterrupt


class _RealTime:
    """The clock of a record, which takes as long as it says, and notes how late it is."""

    def __init__(self, clock: Any) -> None:
        self._clock, self._real = clock, MonotonicClock()
        self.now_s = clock.now_s
        self._start_s: float | None = None
        self.late_us: list[float] = []

    def sleep_until_s(self, time_s: float) -> None:
        """Wait until the tick is due; the first one sets the start."""
        self._clock.sleep_until_s(time_s)
        if self._start_s is None:
            self._start_s = self._real.now_s() - time_s
        due_s = self._start_s + time_s
        self._real.sleep_until_s(due_s)
        self.late_us.append(1e6 * (self._real.now_s() - due_s))


def recorded(duration_s: float) -> tuple[LogMessage, ...]:
    """The record of the first seconds of a mission."""
    log = MemoryLog()
    with open_on_sand() as board, suppress(KeyboardInterrupt):
        ending = replace(board, clock=_Ending(board.clock, duration_s))
        fly(tap_board(ending, log), flight_settings.load(), plan(1), log)
    end = max(index for index, message in enumerate(log.messages) if message.payload.get("method") != "close")
    return tuple(log.messages[: end + 1])


def loop_late_us(messages: tuple[LogMessage, ...]) -> FLOATS:
    """How late each tick of the flight software begins in real time [us]."""
    replayed = ReplayBoard.of(messages, "sim")
    clock = _RealTime(replayed.clock)
    with suppress(KeyboardInterrupt):
        fly(replace(replayed, clock=clock), flight_settings.load(), plan(1), replayed.tape)
    return np.array(clock.late_us[1:])


def histogram(late_us: FLOATS) -> str:
    """Counts by lateness, as text."""
    edges = [0.0, 50.0, 100.0, 200.0, 500.0, 1000.0, 5000.0, np.inf]
    counts, _ = np.histogram(late_us, edges)
    return "\n".join(
        f"  {low:6.0f} to {high:6.0f} us  {count:7d}  {'#' * round(50 * count / late_us.size)}"
        for low, high, count in zip(edges, edges[1:], counts, strict=False)
    )
