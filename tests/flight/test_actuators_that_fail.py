"""Actuators that fail or disobey: the spring is relaxed if the motor still obeys, else the power is cut."""

from __future__ import annotations

from flight_fakes import FakeRobot, ListLog, fake_board

from flight import settings as flight_settings
from flight.executive import fly
from flight.mission import HopPlan, MissionPlan

SETTINGS = flight_settings.load()
ONE_HOP = MissionPlan("one hop", (HopPlan(12.0, "quartz_sand"),))
TENSIONING_S = 8.0  # within that phase


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
