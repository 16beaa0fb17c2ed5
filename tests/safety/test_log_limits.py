"""The log's limits: rotation, a bounded disc, a full disc, a slow disc, and a cut."""

from __future__ import annotations

import os
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from flight.background_log import BATCH, BackgroundLog
from flight.log import LogSettings, McapLog, parts_of, read_log
from hal.board import open_board
from hal.config import config_path, read_yaml
from hal.log import LogError, NullLog, log_problem, tick_end_of
from hal.tap import tap_board

SMALL = LogSettings(file_bytes=16_384, total_bytes=65_536, waiting_messages=100)
LARGE = LogSettings(file_bytes=16_384, total_bytes=2**30, waiting_messages=100_000)


def noise(index: int) -> dict[str, Any]:
    """A message that does not compress well, so that files fill."""
    return {"index": index, "text": os.urandom(100).hex()}


def write(path: Path, limits: LogSettings, count: int) -> None:
    with McapLog(path, {"board": "none"}, limits) as log:
        for index in range(count):
            log.write("event", 0.005 * index, noise(index))


def test_a_log_goes_on_in_new_files_and_is_read_as_one(tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    write(path, LARGE, 1000)
    assert len(parts_of(path)) > 3
    log = read_log(path)
    assert [message.payload["index"] for message in log.messages] == list(range(1000))
    assert not log.damage


def test_what_it_takes_on_the_disc_is_bounded_and_a_gap_is_told(tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    write(path, SMALL, 5000)
    assert sum(part.stat().st_size for part in parts_of(path)) < SMALL.total_bytes + 16_384
    with pytest.raises(LogError, match="messages are missing before it"):
        read_log(path)
    found = read_log(path, recover=True)
    assert found.damage
    assert found.messages[0].payload["index"] == 0  # the first file, with the start, is kept


def test_a_log_that_is_cut_anywhere_gives_what_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    write(path, LARGE, 300)
    last = parts_of(path)[-1]
    whole = last.read_bytes()
    for keep in range(1, len(whole), max(1, len(whole) // 40)):
        last.write_bytes(whole[:keep])
        if keep < 8:
            continue
        found = read_log(path, recover=True)
        indices = [message.payload["index"] for message in found.messages]
        assert indices == list(range(len(indices)))


class Disc:
    """A log whose disc is full, or waits until it is let go."""

    def __init__(self, *, full: bool = False) -> None:
        self.full, self.go = full, threading.Event()
        self.written: list[float] = []

    def write(self, topic: str, time_s: float, payload: Mapping[str, Any]) -> None:
        if self.full:
            raise LogError("flight.mcap: [Errno 28] No space left on device")
        self.go.wait(10.0)
        self.written.append(time_s)

    def close(self) -> None:
        pass


def test_a_full_disc_is_told_and_never_raises_into_the_tick() -> None:
    log = BackgroundLog(Disc(full=True), 100)  # type: ignore[arg-type]
    log.write("event", 0.0, {})
    log.close()
    assert "No space left" in log_problem(log)
    log.write("event", 1.0, {})


def test_a_slow_disc_keeps_nothing_waiting_beyond_its_bound() -> None:
    disc = Disc()
    log = BackgroundLog(disc, 100)  # type: ignore[arg-type]
    for index in range(90):
        log.write("event", float(index), {})
    assert not log_problem(log)
    for index in range(90, 300):
        log.write("event", float(index), {})
    assert "too slow" in log_problem(log)
    disc.go.set()
    log.close()
    assert disc.written == [float(index) for index in range(len(disc.written))]  # in order, without a hole
    assert 90 <= len(disc.written) <= 102


def test_messages_are_handed_over_when_a_tick_ends_or_when_they_are_many() -> None:
    disc = Disc()
    disc.go.set()
    log = BackgroundLog(disc, 1000)  # type: ignore[arg-type]
    log.write("event", 0.0, {})
    log.write("event", 0.0, {})
    assert log.waiting == 2
    assert disc.written == []  # whatever the thread does: nothing was handed over
    tick_end_of(log)()
    while log.waiting:
        pass
    assert disc.written == [0.0, 0.0]
    for index in range(BATCH):
        log.write("event", float(index), {})
    while log.waiting:
        pass
    assert disc.written[2:] == [float(index) for index in range(BATCH)]
    log.close()
    tick_end_of(NullLog())()  # a sink that does not gather messages need not know of ticks


def test_where_time_is_simulated_a_slow_disc_holds_the_flight_up_and_nothing_is_lost() -> None:
    disc = Disc()
    log = BackgroundLog(disc, 100, simulated_time=True)  # type: ignore[arg-type]
    threading.Timer(0.05, disc.go.set).start()
    for index in range(1000):
        log.write("event", float(index), {})
        assert log.waiting <= 100
    log.close()
    assert not log_problem(log)
    assert disc.written == [float(index) for index in range(1000)]


def test_simulated_boards_say_that_their_time_is_simulated() -> None:
    for name in ("sim", "raspberry_pi_emulated"):
        with open_board(name, read_yaml(config_path("boards", f"{name}.yaml"))) as board:
            assert board.simulated_time
            assert tap_board(board, NullLog()).simulated_time
