"""Flying a recorded mission again from its log: same readings in, same commands and decisions out, bit for bit.

A difference means that the flight software has changed, that it does not depend on its readings alone, or
that the log was tampered with. Bits can also differ between machines whose mathematical libraries round
differently; the place of the first difference then tells which.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from flight.executive import Progress, fly
from flight.log import FlightLog, read_log
from flight.mission import MissionPlan
from flight.settings import FlightSettings
from flight.surface.known import SurfaceSettings, check_surfaces
from hal.calls import board_calls
from hal.log import LogError
from hal.replay import ReplayBoard, ReplayEnded, ReplayMismatch, ReplayTape

Flight = Callable[[ReplayBoard, ReplayTape], object]


@dataclass(frozen=True)
class Difference:
    """Where the replay first did something else than the record."""

    sequence: int
    time_s: float
    expected: str
    got: str

    def __str__(self) -> str:
        return f"message {self.sequence} at {self.time_s:.4f} s: expected {self.expected}, got {self.got}"


@dataclass(frozen=True)
class ReplayResult:
    """What a replay found; `compared` counts the messages that were the same.

    `damage` says in words what the log has lost, if it was cut; the replay then ends where the log does.
    """

    path: Path
    compared: int
    commands: int
    decisions: int
    first_difference: Difference | None
    damage: str = ""

    @property
    def same(self) -> bool:
        return self.first_difference is None


def replay_log(
    path: Path, recover: bool = False, show: Callable[[str, float], None] | None = None
) -> ReplayResult:
    """Fly the mission of a log again and compare all commands and decisions.

    `show` is told a text and which share of the log's time is flown. `recover` takes the whole part of a log that
    was cut. Raises `LogError` when the log cannot be read, lacks what a replay needs, or gave nothing to compare;
    `ConfigError` when settings in it are refused.
    """
    log = read_log(path, recover)
    settings = log.part("settings", FlightSettings)
    mission = log.part("mission", MissionPlan)
    surfaces = log.part("surfaces", SurfaceSettings)
    check_surfaces(surfaces, f"{path}: metadata surfaces")
    stay_s = _stay_s(log)
    end_s = log.messages[-1].time_s if log.messages else 0.0

    def watch(progress: Progress) -> None:
        if show is not None and end_s > 0.0:
            show(f"flying {path} again, t = {progress.time_s:.0f} s", progress.time_s / end_s)

    return replay_messages(
        log, lambda board, tape: fly(board, settings, mission, tape, watch, surfaces=surfaces, stay_s=stay_s)
    )


def _stay_s(log: FlightLog) -> float:
    """How long the flight was to wait in SAFE for the ground; logs that do not say so did not wait."""
    text = log.metadata.get("stay_s", "0.0")
    try:
        return float(text)
    except ValueError:
        raise LogError(f"{log.path}: metadata stay_s = {text!r} is no number") from None


def replay_messages(log: FlightLog, flight: Flight) -> ReplayResult:
    """Run `flight` on a board that answers from the log, which is also its log sink."""
    if not log.messages:
        raise LogError(f"{log.path}: holds no messages, so there is nothing to compare")
    board = ReplayBoard.of(log.messages, log.metadata.get("board", "replay"))
    tape = board.tape
    difference = _fly(log, flight, board)
    same = log.messages[: tape.compared]
    if not same:
        raise LogError(f"{log.path}: nothing could be compared ({difference})")
    commands = sum(m.topic in ("motor", "magnet") for m in same)
    decisions = sum(m.topic not in board_calls() for m in same)
    return ReplayResult(log.path, len(same), commands, decisions, difference, log.damage)


def _fly(log: FlightLog, flight: Flight, board: ReplayBoard) -> Difference | None:
    tape = board.tape
    try:
        flight(board, tape)
    except ReplayEnded as ended:
        return None if log.damage else _difference(log, ended)
    except ReplayMismatch as mismatch:
        return _difference(log, mismatch)
    except BaseException as error:
        if error is not tape.raised:  # not the recorded end of the flight
            if not isinstance(error, Exception):
                raise
            return _leftover(log, tape, f"{type(error).__name__}: {error}")
    return _leftover(log, tape, "the end of the flight")


def _leftover(log: FlightLog, tape: ReplayTape, got: str) -> Difference | None:
    """The record must end with the flight; only that devices are closed may follow."""
    for message in tape.remaining:
        if message.payload.get("method") != "close":
            expected = f"{message.topic} {message.payload}"
            return Difference(message.sequence, message.time_s, expected, got)
    return None


def _difference(log: FlightLog, mismatch: ReplayMismatch) -> Difference:
    at = min(mismatch.sequence, len(log.messages) - 1)
    return Difference(mismatch.sequence, log.messages[at].time_s, mismatch.expected, mismatch.got)
