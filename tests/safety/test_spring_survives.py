"""What outlives a flight: the spring's record, a log that replays; and that the watchdog is withheld.

Kills at random instants are in benchmarks/kill.py; here each state in which a kill can find the record.
"""

from __future__ import annotations

import gc
import json
from pathlib import Path

import pytest

from flight import __main__ as on_board
from flight import settings as flight_settings
from flight.executive import fly
from flight.mission import HopPlan, MissionPlan
from flight.quantities import QUANTITIES
from flight.spring_record import SpringKeeper, SpringRecord
from flight.states import Machine, Phase, Target
from ground.replay import replay_log
from hal.board import open_board
from hal.config import config_path, read_yaml
from hal.errors import DeviceError
from hal.link.keys import make_key
from hal.log import MemoryLog
from hal.memory import FileMemory, VolatileMemory
from sim_hal.board import SimBoard

SETTINGS = flight_settings.load()
ONE_HOP = MissionPlan("one", (HopPlan(0.6, "steel"),))


def test_the_collector_rests_in_flight_and_works_again_after_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mission = tmp_path / "m.yaml"
    mission.write_text("name: m\nhops:\n  - {energy_j: 0.6, surface: steel}\n", encoding="utf-8")
    seen: list[bool] = []

    def interrupted(*_: object, **__: object) -> None:
        seen.append(gc.isenabled())
        raise KeyboardInterrupt

    monkeypatch.setattr(on_board, "fly", interrupted)
    command = ["--board", "sim", "--mission", str(mission), "--log", str(tmp_path / "flight.mcap")]
    with pytest.raises(KeyboardInterrupt):
        on_board.main(command)
    assert seen == [False]
    assert gc.isenabled()


def test_a_flight_leaves_the_spring_s_record_and_a_log_that_replays_with_its_wait_in_safe(
    tmp_path: Path,
) -> None:
    mission, log = tmp_path / "m.yaml", tmp_path / "flight.mcap"
    mission.write_text("name: m\nhops:\n  - {energy_j: 0.6, surface: steel}\n", encoding="utf-8")
    command = [
        "--board",
        "sim",
        "--mission",
        mission,
        "--log",
        log,
        "--memory",
        tmp_path / "spring",
        "--stay-s",
        "0.3",
    ]
    assert on_board.main([str(part) for part in command]) == 0
    record = json.loads(FileMemory(tmp_path / "spring").read())
    assert record == {"loaded": False, "armed": False, "energy_j": 0.0}
    result = replay_log(log)
    assert result.same
    assert result.compared > 10000


def test_a_key_that_others_may_read_is_refused_before_anything_is_opened(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mission, key, log = tmp_path / "m.yaml", tmp_path / "link.key", tmp_path / "flight.mcap"
    mission.write_text("name: m\nhops:\n  - {energy_j: 0.6, surface: steel}\n", encoding="utf-8")
    make_key(key)
    key.chmod(0o640)
    command = ["--board", "sim", "--mission", mission, "--log", log, "--link", "/dev/null", "--link-key", key]
    assert on_board.main([str(part) for part in command]) == 2
    said = capsys.readouterr().err
    assert f"flight: {key}: " in said
    assert "permissions 0640" in said
    assert key.read_text(encoding="ascii").strip() not in said
    assert not log.exists()


def test_the_record_says_loaded_before_anything_is_stored_and_armed_before_the_magnet_is_on() -> None:
    found = read_yaml(config_path("boards", "sim.yaml"))
    board = open_board("sim", found)
    assert isinstance(board, SimBoard)
    memory, known = VolatileMemory(), set()
    object.__setattr__(board, "memory", memory)
    untold: list[float] = []

    def look(now_s: float) -> None:
        record = json.loads(memory.read() or '{"loaded": true, "armed": false}')
        known.add((record["loaded"], record["armed"]))
        loaded = board.world.latch_closed and board.world.spring_compression_m > 1e-3
        if (loaded and not record["loaded"]) or (board.world.magnet_on and not record["armed"]):
            untold.append(now_s)

    board.rig.witnesses.append(look)
    result = fly(board, SETTINGS, ONE_HOP, MemoryLog())
    assert result.end_reason == "stowed"
    assert untold == []
    assert known == {(True, False), (True, True), (False, False)}


@pytest.mark.parametrize("left", ["", "no record", '{"loaded": 1', '{"held": true}', "[]"])
def test_a_record_that_is_missing_or_damaged_counts_as_a_loaded_spring(left: str) -> None:
    memory = VolatileMemory()
    memory.write(left)
    found = SpringKeeper(memory).found()
    assert found.details["loaded"] is True
    assert found.details["known"] is False


def test_a_memory_that_cannot_be_written_keeps_the_magnet_off() -> None:
    class Full(VolatileMemory):
        def write(self, text: str) -> None:
            raise DeviceError("no space left on the card")

    keeper = SpringKeeper(Full())
    armed = Machine(phase=Phase.ARMED, target=Target(1.0, 0.007))
    assert keeper.keep(armed) is not None
    assert keeper.failed
    keeper.keep(armed._replace(phase=Phase.HOLD))
    assert keeper.failed
    assert SpringRecord.of(armed) == SpringRecord(loaded=True, armed=True, energy_j=1.0)
    board = open_board("sim", read_yaml(config_path("boards", "sim.yaml")))
    object.__setattr__(board, "memory", Full())
    log = MemoryLog()
    assert fly(board, SETTINGS, ONE_HOP, log).end_reason == "memory_unwritable"


def test_a_record_that_could_not_be_written_is_tried_again_until_it_is() -> None:
    class Jammed(VolatileMemory):
        jammed = True

        def write(self, text: str) -> None:
            if self.jammed:
                raise DeviceError("no answer from the card")
            super().write(text)

    memory = Jammed()
    keeper, armed = SpringKeeper(memory), Machine(phase=Phase.ARMED, target=Target(1.0, 0.007))
    assert keeper.keep(armed) is not None
    assert keeper.keep(armed) is None  # told once
    assert keeper.failed
    memory.jammed = False
    keeper.keep(armed)
    assert not keeper.failed
    assert json.loads(memory.read()) == SpringRecord.of(armed)._asdict()


def test_the_watchdog_is_not_stroked_while_a_monitor_is_dead(monkeypatch: pytest.MonkeyPatch) -> None:
    board = open_board("sim", read_yaml(config_path("boards", "sim.yaml")))
    assert isinstance(board, SimBoard)
    dead_s = 1.0
    hot_motor = QUANTITIES["hot_motor"]

    def dies(*state: object) -> float | None:
        if board.world.now_s > dead_s:
            raise ZeroDivisionError
        return hot_motor(*state)  # type: ignore[arg-type]

    monkeypatch.setitem(QUANTITIES, "hot_motor", dies)
    strokes: list[float] = []
    stroke = board.rig.stroke
    monkeypatch.setattr(board.rig, "stroke", lambda: (strokes.append(board.world.now_s), stroke()))
    result = fly(board, SETTINGS, ONE_HOP, MemoryLog(), stay_s=0.5)
    assert result.end_reason == "monitor_dead"
    assert len(strokes) > 100
    assert max(strokes) <= dead_s
    assert board.rig.watchdog_expired
