"""The tap puts everything on record; the replayed board answers the same, or stops at the difference."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import pytest
from log_fakes import ScriptedRig, fly_toy

from flight.background_log import BackgroundLog
from flight.log import McapLog, read_log
from hal.board import Board
from hal.calls import board_calls
from hal.errors import CommandRefused, ReadFailed
from hal.log import LogError, LogMessage, MemoryLog, NullLog
from hal.replay import ReplayBoard, ReplayEnded, ReplayMismatch
from hal.tap import tap_board


def recorded_flight(seed: int = 1) -> tuple[MemoryLog, float, ScriptedRig]:
    rig, log = ScriptedRig(seed), MemoryLog()
    return log, fly_toy(tap_board(rig.board(), log), log), rig


def test_the_contract_of_every_device_is_known() -> None:
    calls = board_calls()
    assert set(calls) == {field.name for field in dataclasses.fields(Board)} - {"name", "simulated_time"}
    assert set(calls["motor"]) == {"close", "max_voltage_v", "set_voltage_v"}
    assert calls["motor"]["max_voltage_v"].is_property
    assert calls["ground_link"]["send"].parameters == ("topic", "payload")


def test_a_tapped_board_flies_like_the_bare_one() -> None:
    bare = ScriptedRig()
    expected = fly_toy(bare.board(), NullLog())
    _, total_v, rig = recorded_flight()
    assert total_v == expected
    assert rig.commands == bare.commands


def test_each_call_is_on_record_with_its_result() -> None:
    log, _, rig = recorded_flight()
    voltages = [m.payload["arguments"]["voltage_v"] for m in log.messages if is_call(m, "set_voltage_v")]
    assert voltages == [value for name, value in rig.commands if name == "voltage"]
    currents = [m for m in log.messages if m.topic == "motor_current"]
    failed = [m for m in currents if "error" in m.payload]
    assert len(currents) == 40
    assert failed, "the script fails some reads"
    assert failed[0].payload["error"] == {
        "types": ["ReadFailed", "DeviceError", "HalError", "OSError", "Exception"],
        "message": "motor_current: no acknowledge on the bus",
    }
    assert currents[0].payload["result"].keys() == {"time_s", "current_a", "supply_v"}
    assert [m.sequence for m in log.messages] == list(range(len(log.messages)))
    times_s = [m.time_s for m in log.messages]
    assert times_s == sorted(times_s)


def test_a_log_that_takes_calls_in_parts_keeps_the_messages_of_one_that_does_not(tmp_path: Path) -> None:
    whole, total_v, _ = recorded_flight()
    path = tmp_path / "flight.mcap"
    with BackgroundLog(McapLog(path, {}), 1000) as log:
        rig = ScriptedRig(1)
        assert fly_toy(tap_board(rig.board(), log), log) == total_v
    assert not log.problem
    read = json.dumps([[m.topic, m.time_s, m.payload] for m in read_log(path).messages])
    assert read == json.dumps([[m.topic, m.time_s, m.payload] for m in whole.messages])


def is_call(message: LogMessage, method: str) -> bool:
    return message.payload.get("method") == method


def test_a_call_outside_the_contract_is_refused() -> None:
    board: Any = tap_board(ScriptedRig().board(), NullLog())
    with pytest.raises(AttributeError, match="fire"):
        board.magnet.fire()
    with pytest.raises(TypeError, match=r"motor.set_voltage_v: arguments must be: voltage_v"):
        board.motor.set_voltage_v(1.0, 2.0)
    with pytest.raises(TypeError, match="voltage_v"):
        board.motor.set_voltage_v(volts=1.0)


def test_closing_a_tapped_board_closes_every_device() -> None:
    rig, log = ScriptedRig(), MemoryLog()
    tap_board(rig.board(), log).close()
    assert rig.closed == [m.topic for m in log.messages if m.topic not in ("memory", "ground_memory")]
    assert set(rig.closed) == set(board_calls()) - {"clock", "memory", "ground_memory"}


def test_a_replay_makes_the_same_decisions() -> None:
    log, total_v, _ = recorded_flight()
    board = ReplayBoard.of(log.messages)
    assert fly_toy(board, board.tape) == total_v
    assert board.tape.compared == len(log.messages)
    assert not board.tape.remaining


def test_a_replay_rebuilds_errors_by_class_and_message() -> None:
    log = MemoryLog()
    board = tap_board(ScriptedRig().board(), log)
    with pytest.raises(CommandRefused):
        board.motor.set_voltage_v(99.0)
    with pytest.raises(CommandRefused, match=r"voltage_v = 99.0 is outside"):
        ReplayBoard.of(log.messages).motor.set_voltage_v(99.0)


@pytest.mark.parametrize(
    ("raised", "replayed"),
    [
        (ReadFailed("gone"), ReadFailed),
        (KeyboardInterrupt("stop"), KeyboardInterrupt),
        (UnicodeDecodeError("utf-8", b"x", 0, 1, "bad"), ValueError),  # cannot be built from a message
        (type("SerialException", (OSError,), {})("port"), OSError),  # a driver's own class
    ],
)
def test_foreign_errors_come_back_as_the_nearest_known_class(
    raised: BaseException, replayed: type[BaseException]
) -> None:
    class Broken:
        def read(self) -> None:
            raise raised

    log = MemoryLog()
    broken: Any = Broken()
    whole = ScriptedRig().board()
    devices = {field.name: getattr(whole, field.name) for field in dataclasses.fields(Board)}
    board = tap_board(Board(**{**devices, "switches": BrokenSwitches(broken)}), log)
    with pytest.raises(type(raised)):
        board.switches.read()
    with pytest.raises(replayed) as caught:
        ReplayBoard.of(log.messages).switches.read()
    assert str(caught.value) == str(raised)


class BrokenSwitches:
    """Switches whose read fails."""

    def __init__(self, broken: Any) -> None:
        self.read = broken.read

    def close(self) -> None:
        pass


def test_an_altered_reading_is_found_at_the_decision_that_it_changes() -> None:
    log, _, _ = recorded_flight()
    altered = next(i for i, m in enumerate(log.messages) if m.topic == "spring" and i > 100)
    message = log.messages[altered]
    values = list(message.payload["result"]["compression_m"])
    values[-1] += 1e-12
    result = {**message.payload["result"], "compression_m": values}
    messages = list(log.messages)
    messages[altered] = dataclasses.replace(message, payload={**message.payload, "result": result})
    following = next(i for i in range(altered, len(messages)) if is_call(messages[i], "set_voltage_v"))
    board = ReplayBoard.of(messages)
    with pytest.raises(ReplayMismatch, match=f"message {following}: expected motor") as caught:
        fly_toy(board, board.tape)
    assert caught.value.sequence == following
    assert board.tape.compared == following
    with pytest.raises(ReplayMismatch, match=f"message {following}"):  # and it stays stopped
        board.watchdog.stroke()


def test_another_device_method_time_or_end_is_a_difference() -> None:
    log = MemoryLog()
    board = tap_board(ScriptedRig().board(), log)
    board.motor.set_voltage_v(1.0)
    log.write("state", 0.5, {"name": "READY"})
    with pytest.raises(ReplayMismatch, match=r"message 0: expected motor .*set_voltage_v.*, got magnet"):
        ReplayBoard.of(log.messages).magnet.switch_on()
    with pytest.raises(ReplayMismatch, match=r"message 0: expected motor .*1\.0.*, got motor .*1\.5"):
        ReplayBoard.of(log.messages).motor.set_voltage_v(1.5)
    replayed = ReplayBoard.of(log.messages)
    replayed.motor.set_voltage_v(1.0)
    with pytest.raises(ReplayMismatch, match=r"message 1: expected state at 0\.5 s, got state at 0\.6 s"):
        replayed.tape.write("state", 0.6, {"name": "READY"})
    replayed = ReplayBoard.of(log.messages)
    replayed.motor.set_voltage_v(1.0)
    replayed.tape.write("state", 0.5, {"name": "READY"})
    with pytest.raises(ReplayEnded, match="message 2: expected the end of the record, got switches"):
        replayed.switches.read()


def test_minus_zero_is_another_command_than_zero() -> None:
    log = MemoryLog()
    tap_board(ScriptedRig().board(), log).motor.set_voltage_v(0.0)
    with pytest.raises(ReplayMismatch):
        ReplayBoard.of(log.messages).motor.set_voltage_v(-0.0)


def test_a_handler_of_faults_cannot_swallow_a_difference() -> None:
    assert not issubclass(ReplayMismatch, Exception)


def test_a_record_that_does_not_fit_the_contract_is_refused_in_words() -> None:
    payload = {"method": "read", "arguments": {}, "result": {"time_s": 0.0, "amps": 1.0}}
    board = ReplayBoard.of([LogMessage(0, "motor_current", 0.0, payload)])
    with pytest.raises(LogError, match=r"message 0 \(motor_current\): its result does not fit the contract"):
        board.motor_current.read()
    with pytest.raises(LogError, match="'motor' is the topic of a device"):
        board.tape.write("motor", 0.0, {})
