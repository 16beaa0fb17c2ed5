"""Kills the flight software at random instants (SIGKILL, in processes of their own) and looks at what is left.

    python -m benchmarks.kill [--json FILE] [--kills N] [--seed N]

One simulated robot lives on: each life starts as the one before left nut, lock and spring, with the same memory file.
A page of shared memory, written by the simulated world and by a tap on the log, outlives the process and holds the
truth. Counted are: kills; lost_arming (the spring was loaded or the robot armed, and the memory does not say so);
fired (the magnet was on in a life in which no fire command had been accepted); corrupt_logs (no whole part can be
read); max_lost_ms (of flight time, between the last message handed to the log and the last one read back).

Simulated time runs as fast as the machine can, without the sleep that ends each tick of a robot; instead each tick
here ends with a wait until the thread of the log has had its turn. SIGKILL leaves what the system holds; a cut
of the power is covered by the memory's fsync, not by this.
"""

from __future__ import annotations

import argparse
import json
import mmap
import os
import random
import signal
import struct
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from benchmarks.figures import write_figures
from flight import settings as flight_settings
from flight.background_log import BackgroundLog
from flight.executive import Progress, fly
from flight.log import McapLog, parts_of, read_log
from flight.mission import HopPlan, MissionPlan
from hal.board import open_board
from hal.config import config_path, read_yaml
from hal.devices import Clock
from hal.errors import ReadFailed
from hal.log import LogError
from hal.memory import FileMemory
from hal.tap import tap_board
from sim_hal.board import SimBoard

LOADED_M = 0.001
STARTING_SHARE = 0.05  # of the kills, while the software starts
START_S = 0.2  # wall time that starting may take
TICK_S = 0.005  # wall time of the order of a tick
_PAGE = struct.Struct("<ddd????I")


@dataclass(frozen=True)
class Truth:
    """What the shared page holds."""

    nut_m: float = 0.001
    compression_m: float = 0.0
    logged_s: float = -1.0
    latched: bool = False
    magnet_on: bool = False
    armed: bool = False
    fired_unasked: bool = False
    fires: int = 0

    def write(self, page: mmap.mmap) -> None:
        """Put it on the page."""
        fields = (self.nut_m, self.compression_m, self.logged_s, self.latched, self.magnet_on, self.armed)
        page[: _PAGE.size] = _PAGE.pack(*fields, self.fired_unasked, self.fires)

    @classmethod
    def read(cls, page: mmap.mmap) -> Truth:
        """What is on the page."""
        return cls(*_PAGE.unpack_from(page))


class Resting:
    """A clock whose ticks end with a rest, as on a robot: the log's thread has its turn."""

    def __init__(self, clock: Clock, log: BackgroundLog) -> None:
        self._clock, self._log = clock, log

    def now_s(self) -> float:
        """Simulated time."""
        return self._clock.now_s()

    def sleep_until_s(self, time_s: float) -> None:
        """Let simulated time pass, and the log write."""
        while self._log.waiting:
            time.sleep(0.0002)
        self._clock.sleep_until_s(time_s)


class Kept(FileMemory):
    """The robot's memory. What it disarms is no longer armed from the moment at which it begins to say so."""

    def __init__(self, path: Path, page: mmap.mmap) -> None:
        super().__init__(path)
        self._page = page

    def write(self, text: str) -> None:
        """Keep a record."""
        if not json.loads(text)["armed"]:
            replace(Truth.read(self._page), armed=False).write(self._page)
        super().write(text)


class Tap:
    """Keeps the page in step with world and log; is the log sink of the flight software."""

    def __init__(self, log: BackgroundLog, page: mmap.mmap) -> None:
        self._log, self._page = log, page

    @property
    def problem(self) -> str:
        """That of the log."""
        return self._log.problem

    def write(self, topic: str, time_s: float, payload: Mapping[str, Any]) -> None:
        """Hand on one message."""
        self._log.write(topic, time_s, payload)
        fire = topic == "event" and payload["name"] == "command_accepted" and payload["command"] == "fire"
        truth = Truth.read(self._page)
        replace(truth, logged_s=time_s, fires=truth.fires + fire).write(self._page)

    def tick_done(self) -> None:
        """Hand that on, too."""
        self._log.tick_done()


def live(folder: Path, number: int, page: mmap.mmap, energy_j: float, seed: int) -> None:
    """One life: fly a mission from what the page says of the robot."""
    settings, before = flight_settings.load(), Truth.read(page)
    found = read_yaml(config_path("boards", "sim.yaml"))
    found["seed"] = seed
    found["initial"] = {"nut_position_m": before.nut_m, "latch_closed": before.latched}
    log = BackgroundLog(McapLog(folder / f"{number}.mcap", {"life": str(number)}), 20000)
    tap = Tap(log, page)
    with open_board("sim", found) as opened:
        assert isinstance(opened, SimBoard)
        world = opened.world

        def look(_: float) -> None:
            truth = Truth.read(page)
            unasked = truth.fired_unasked or (world.magnet_on and truth.fires == 0)
            replace(
                truth,
                nut_m=world.nut_position_m,
                compression_m=world.spring_compression_m if world.latch_closed else 0.0,
                latched=world.latch_closed,
                magnet_on=world.magnet_on,
                fired_unasked=unasked,
            ).write(page)

        def watch(progress: Progress) -> None:
            armed = progress.phase.value in ("armed", "firing")
            replace(Truth.read(page), armed=armed).write(page)

        opened.rig.witnesses.append(look)
        memory = Kept(folder / "spring", page)
        board = replace(opened, memory=memory, clock=Resting(opened.clock, log))
        fly(tap_board(board, tap), settings, MissionPlan("kill", (HopPlan(energy_j, "steel"),)), tap, watch)


def killed(job: Callable[[], None], page: mmap.mmap, at_s: float, after_s: float) -> bool:
    """Run a job in a process of its own and kill it; whether it was still alive then.

    It is killed some wall time [s] after it has come to a flight time [s]: instants are as random on a busy machine
    as on an idle one, and neither depends on where in its tick the job is.
    """
    child = os.fork()
    if child == 0:
        code = 1
        try:
            job()
            code = 0
        finally:
            os._exit(code)
    while Truth.read(page).logged_s < at_s:
        if ended(child):
            return False
        time.sleep(0.0005)
    time.sleep(after_s)
    if ended(child):
        return False
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return True


def ended(child: int) -> bool:
    """Whether a process has ended by itself; ends this one too when that was by an error."""
    done, status = os.waitpid(child, os.WNOHANG)
    if done and os.waitstatus_to_exitcode(status):
        raise SystemExit("a life ended in an error of its own")
    return bool(done)


def judge(folder: Path, number: int, truth: Truth, figures: dict[str, float]) -> None:
    """Look at what a kill has left."""
    figures["kills"] += 1
    figures["kills_while_loaded"] += truth.compression_m > LOADED_M
    figures["kills_while_armed"] += truth.armed
    figures["fired"] += truth.fired_unasked
    try:
        text = FileMemory(folder / "spring").read()
        record = json.loads(text) if text else {"loaded": truth.logged_s < 0.0, "armed": False}
    except (ReadFailed, ValueError):
        record = {"loaded": False, "armed": False}
    lost = truth.compression_m > LOADED_M and not record["loaded"]
    if lost or (truth.armed and not record["armed"]):
        figures["lost_arming"] += 1
        print(f"life {number}: the memory says {record}, but {truth}")
    path = folder / f"{number}.mcap"
    if truth.logged_s < 0.0:
        return  # killed before the first message
    try:
        messages = read_log(path, recover=True).messages
    except LogError as error:
        # a file that was cut before its metadata was whole has lost only what the bound allows
        young = truth.logged_s < 0.1
        figures["corrupt_logs"] += not young
        if not young:
            print(f"life {number}: {error}")
        return
    read_s = messages[-1].time_s if messages else 0.0
    figures["max_lost_ms"] = max(figures["max_lost_ms"], 1e3 * (truth.logged_s - read_s))


def run(kills: int, seed: int) -> dict[str, float]:
    """Kill so many times; returns the figures."""
    names = ("kills", "lost_arming", "fired", "corrupt_logs", "max_lost_ms")
    figures = dict.fromkeys((*names, "kills_while_loaded", "kills_while_armed", "lives", "hops"), 0.0)
    rng, page = random.Random(seed), mmap.mmap(-1, mmap.PAGESIZE)
    with tempfile.TemporaryDirectory() as name:
        folder, number = Path(name), 0
        Truth().write(page)
        live(folder, -1, page, 1.5, seed)  # compiles the plant, and tells how long a mission lasts
        mission_s = Truth.read(page).logged_s
        while figures["kills"] < kills:
            energy_j, life_seed = rng.uniform(0.6, 1.5), rng.randrange(2**31)
            number += 1
            figures["lives"] += 1
            before = replace(Truth.read(page), logged_s=-1.0, magnet_on=False, armed=False, fires=0)
            before.write(page)
            job = lambda n=number, e=energy_j, s=life_seed: live(folder, n, page, e, s)  # noqa: E731
            starting = rng.random() < STARTING_SHARE
            at_s = -1.0 if starting else rng.uniform(0.0, mission_s)
            cut = killed(job, page, at_s, rng.uniform(0.0, START_S if starting else TICK_S))
            truth = Truth.read(page)
            figures["hops"] += truth.fires
            if cut:
                judge(folder, number, truth, figures)
                if figures["kills"] % 25 == 0:
                    print({name: figures[name] for name in names}, flush=True)
            for part in parts_of(folder / f"{number}.mcap"):
                part.unlink(missing_ok=True)
    return figures


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description="Kill the flight software at random instants.")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--kills", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    figures = run(options.kills, options.seed)
    units = {"max_lost_ms": "ms"}
    for name, value in figures.items():
        print(f"{name}: {value:g} {units.get(name, '')}".rstrip())
    if options.json:
        write_figures(options.json, {name: (value, units.get(name, "1")) for name, value in figures.items()})
    bad = figures["lost_arming"] or figures["fired"] or figures["corrupt_logs"]
    raise SystemExit(1 if bad or figures["max_lost_ms"] > 100.0 else 0)


if __name__ == "__main__":
    main()
