"""Whole missions on a small physical fake: the good case, and each fault to its named safe state."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
from flight_fakes import FakeRobot, ListLog, fake_board

from flight import settings as flight_settings
from flight.executive import fly
from flight.mission import HopPlan, MissionPlan, MissionResult
from hal.readings import GroundCommand

SETTINGS = flight_settings.load()
ONE_HOP = MissionPlan("one hop", (HopPlan(12.0, "quartz_sand"),))


def flown(robot: FakeRobot, plan: MissionPlan = ONE_HOP) -> tuple[MissionResult, ListLog]:
    log = ListLog()
    return fly(fake_board(robot), SETTINGS, plan, log), log


def test_a_mission_goes_through_every_phase_and_stores_the_energy_it_was_asked_for() -> None:
    robot = FakeRobot(SETTINGS, nut_m=0.002)
    result, log = flown(robot)
    assert result.completed
    assert not result.spring_loaded
    assert log.phases() == [
        "self_test",
        "homing",
        "latch_check",
        "ready",
        "tensioning",
        "hold",
        "armed",
        "firing",
        "flight",
        "landed",
        "evaluate",
        "homing",
        "de_tension",
        "safe",
    ]
    (report,) = result.hops
    assert report.verdict == "valid"
    energies = report.energies
    assert energies.used_j is not None
    assert energies.used_j.value == pytest.approx(12.0, rel=SETTINGS.tension.tolerance)
    hop = robot.last_hop
    assert hop is not None
    assert energies.height_m is not None
    assert energies.time_of_flight_s is not None
    assert hop.touchdown_s is not None
    assert hop.take_off_s is not None
    true_s = hop.touchdown_s - hop.take_off_s
    assert energies.height_m.value == pytest.approx(hop.height_m, abs=3.0 * energies.height_m.sigma)
    assert abs(energies.time_of_flight_s.value - true_s) < 3.0 * energies.time_of_flight_s.sigma
    assert robot.voltage_v == 0.0
    assert not robot.magnet_on


def test_power_while_tensioning_stays_below_the_limit() -> None:
    robot = FakeRobot(SETTINGS, nut_m=0.002)
    seen: list[float] = []
    robot.on_tick = lambda: seen.append(robot.voltage_v * robot.current_a)
    result, log = flown(robot, MissionPlan("strong", (HopPlan(20.0),)))
    assert result.completed
    start, end = (
        next(t for topic, t, p in log.entries if topic == "state" and p["to"] == phase)
        for phase in ("tensioning", "hold")
    )
    ticks = seen[round(start * SETTINGS.tick.rate_hz) : round(end * SETTINGS.tick.rate_hz)]
    assert sum(ticks) / len(ticks) < SETTINGS.drive.power_limit_w
    assert max(ticks) > 0.5 * SETTINGS.drive.power_limit_w  # it does not get there by crawling


def test_the_same_readings_give_the_same_decisions() -> None:
    logs = [flown(FakeRobot(SETTINGS, nut_m=0.002))[1].entries for _ in range(2)]
    assert logs[0] == logs[1]


def test_a_spring_found_loaded_is_relaxed_first_and_then_the_mission_goes_on() -> None:
    robot = FakeRobot(SETTINGS, nut_m=0.025, latched=True)
    result, log = flown(robot)
    assert log.events("loaded_at_power_up")
    assert log.phases()[:3] == ["self_test", "de_tension", "latch_check"]
    assert result.completed
    # The magnet came on once, for the hop of the mission and not for the energy found.
    assert len(robot.magnet_times_s) == 1


HOMING_S, TENSIONING_S = 0.5, 8.0  # times within these phases of the one-hop mission

# name: (when, what happens, reason, whether the spring is relaxed under control)
FAULTS: dict[str, tuple[float, Callable[[FakeRobot], None], str, bool]] = {
    "encoder fails": (TENSIONING_S, lambda r: r.failing.add("nut_encoder"), "nut_encoder_stale", False),
    "current fails": (TENSIONING_S, lambda r: r.failing.add("motor_current"), "motor_current_stale", False),
    "switches fail": (TENSIONING_S, lambda r: r.failing.add("switches"), "switches_stale", False),
    "spring fails": (TENSIONING_S, lambda r: r.failing.add("spring"), "spring_stale", True),
    "spring is silent": (TENSIONING_S, lambda r: r.silent.add("spring"), "spring_stale", True),
    "accelerometer fails": (
        TENSIONING_S,
        lambda r: r.failing.add("accelerometer"),
        "accelerometer_stale",
        True,
    ),
    "nut jams": (HOMING_S, lambda r: setattr(r, "jammed", True), "over_current", False),
    "motor is unplugged": (HOMING_S, lambda r: setattr(r, "unplugged", True), "motor_disobeys", False),
    "spring sensor drops": (TENSIONING_S, lambda r: setattr(r, "held_m", 0.0), "string_broken", True),
    "spring sensor sticks": (
        TENSIONING_S,
        lambda r: setattr(r, "held_m", r.compression_m),
        "spring_disagrees_with_encoder",
        True,
    ),
    "lock lets go": (TENSIONING_S, lambda r: setattr(r, "latched", False), "early_release", True),
    "ground aborts": (
        TENSIONING_S,
        lambda r: r.commands.append(GroundCommand(r.now_s, "abort")),
        "abort",
        True,
    ),
    "current runs away": (TENSIONING_S, lambda r: setattr(r, "extra_current_a", 2.0), "over_current", False),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_ends_in_its_named_safe_state(fault: str) -> None:
    start_s, act, reason, relaxed = FAULTS[fault]
    robot, log = FakeRobot(SETTINGS, nut_m=0.006), ListLog()
    done: list[bool] = []

    def look() -> None:
        if not done and robot.now_s > start_s:
            done.append(True)
            act(robot)

    robot.on_tick = look
    result = fly(fake_board(robot), SETTINGS, ONE_HOP, log)
    assert result.end_reason == reason
    assert log.phases()[-1] == "safe"
    assert ("de_tension" in log.phases()) is relaxed
    assert not robot.magnet_times_s  # no fault ever fires the robot
    assert robot.voltage_v == 0.0
    assert not result.hops
    if relaxed:
        assert robot.nut_m <= robot.home_m


def test_a_misfire_is_named_and_the_spring_relaxed() -> None:
    robot = FakeRobot(SETTINGS, nut_m=0.002)
    robot.magnet_works = False
    result, log = flown(robot)
    assert result.end_reason == "misfire"
    assert log.phases()[-3:] == ["firing", "de_tension", "safe"]
    assert not robot.magnet_on
    assert not result.spring_loaded


def test_switches_that_stick_before_the_hop_leave_the_mission_incomplete() -> None:
    """The nut is never seen at home again, so it runs into its stop, and nothing shows the spring unloaded."""
    robot, log = FakeRobot(SETTINGS, nut_m=0.002), ListLog()

    def stick() -> None:
        if robot.now_s > TENSIONING_S:
            robot.held_switches = (False, True)

    robot.on_tick = stick
    result = fly(fake_board(robot), SETTINGS, ONE_HOP, log)
    assert len(result.hops) == 1
    assert log.phases()[-3:] == ["homing", "de_tension", "safe"]
    assert result.end_reason == "over_current"
    assert result.spring_loaded
    assert not result.completed


def test_a_mission_is_complete_only_with_all_hops_made_and_the_spring_shown_unloaded() -> None:
    result, _ = flown(FakeRobot(SETTINGS, nut_m=0.002), MissionPlan("short", (HopPlan(1.0),)))
    assert result.completed
    assert not replace(result, spring_loaded=True).completed
    assert not replace(result, end_reason="over_current").completed
    assert not replace(result, hops=(), made=0).completed


def test_a_self_test_that_fails_moves_nothing() -> None:
    robot = FakeRobot(SETTINGS, nut_m=0.002)
    robot.failing.add("accelerometer")
    result, log = flown(robot)
    assert result.end_reason == "self_test_accelerometer_silent"
    assert robot.nut_m == 0.002
    assert log.events("read_failed")[0]["sensor"] == "accelerometer"


def test_a_lock_that_does_not_take_the_string_is_found_with_a_small_force() -> None:
    robot = FakeRobot(SETTINGS, nut_m=0.002)
    robot.slips = True
    result, log = flown(robot)
    assert result.end_reason == "latch_does_not_hold"
    assert "tensioning" not in log.phases()


def test_an_exception_switches_everything_off_and_is_named() -> None:
    robot = FakeRobot(SETTINGS, nut_m=0.002)

    def trip() -> None:
        if robot.now_s > 10.0:
            robot.broken = True

    robot.on_tick = trip
    result, log = flown(robot)
    assert result.end_reason == "exception:ZeroDivisionError"
    assert log.of("state")[-1]["to"] == "safe"
    assert robot.voltage_v == 0.0
    assert result.spring_loaded


def test_a_tick_that_comes_too_late_is_reported_and_a_long_silence_is_a_fault() -> None:
    robot = FakeRobot(SETTINGS, nut_m=0.002)
    slips = iter((2.0, 3.0))
    waiting = [next(slips), 0.02]

    def stall() -> None:
        if robot.now_s > waiting[0]:
            robot.advance(robot.now_s + waiting[1])
            waiting[:] = [next(slips, 1e9), 0.2]

    robot.on_tick = stall
    result, log = flown(robot)
    assert len(log.events("tick_late")) == 2
    assert result.end_reason == "watchdog"


def test_ground_commands_pass_the_same_checks_as_the_missions_own() -> None:
    robot = FakeRobot(SETTINGS, nut_m=0.002)
    robot.commands = [
        GroundCommand(0.0, "fire", authenticated=True),
        GroundCommand(0.0, "arm", authenticated=True),
        GroundCommand(0.0, "tension", (("energy_j", 1e9),), authenticated=True),
        GroundCommand(0.0, "self_destruct"),
    ]
    result, log = flown(robot)
    refused = [event["command"] for event in log.events("command_refused")]
    assert refused == ["fire", "arm", "tension", "self_destruct"]
    assert result.completed


def test_a_mission_may_keep_the_newest_reports_alone_and_decides_alike() -> None:
    """The measured C2_ref of a report that is gone counts on; the log has every hop."""
    steel = HopPlan(12.0, "steel", place="plate", reference=True)
    plan = MissionPlan("reference first", (steel, HopPlan(12.0, place="A"), HopPlan(12.0, place="A")))
    whole, few = ListLog(), ListLog()
    every = fly(fake_board(FakeRobot(SETTINGS, nut_m=0.002)), SETTINGS, plan, whole)
    newest = fly(fake_board(FakeRobot(SETTINGS, nut_m=0.002)), SETTINGS, plan, few, kept_reports=1)
    assert few.entries == whole.entries
    assert len(few.of("hop")) == 3
    assert newest.hops == every.hops[-1:]
    assert newest.hops[0].c2_ref_source == "direct"
    assert (newest.made, every.made) == (3, 3)
    assert newest.completed


def test_reference_hops_give_c2_for_the_hops_after_them() -> None:
    from two_mass import SAND, STEEL

    robot = FakeRobot(SETTINGS, nut_m=0.002)
    robot.grounds = [STEEL, SAND]
    plan = MissionPlan(
        "reference first",
        (HopPlan(12.0, "steel", place="plate", reference=True), HopPlan(12.0, place="A")),
    )
    result, _ = flown(robot, plan)
    reference, hop = result.hops
    assert reference.c2_measured is not None
    assert reference.c3 is None
    assert hop.c2_ref_source == "direct"
    assert hop.c2_ref.value == pytest.approx(reference.c2_measured.value)
    assert hop.c3 is not None
    steel, sand = robot.hops
    # The errors of stiffness and masses are common to both hops and must cancel in the ratio.
    truth = 1.0 - sand.height_m / steel.height_m
    assert hop.c3.sigma < 0.01
    assert abs(hop.c3.value - truth) < 3.0 * hop.c3.sigma
    assert hop.belief is not None
    assert hop.belief.c3_mean == pytest.approx(hop.c3.value, abs=0.01)


def test_a_failing_log_cannot_keep_the_motor_on() -> None:
    class FullDisk(ListLog):
        def write(self, topic: str, time_s: float, payload: object) -> None:
            if time_s > 6.0:
                raise OSError("no space left")

    robot = FakeRobot(SETTINGS, nut_m=0.002)
    result = fly(fake_board(robot), SETTINGS, ONE_HOP, FullDisk())
    assert result.end_reason == "exception:OSError"
    assert robot.voltage_v == 0.0


def test_the_drive_of_a_stiffer_rig_is_flown_with_its_own_settings() -> None:
    """Half the speed in the settings is half the speed of the nut: nothing is hidden in code."""
    slow = replace(SETTINGS, drive=replace(SETTINGS.drive, tensioning_speed_m_s=0.0015))
    times = []
    for settings in (SETTINGS, slow):
        robot, log = FakeRobot(settings, nut_m=0.0), ListLog()
        fly(fake_board(robot), settings, MissionPlan("m", (HopPlan(3.0),)), log)
        at = {p["to"]: t for topic, t, p in log.entries if topic == "state"}
        times.append(at["hold"] - at["tensioning"])
    assert 1.5 < times[1] / times[0] < 2.1
