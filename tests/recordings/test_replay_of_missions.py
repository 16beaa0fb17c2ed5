"""A mission flown again from its log does the same, to the bit; a log that was altered is found out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from flown_mission import fly_short_mission

from flight.log import FlightLog, McapLog, read_log
from ground.replay import replay_log, replay_messages
from hal.config import config_path
from hal.errors import ConfigError
from hal.log import LogError, LogMessage
from sim_hal.truth import HopTruth

Flown = tuple[Path, HopTruth]


@pytest.fixture(scope="module")
def log(flown: Flown) -> FlightLog:
    """The log of the mission, read."""
    return read_log(flown[0])


def rewritten(
    log: FlightLog,
    path: Path,
    metadata: Mapping[str, str] | None = None,
    message: Callable[[LogMessage], Mapping[str, Any]] = lambda message: message.payload,
) -> Path:
    """The log written again, with other metadata or payloads."""
    with McapLog(path, log.metadata if metadata is None else metadata) as copy:
        for each in log.messages:
            copy.write(each.topic, each.time_s, message(each))
    return path


def test_the_same_readings_give_the_same_commands_and_decisions(flown: Flown, log: FlightLog) -> None:
    path, _ = flown
    result = replay_log(path)
    assert result.same
    assert result.first_difference is None
    assert result.compared == len(log.messages) > 10_000
    assert result.commands == sum(m.topic in ("motor", "magnet") for m in log.messages) > 1000
    assert (
        result.decisions == sum(m.topic in ("state", "event", "outputs", "hop") for m in log.messages) > 1000
    )
    assert result.damage == ""


def test_one_altered_reading_is_found_at_the_command_that_it_changes(log: FlightLog, tmp_path: Path) -> None:
    tensioning_s = next(m.time_s for m in log.messages if m.payload.get("to") == "tensioning")
    victim = next(
        m
        for m in log.messages
        if m.time_s > tensioning_s + 1.0 and m.topic == "nut_encoder" and m.payload["method"] == "read"
    )

    def altered(message: LogMessage) -> Mapping[str, Any]:
        if message is not victim:
            return message.payload
        reading = message.payload["result"]
        return {**message.payload, "result": {**reading, "position_m": reading["position_m"] + 1e-6}}

    result = replay_log(rewritten(log, tmp_path / "altered.mcap", message=altered))
    difference = result.first_difference
    assert difference is not None
    command = next(m for m in log.messages[victim.sequence :] if m.payload.get("method") == "set_voltage_v")
    assert difference.sequence == command.sequence == result.compared
    assert difference.time_s == command.time_s == victim.time_s
    assert str(difference).startswith(f"message {command.sequence} at {command.time_s:.4f} s: expected motor")


def test_an_altered_command_or_decision_is_found_where_it_stands(log: FlightLog, tmp_path: Path) -> None:
    for index, (topic, key) in enumerate((("outputs", "voltage_v"), ("hop", "fire_s"))):
        victim = [m for m in log.messages if m.topic == topic][-1]

        def altered(message: LogMessage, victim: LogMessage = victim, key: str = key) -> Mapping[str, Any]:
            return {**message.payload, key: 1e-9} if message is victim else message.payload

        result = replay_log(rewritten(log, tmp_path / f"{index}.mcap", message=altered))
        assert result.first_difference is not None
        assert result.first_difference.sequence == victim.sequence


def test_other_settings_are_found_out(log: FlightLog, tmp_path: Path) -> None:
    assert "power_limit_w: 5.0" in log.metadata["settings"]
    settings = log.metadata["settings"].replace("power_limit_w: 5.0", "power_limit_w: 2.0")
    path = rewritten(log, tmp_path / "other.mcap", metadata={**log.metadata, "settings": settings})
    difference = replay_log(path).first_difference
    assert difference is not None
    assert difference.expected.startswith("motor")


def other_surfaces() -> str:
    """The shipped surfaces, but for the probability of none of them."""
    shipped = config_path("surfaces.yaml").read_text(encoding="utf-8")
    other = shipped.replace("unknown_probability: 0.", "unknown_probability: 0.0", 1)
    assert other != shipped
    return other


def test_a_log_flown_with_other_surfaces_replays_with_its_own(tmp_path: Path) -> None:
    surfaces = tmp_path / "surfaces.yaml"
    surfaces.write_text(other_surfaces(), encoding="utf-8")
    fly_short_mission(tmp_path / "flight.mcap", surfaces)
    assert replay_log(tmp_path / "flight.mcap").same


def test_altered_surfaces_are_found_out_at_the_hop_that_they_judge(log: FlightLog, tmp_path: Path) -> None:
    path = rewritten(log, tmp_path / "ground.mcap", metadata={**log.metadata, "surfaces": other_surfaces()})
    difference = replay_log(path).first_difference
    assert difference is not None
    assert difference.expected.startswith("hop")


def test_a_cut_log_replays_to_where_it_ends(flown: Flown, tmp_path: Path) -> None:
    whole = flown[0].read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(LogError, match=r"cut\.mcap: the file is cut at byte"):
        replay_log(cut)
    result = replay_log(cut, recover=True)
    assert result.same
    assert "cut at byte" in result.damage
    assert result.compared == len(read_log(cut, recover=True).messages) > 1000


def test_a_log_that_goes_on_after_the_flight_differs_there(log: FlightLog, tmp_path: Path) -> None:
    extra = LogMessage(len(log.messages), "state", 99.0, {"to": "homing"})
    path = rewritten(replace(log, messages=(*log.messages, extra)), tmp_path / "long.mcap")
    difference = replay_log(path).first_difference
    assert difference is not None
    assert difference.sequence == len(log.messages)
    assert difference.got == "the end of the flight"


def test_nothing_compared_is_an_error(log: FlightLog, tmp_path: Path) -> None:
    empty = rewritten(replace(log, messages=()), tmp_path / "empty.mcap")
    with pytest.raises(LogError, match=r"empty\.mcap: holds no messages, so there is nothing to compare"):
        replay_log(empty)
    with pytest.raises(LogError, match="nothing could be compared"):
        replay_messages(log, lambda board, tape: board.magnet.switch_on())


def test_a_log_without_what_a_replay_needs_is_refused(log: FlightLog, tmp_path: Path) -> None:
    kept = log.metadata
    surfaces = kept["surfaces"].replace("unknown_c3_low: ", "unknown_c3_low: 0.99  # ", 1)
    assert surfaces != kept["surfaces"]
    cases: tuple[tuple[dict[str, str], type[Exception], str], ...] = (
        (
            {k: v for k, v in kept.items() if k != "mission"},
            LogError,
            "metadata mission is missing; it has board",
        ),
        ({**kept, "settings": "{"}, LogError, "metadata settings is no valid YAML"),
        ({**kept, "settings": "tick: 3"}, ConfigError, r"metadata settings: tick must be a mapping"),
        (
            {**kept, "surfaces": surfaces},
            ConfigError,
            "metadata surfaces: unknown_c3_low must be below unknown_c3_high",
        ),
    )
    short = replace(log, messages=log.messages[:10])
    for index, (metadata, error, says) in enumerate(cases):
        path = rewritten(short, tmp_path / f"{index}.mcap", metadata=metadata)
        with pytest.raises(error, match=rf"{index}\.mcap: {says}"):
            replay_log(path)


def test_a_recorded_interrupt_ends_the_replay_as_it_ended_the_flight() -> None:
    stop = {"method": "now_s", "arguments": {}, "error": {"types": ["KeyboardInterrupt"], "message": "stop"}}
    log = FlightLog(Path("log.mcap"), {}, (LogMessage(0, "clock", 0.0, stop),), "")
    assert replay_messages(log, lambda board, tape: board.clock.now_s()).same


def test_a_failure_of_the_software_is_a_difference() -> None:
    call = {"method": "now_s", "arguments": {}, "result": 0.5}
    messages = tuple(LogMessage(index, "clock", 0.5, call) for index in range(2))

    def failing(board: Any, tape: Any) -> None:
        raise ZeroDivisionError(board.clock.now_s())

    difference = replay_messages(FlightLog(Path("log.mcap"), {}, messages, ""), failing).first_difference
    assert difference is not None
    assert (difference.sequence, difference.got) == (1, "ZeroDivisionError: 0.5")
