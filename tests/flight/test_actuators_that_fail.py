"""Actuators that fail or disobey: the spring is relaxed if the motor still obeys, else the power is cut."""

from __future__ import annotations

import pytest
from flight_fakes import FakeRobot, ListLog, fake_board

from flight import settings as flight_settings
from flight.executive import fly
from flight.mission import HopPlan, MissionPlan
from hal.board import open_board
from hal.config import config_path, read_yaml
from sim_hal.board import SimBoard

SETTINGS = flight_settings.load()
ONE_HOP = MissionPlan("one hop", (HopPlan(12.0, "quartz_sand"),))
TENSIONING_S = 8.0  # within that phase
MARGIN_M = 0.0005  # compression that may be added until the power is cut


def test_a_magnet_that_takes_no_command_is_told_again_and_the_spring_relaxed() -> None:
    robot = FakeRobot(SETTINGS, nut_m=0.002)
    robot.failing.add("magnet")
    log = ListLog()
    result = fly(fake_board(robot), SETTINGS, ONE_HOP, log)
    assert result.end_reason == "magnet_command_failed"
    assert log.phases()[-3:] == ["firing", "de_tension", "safe"]
    assert not result.spring_loaded
    assert robot.nut_m <= robot.home_m
    assert not robot.hops
    assert [event["device"] for event in log.events("actuator_failed")] == ["magnet", "magnet"]
    relaxing = robot.now_s - next(
        t for topic, t, p in log.entries if topic == "state" and p["to"] == "de_tension"
    )
    assert robot.refused.count("magnet") >= relaxing * SETTINGS.tick.rate_hz


def test_a_magnet_that_stays_on_after_the_hop_ends_at_once_so_that_the_watchdog_cuts_its_power() -> None:
    robot = FakeRobot(SETTINGS, nut_m=0.002)

    def fail() -> None:
        if robot.magnet_on:
            robot.failing.add("magnet")

    robot.on_tick = fail
    log = ListLog()
    result = fly(fake_board(robot), SETTINGS, ONE_HOP, log)
    assert result.end_reason == "magnet_command_failed"
    assert log.phases()[-2:] == ["flight", "safe"]


def test_a_motor_that_takes_no_command_ends_in_safe_without_another_stroke() -> None:
    robot, log, strokes = FakeRobot(SETTINGS, nut_m=0.002), ListLog(), [0]

    def fail() -> None:
        if robot.now_s > TENSIONING_S and "motor" not in robot.failing:
            robot.failing.add("motor")
            strokes[0] = robot.strokes

    robot.on_tick = fail
    result = fly(fake_board(robot), SETTINGS, ONE_HOP, log)
    assert result.end_reason == "motor_command_failed"
    assert log.phases()[-2:] == ["tensioning", "safe"]
    assert result.spring_loaded
    assert set(robot.refused) == {"motor"}
    assert len(robot.refused) > 1  # it was told to be off, too
    assert robot.strokes == strokes[0] > 0


@pytest.mark.parametrize(
    ("kind", "from_s", "energy_j", "phase"),
    [
        ("stick", 0.3, 25.0, "homing"),
        ("stick", 12.0, 25.0, "tensioning"),
        ("silent", 0.0, 25.0, "homing"),
    ],
)
def test_a_motor_that_disobeys_has_its_power_cut_before_the_spring_is_overstretched(
    kind: str, from_s: float, energy_j: float, phase: str
) -> None:
    """One stuck at the voltage of full speed, with the nut on its way down or up, and one without power."""
    found = read_yaml(config_path("boards", "sim.yaml"))
    found["faults"] = [{"device": "motor", "kind": kind, "from_s": from_s}]
    log, most = ListLog(), [0.0]
    with open_board("sim", found) as board:
        assert isinstance(board, SimBoard)
        world = board.world

        def watch(_: object) -> None:
            most[0] = max(most[0], world.spring_compression_m)

        result = fly(board, SETTINGS, MissionPlan("m", (HopPlan(energy_j, "steel"),)), log, watch)
        ended_s, ended_m = board.clock.now_s(), world.nut_position_m
        while board.clock.now_s() < ended_s + 1.0:  # nobody strokes the watchdog any more
            board.clock.sleep_until_s(board.clock.now_s() + SETTINGS.tick.period_s)
            watch(None)
        assert board.rig.watchdog_expired
        assert world.voltage_v == 0.0
        assert abs(world.nut_position_m - ended_m) < MARGIN_M
        assert not world.hops
    assert result.end_reason == "motor_disobeys"
    assert log.phases()[-2:] == [phase, "safe"]
    assert most[0] < SETTINGS.max_compression_m + MARGIN_M


def test_a_motor_stuck_while_another_fault_wants_the_spring_relaxed_has_its_power_cut() -> None:
    """The first fault keeps its name; the motor, going on upwards instead of down, ends the relaxing."""
    found = read_yaml(config_path("boards", "sim.yaml"))
    found["faults"] = [
        {"device": "motor", "kind": "stick", "from_s": 6.0},
        {"device": "spring", "kind": "silent", "from_s": 6.5},
    ]
    log = ListLog()
    with open_board("sim", found) as board:
        assert isinstance(board, SimBoard)
        result = fly(board, SETTINGS, ONE_HOP, log)
        board.clock.sleep_until_s(board.clock.now_s() + 1.0)
        assert board.rig.watchdog_expired
        assert board.world.spring_compression_m < SETTINGS.max_compression_m
    assert result.end_reason == "spring_stale"
    assert [event["reason"] for event in log.events("fault")] == ["spring_stale", "motor_disobeys"]
