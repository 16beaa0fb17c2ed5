"""Where the console's messages come from: a link to a robot, or to a simulation that flies in this process."""

from __future__ import annotations

import contextlib
import json
import secrets
import threading
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from flight.mission import MissionPlan
from ground.live.view import Told
from ground.mission_run import run_mission
from ground.mission_summary import MissionRun, verdict_sentence
from ground.station import GroundStation
from hal.board import Board
from hal.config import config_path, load_settings
from hal.devices import Clock
from hal.errors import DeviceError, HalError
from hal.link.keys import KEY_BYTES, Key
from hal.link.messages import SESSION_BYTES
from hal.link.packets import BadPacket
from hal.link.robot import LinkSettings, RobotLink
from hal.link.streams import ByteStream, loopback

LATE_S = 0.1
LINE_BYTES = 1 << 20


class Source(Protocol):
    """Messages of a robot, and the way to command it."""

    title: str

    def poll(self) -> list[Told]:
        """The messages that have arrived since the last call."""

    def status(self) -> str:
        """What is wrong with the way to the robot, or that its mission is over; empty when nothing is to say."""

    def command(self, name: str, arguments: tuple[tuple[str, float], ...]) -> None:
        """Send a signed command. Raises `ConsoleError` when it cannot be sent."""

    def close(self) -> str:
        """Give everything back; returns what was kept, in words."""


class ConsoleError(ValueError):
    """What cannot be done, for the person at the console."""


class LinkSource:
    """A robot at the other end of a byte stream."""

    def __init__(self, stream: ByteStream, key: Key, bounds: LinkSettings, title: str) -> None:
        self._stream, self.title = stream, title
        self._station = GroundStation(stream, key, bounds.longest_packet_bytes)
        self._lost = ""

    def poll(self) -> list[Told]:
        """The messages that have arrived; a line that is gone is told by `status`."""
        try:
            messages = self._station.poll()
        except DeviceError as error:
            self._lost = f"the link is lost: {error}"
            return []
        self._lost = ""
        return [Told(None, message.topic, json.loads(message.text)) for message in messages]

    def status(self) -> str:
        """Whether the robot is heard."""
        if self._lost:
            return self._lost
        return (
            ""
            if self._station.session
            else "waiting for the robot: nothing signed with this key was heard yet"
        )

    def command(self, name: str, arguments: tuple[tuple[str, float], ...]) -> None:
        """Send a signed command."""
        try:
            self._station.command(name, arguments)
        except (BadPacket, KeyError, DeviceError) as error:
            raise ConsoleError(f"{name}: not sent: {error}") from error

    def close(self) -> str:
        """Close the line."""
        self._stream.close()
        return ""


class PacedClock:
    """A clock that lets simulated time pass at `speed` times the wall's, until it is told to hurry."""

    def __init__(self, clock: Clock, speed: float, hurry: threading.Event) -> None:
        self._clock, self._speed, self._hurry = clock, speed, hurry
        self._start = time.monotonic() - clock.now_s() / speed

    def now_s(self) -> float:
        """Seconds since the board's start."""
        return self._clock.now_s()

    def sleep_until_s(self, time_s: float) -> None:
        """Let the world go on to `time_s`, and wait until it is time."""
        self._clock.sleep_until_s(time_s)
        ahead_s = time_s / self._speed - (time.monotonic() - self._start)
        if ahead_s < -LATE_S:  # an evaluation took its time: go on from here
            self._start -= ahead_s
        elif ahead_s > 0.0:
            self._hurry.wait(ahead_s)


@dataclass(frozen=True)
class SimulationPlan:
    """What the simulation flies: mission, folder for what comes of it, seed, how fast, how long it stays in SAFE."""

    mission: MissionPlan
    folder: Path
    seed: int
    speed: float
    stay_s: float


class Simulation:
    """A simulated robot that flies in a thread, at the far end of the same link as the real one."""

    def __init__(self, plan: SimulationPlan) -> None:
        self._plan = plan
        self._bounds = load_settings(config_path("link.yaml"), LinkSettings)
        self._key = Key(secrets.token_bytes(KEY_BYTES))
        near, self._far = loopback(LINE_BYTES)
        self._link = LinkSource(near, self._key, self._bounds, "")
        self.title = f"simulation, seed {plan.seed}, {plan.speed:g} × real time"
        self._hurry = threading.Event()
        self._last: list[Told] = []
        self._run: MissionRun | None = None
        self._problem = ""
        self._thread = threading.Thread(target=self._fly, name="simulated flight", daemon=True)
        self._thread.start()

    def poll(self) -> list[Told]:
        """The messages that have arrived."""
        told, self._last = self._last + self._link.poll(), []
        return told

    def status(self) -> str:
        """Whether it flies still, and what came of it."""
        if self._problem:
            return f"the simulation ended: {self._problem}"
        if self._run is not None:
            return f"{verdict_sentence(self._run)} Page: {self._run.folder / 'report.html'}"
        return "" if self._link.status() == "" else "the simulation is being prepared"

    def command(self, name: str, arguments: tuple[tuple[str, float], ...]) -> None:
        """Send a signed command."""
        if not self._thread.is_alive():
            raise ConsoleError(f"{name}: not sent: the mission is over")
        self._link.command(name, arguments)

    def close(self) -> str:
        """Abort what flies, without waiting for the wall's clock; returns where the mission's results are."""
        self._hurry.set()
        while self._thread.is_alive():
            self._last += self._link.poll()
            with contextlib.suppress(ConsoleError):  # it may not have been heard yet
                self._link.command("abort", ())
            self._thread.join(0.2)
        if self._run is None:
            return f"nothing was kept: {self._problem}"
        return f"kept: {self._run.folder} (log, recordings, report.html)"

    def _fly(self) -> None:
        plan = self._plan
        try:
            self._run = run_mission(
                plan.mission, plan.folder, seed=plan.seed, fitted=self._fitted, stay_s=plan.stay_s
            )
        except (HalError, OSError, ValueError) as error:
            self._problem = str(error)

    def _fitted(self, board: Board) -> Board:
        session = secrets.token_bytes(SESSION_BYTES)
        clock = PacedClock(board.clock, self._plan.speed, self._hurry)
        link = RobotLink(self._far, self._key, session, board.clock, self._bounds)
        return replace(board, clock=clock, ground_link=link)
