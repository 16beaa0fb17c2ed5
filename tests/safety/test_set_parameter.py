"""The command `set_parameter`: what it changes is in force, what it refuses leaves everything as it was."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import hypothesis.strategies as st
import pytest
from hypothesis import given

from flight import settings as flight_settings
from flight.commands import SET_PARAMETER
from flight.executive import fly
from flight.mission import HopPlan, MissionPlan
from flight.parameter_command import changed
from flight.parameters import entry_of, leaves, with_parameter
from flight.settings import settings_problem
from flight.states import Phase
from hal.config import config_path, read_yaml
from hal.dictionary import ParameterEntry
from hal.log import MemoryLog
from hal.readings import GroundCommand
from sim_hal.board import open_sim

SETTINGS = flight_settings.load()
VALUES = dict(leaves(SETTINGS))
STANDING = [name for name in VALUES if (entry := entry_of(name)) and entry.changeable == "standing"]


def command(*arguments: tuple[str, float], signed: bool = True) -> GroundCommand:
    return GroundCommand(1.0, SET_PARAMETER, arguments, signed, sequence=7)


def refused(given_command: GroundCommand, phase: Phase = Phase.READY) -> str:
    """Why it is refused, nothing having changed."""
    settings, event = changed(SETTINGS, given_command, phase)
    assert settings is SETTINGS
    assert (event.name, event.details["sequence"]) == ("command_refused", 7)
    (why,) = event.details["why"]
    return str(why)


def test_there_are_parameters_to_change() -> None:
    assert "timeouts.arm_window_s" in STANDING
    assert len(STANDING) < len(VALUES)


@pytest.mark.parametrize("name", STANDING)
def test_a_parameter_is_set_alone(name: str) -> None:
    value = 1.01 * VALUES[name]
    settings, event = changed(SETTINGS, command((name, value)), Phase.SAFE)
    assert (event.name, event.details) == ("parameter_set", {"parameter": name, "value": value})
    assert dict(leaves(settings)) == {**VALUES, name: value}


@given(
    st.sampled_from(sorted(VALUES)),
    st.floats(allow_nan=True, allow_infinity=True) | st.floats(0.0, 10.0) | st.integers(0, 50).map(float),
    st.sampled_from(list(Phase)),
    st.booleans(),
)
def test_settings_stay_sound_whatever_is_sent(name: str, value: float, phase: Phase, signed: bool) -> None:
    settings, event = changed(SETTINGS, command((name, value), signed=signed), phase)
    assert settings_problem(settings) == ""
    if event.name == "parameter_set":
        assert signed
        assert phase in (Phase.READY, Phase.SAFE)
        assert name in STANDING
        assert dict(leaves(settings)) == {**VALUES, name: value}
    else:
        assert settings is SETTINGS
        assert all(event.details["why"])


@pytest.mark.parametrize(
    ("sent", "why"),
    [
        (command(("timeouts.arm_window_s", 8.0), signed=False), "not authenticated"),
        (command(), "needs one parameter"),
        (command(("tension.settle_s", 0.2), ("timeouts.arm_window_s", 8.0)), "needs one parameter"),
        (command(("timeouts.nothing_s", 1.0)), "not in the dictionary"),
        (command(("monitors.no_such_monitor.above", 1.0)), "at the start only"),
        (command(("drive.resistance_ohm", 3.0)), "at the start only"),
        (command(("timeouts.arm_window_s", 1e6)), "1000000.0 is outside ["),
        (command(("timeouts.arm_window_s", float("nan"))), "nan is outside ["),
    ],
)
def test_a_refusal_says_why(sent: GroundCommand, why: str) -> None:
    assert why in refused(sent)


@pytest.mark.parametrize("phase", [phase for phase in Phase if phase not in (Phase.READY, Phase.SAFE)])
def test_nothing_is_changed_while_the_robot_is_at_work(phase: Phase) -> None:
    assert f"not accepted in {phase}" in refused(command(("timeouts.arm_window_s", 8.0)), phase)


def test_values_that_contradict_each_other_are_refused() -> None:
    least_s = SETTINGS.timeouts.arm_min_s
    assert "arm_min_s must be below" in refused(command(("timeouts.arm_window_s", least_s)))


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 2.5])
def test_a_whole_number_is_no_fraction_and_no_infinity(value: float) -> None:
    assert "is no whole number" in ParameterEntry(low=1, high=9, unit="1", type="int").refusal(value)


def test_a_whole_number_stays_one() -> None:
    tripled = with_parameter(SETTINGS, "monitors.stall.for_ticks", 3)
    assert tripled.monitors["stall"].for_ticks == 3
    assert replace(tripled, monitors=SETTINGS.monitors) == SETTINGS


def flown_with(*sent: GroundCommand) -> tuple[float, list[dict[str, Any]]]:
    """Fly a hop with commands sent in the first READY; how long it tensioned [s], and what was acknowledged."""
    board, log, left = open_sim(read_yaml(config_path("boards", "sim.yaml"))), MemoryLog(), list(sent)
    with board:

        def watch(progress: Any) -> None:
            while left and progress.phase is Phase.READY:
                one = left.pop(0)
                board.link.command(one.name, dict(one.arguments))

        fly(board, SETTINGS, MissionPlan("one hop", (HopPlan(3.0, "steel"),)), log, watch)
        told = [json.loads(text) for _, topic, text in board.link.telemetry if topic == "acknowledgement"]
    entered_s = {m.payload["to"]: m.time_s for m in log.messages if m.topic == "state"}
    return entered_s["hold"] - entered_s["tensioning"], told


def test_in_flight_a_change_is_in_force_and_a_refusal_ends_nothing() -> None:
    longer_s = VALUES["tension.settle_s"] + 1.0
    plain_s, before = flown_with()
    sent = command(("tension.settle_s", longer_s)), command(("drive.resistance_ohm", 3.0))
    changed_s, told = flown_with(*sent)
    ours = [event for event in told if event not in before and event["name"] != "command_accepted"]
    assert [event["name"] for event in ours] == ["parameter_set", "command_refused"]
    assert changed_s == pytest.approx(plain_s + 1.0, abs=2.5 * SETTINGS.tick.period_s)
