"""What the flight software costs on board: memory, start, the tick, growth, jitter.

    python -m benchmarks.onboard [--json FILE] [--hours H] [--jitter-s S]

`start_s` and `rss_mb`: a fresh `python -m flight` (its modules, the Raspberry Pi's drivers, settings and mission), up
to where it asks for the board; the least of five starts, and the resident memory there. `start_cpu_s` is its
processor time.

`tick_us_*`: processor time of one tick over a whole mission of one hop, with all messages handed to the log (whose
own thread is not counted), without the time that the (simulated) devices take, and without what measuring that adds
(found on a device that does nothing); the tick that evaluates the hop is counted apart, as `evaluation_ms`. The
mission is flown at the shipped 200 Hz, to which the monitors are tuned, so a tick takes in eight samples of each fast
sensor; at 1 kHz it would be two. `tick_no_log_us_median` is the same without the log.

`machine_code`: 1 where the flight software ran as machine code (`hopper compile`), 0 by its sources.

`growth_kb_per_hour`: slope of the resident memory while the robot hops on at 200 Hz for `--hours` of simulated time,
the collector off and the log in files as in flight, written before each tick ends, the first quarter left out. The
simulated robot is in the same process: what grows of it counts, too, but for what it leaves in cycles, which is
collected after each hop. `growth_blocks_per_hour` is the slope of the number of Python's memory blocks in use:
whether objects pile up, or only the C library's heap is full of holes. `growth_*_sigma` are the standard errors.
`flight_garbage` is how many objects of flight's own classes were left in cycles.

`loop_late_*`: how late the ticks of the flight software begin in real time on this machine, with SCHED_FIFO where
that is permitted: the first `--jitter-s` seconds of a mission, its readings from a record. `jitter_*`: the same of a
task at 1 kHz that does nothing but wait.
"""

from __future__ import annotations

import argparse
import gc
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

import flight
from benchmarks.figures import write_figures
from benchmarks.growth import growth_per_hour
from benchmarks.kill import Resting
from benchmarks.real_time import (
    FLOATS,
    histogram,
    jitter_us,
    loop_late_us,
    open_on_sand,
    plan,
    real_time,
    recorded,
)
from benchmarks.tick_meter import TickMeter
from flight import settings as flight_settings
from flight.__main__ import KEPT_REPORTS
from flight.background_log import BackgroundLog
from flight.executive import Progress, fly
from flight.log import McapLog
from flight.states import STOWED
from hal.log import NullLog
from hal.tap import tap_board

STARTS = 5
FLIGHTS = 5
WAITING = 1_000_000
"""Messages that may wait: this machine simulates faster than a log of a flight in real time has to be."""

HOP_S = 22.0
"""About what a hop of 6 J takes, with homing and tensioning."""

LEAST_HOURS = 0.1

LOOK_S = 10.0
"""Time between two looks at the memory, which are kept in it."""

STARTING = """
import sys, time
started = float(sys.argv[1])
import flight.__main__ as entry
import hal.raspberry_pi.board, hal.raspberry_pi.kernel
def opened(name, settings):
    import resource
    taken = time.clock_gettime(time.CLOCK_MONOTONIC) - started
    status = open("/proc/self/status").read()
    print(taken, time.process_time(), int(status.partition("VmRSS:")[2].split()[0]) / 1024)
    raise SystemExit
entry.open_board = opened
entry.main(["--board", "raspberry_pi", "--mission", sys.argv[2], "--log", sys.argv[3]])
"""


def start_and_memory() -> tuple[float, float, float]:
    """Least time and processor time to start [s], and resident memory at its end [MB]."""
    found = []
    for _ in range(STARTS):
        with tempfile.TemporaryDirectory() as folder:
            mission = Path(folder) / "mission.yaml"
            mission.write_text(
                "name: one\nhops:\n  - {energy_j: 6.0, surface: quartz_sand}\n", encoding="utf-8"
            )
            now_s = time.clock_gettime(time.CLOCK_MONOTONIC)
            done = subprocess.run(
                [sys.executable, "-c", STARTING, str(now_s), str(mission), str(Path(folder) / "flight.mcap")],
                capture_output=True,
                text=True,
                check=True,
            )
            found.append(tuple(float(part) for part in done.stdout.split()))
    taken, cpu, memory = np.array(found).T
    return float(taken.min()), float(cpu.min()), float(memory.max())


def ticks(logged: bool) -> FLOATS:
    """Processor time of each tick [us] of a mission of one hop: the least of several flights of it."""
    flights = np.array([ticks_of_flight(logged) for _ in range(FLIGHTS)])
    usual, seldom = np.percentile(flights, (50.0, 99.9))
    print(
        f"  {FLIGHTS} flights {'with' if logged else 'without'} log, {flights.shape[1]} ticks each; "
        f"of all of them {usual:.1f} us median, {seldom:.0f} us at 99.9 %"
    )
    return np.asarray(flights.min(axis=0))


def ticks_of_flight(logged: bool) -> list[float]:
    """Processor time of each tick [us] of one flight; its start is left out."""
    with tempfile.TemporaryDirectory() as folder, open_on_sand() as board:
        meter = TickMeter(board)
        log: BackgroundLog | NullLog = NullLog()
        if logged:
            log = BackgroundLog(McapLog(Path(folder) / "flight.mcap", {}), WAITING)
        flown = tap_board(meter.board, log) if logged else meter.board
        gc.collect()
        gc.freeze()
        gc.disable()
        result = fly(flown, flight_settings.load(), plan(1), log)
        gc.enable()
        if isinstance(log, BackgroundLog):
            log.close()
    if result.end_reason != STOWED:  # half a mission has ticks, too
        raise RuntimeError(
            f"the mission whose ticks were timed ended as {result.end_reason!r}, not {STOWED!r}"
        )
    return meter.ticks_us[5:]


class Growth:
    """Watches resident memory, and collects after each hop what was left in cycles."""

    def __init__(self) -> None:
        self.points: list[tuple[float, float]] = []
        self.blocks: list[tuple[float, float]] = []
        self.flight_garbage = 0
        self._hops = 0

    def __call__(self, progress: Progress) -> None:
        """Look once."""
        if progress.hop_index != self._hops:
            self._hops = progress.hop_index
            self._collect()
            self.blocks.append((progress.time_s, float(sys.getallocatedblocks())))
        if not self.points or progress.time_s - self.points[-1][0] >= LOOK_S:
            self.points.append((progress.time_s, _resident_kb()))

    def _collect(self) -> None:
        gc.set_debug(gc.DEBUG_SAVEALL)
        gc.collect()
        ours = ("flight.", "hal.")
        self.flight_garbage += sum(type(found).__module__.startswith(ours) for found in gc.garbage)
        gc.set_debug(0)
        gc.garbage.clear()
        gc.collect()


def late_growth(points: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Slope an hour without the first quarter, and its sigma."""
    times, values = np.array(points).T
    late = times > 0.25 * times[-1]
    return growth_per_hour(times[late], values[late])


def growth(hours: float) -> Growth:
    """Hop on for so many hours of simulated time."""
    seen, settings = Growth(), flight_settings.load()
    with (
        tempfile.TemporaryDirectory() as folder,
        open_on_sand() as board,
        BackgroundLog(
            McapLog(Path(folder) / "flight.mcap", {}, settings.log), WAITING, simulated_time=True
        ) as log,
    ):
        gc.collect()
        gc.disable()
        mission = plan(max(2, round(hours * 3600.0 / HOP_S)))
        resting = replace(board, clock=Resting(board.clock, log))
        result = fly(tap_board(resting, log), settings, mission, log, seen, kept_reports=KEPT_REPORTS)
        gc.enable()
    (_, first_kb), (last_s, last_kb) = seen.points[0], seen.points[-1]
    print(
        f"  {result.made} hops in {last_s / 60.0:.1f} simulated minutes, {result.end_reason}; "
        f"resident {first_kb / 1024:.1f} to {last_kb / 1024:.1f} MB"
    )
    return seen


def _resident_kb() -> float:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 1024.0


def measure(hours: float, jitter_s: float) -> dict[str, tuple[float, str]]:
    """All figures: value and unit by name."""
    figures: dict[str, tuple[float, str]] = {}
    start_s, cpu_s, memory_mb = start_and_memory()
    figures["rss_mb"], figures["start_s"], figures["start_cpu_s"] = (
        (memory_mb, "MB"),
        (start_s, "s"),
        (cpu_s, "s"),
    )
    logged = np.sort(ticks(logged=True))
    figures["tick_us_median"] = (float(np.median(logged[:-1])), "us")
    figures["tick_us_p999"] = (float(np.percentile(logged[:-1], 99.9)), "us")
    figures["evaluation_ms"] = (float(logged[-1]) / 1e3, "ms")
    figures["tick_no_log_us_median"] = (float(np.median(ticks(logged=False))), "us")
    grown = growth(hours)
    for name, points, unit in (("kb", grown.points, "kB/h"), ("blocks", grown.blocks, "1/h")):
        slope, sigma = late_growth(points)
        figures[f"growth_{name}_per_hour"], figures[f"growth_{name}_sigma"] = (slope, unit), (sigma, unit)
    figures["machine_code"] = (float(flight.COMPILED), "1")
    figures["flight_garbage"] = (float(grown.flight_garbage), "1")
    messages = recorded(jitter_s)
    with real_time() as scheduler:
        measured = {"loop_late": loop_late_us(messages), "jitter": jitter_us(jitter_s)}
    for name, what in (("loop_late", "the flight software at 200 Hz"), ("jitter", "a sleeper at 1 kHz")):
        late_us = measured[name]
        print(f"  {what}, {late_us.size} ticks under {scheduler}, is late by:")
        print(histogram(late_us))
        figures[f"{name}_us_median"] = (float(np.median(late_us)), "us")
        figures[f"{name}_us_p999"] = (float(np.percentile(late_us, 99.9)), "us")
    return figures


def main() -> None:
    """Measure, print, and write the figures where asked."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", type=Path, help="write the figures here")
    parser.add_argument("--hours", type=float, default=1.0, help="simulated time for the growth of memory")
    parser.add_argument("--jitter-s", type=float, default=5.0, help="real time for the jitter")
    arguments = parser.parse_args()
    if not arguments.hours >= LEAST_HOURS:
        parser.error(
            f"--hours {arguments.hours}: at least {LEAST_HOURS}, or there are too few hops for a slope"
        )
    figures = measure(arguments.hours, arguments.jitter_s)
    for name, (value, unit) in figures.items():
        print(f"{name:24s} {value:10.4g} {unit}")
    if arguments.json:
        write_figures(arguments.json, figures)


if __name__ == "__main__":
    main()
