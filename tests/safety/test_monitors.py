"""Each monitor of the fault table: it trips beyond its limit after its time, and not below it or before.

The readings are those of a robot in a phase where all is well (which no monitor minds), changed in one respect.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest

from flight import hop_machine, monitors
from flight import settings as flight_settings
from flight.monitors import MONITOR_DEAD, find_fault, watch
from flight.quantities import QUANTITIES
from flight.states import SENSORS, Machine, Phase, Sameness, Snapshot, Target
from flight.tensioning import compression_for_energy_m
from hal.dictionary import dictionary

SETTINGS = flight_settings.load()
REST = SETTINGS.rig.static_reading_m_s2
RATIO = SETTINGS.rig.travel_per_compression
NOW = 100.0
S_M = compression_for_energy_m(15.0, SETTINGS.rig)
TAUT_M = 0.001
RULES = SETTINGS.monitors
Changes = Callable[[float], tuple[dict[str, Any], dict[str, Any]]]


def healthy(phase: Phase) -> tuple[Machine, Snapshot]:
    """A machine and the snapshot of a robot that is well in that phase."""
    taut = phase not in (Phase.HOMING, Phase.LATCH_CHECK, Phase.FLIGHT)
    s_m = S_M if taut else 0.0
    machine = Machine(
        phase=phase,
        since_s=NOW - 0.05,
        taut_m=TAUT_M if taut else None,
        home_m=0.0,
        target=Target(15.0, S_M),
        compression_m=s_m,
        position_m=TAUT_M + s_m * RATIO,
        moved_s=NOW - 0.01,
        last_s=NOW - SETTINGS.tick.period_s,
        elapsed_s=SETTINGS.tick.period_s,
    )
    snap = Snapshot(
        time_s=NOW,
        nut_position_m=TAUT_M + s_m * RATIO,
        latch_closed=phase is not Phase.FLIGHT,
        compression_m=s_m,
        specific_force_m_s2=REST,
        sampled_s=dict.fromkeys(SENSORS, NOW),
        magnet_current_a=1.4 if phase is Phase.FIRING else 0.0,
        supply_v=12.0,
    )
    return machine, snap


def of_snap(name: str) -> Changes:
    return lambda value: ({}, {name: value})


def of_machine(name: str) -> Changes:
    return lambda value: ({name: value}, {})


def in_phase(value: float) -> tuple[dict[str, Any], dict[str, Any]]:
    return {"since_s": NOW - value}, {}


def aged(sensor: str) -> Changes:
    return lambda value: ({}, {"sampled_s": dict.fromkeys(SENSORS, NOW) | {sensor: NOW - value}})


def magnet_after_rise(value: float) -> tuple[dict[str, Any], dict[str, Any]]:
    return {"since_s": NOW - 0.03}, {"magnet_current_a": value}


@dataclass(frozen=True)
class Case:
    """How to bring a monitor's quantity to a value, in one phase; values just within and just beyond."""

    phase: Phase
    change: Changes
    within: float
    beyond: float


H, T = Phase.HOLD, Phase.TENSIONING
CASES: dict[str, Case] = {
    "clock_jump": Case(H, of_machine("elapsed_s"), 0.2, 0.3),
    "watchdog": Case(H, of_snap("unstroked_share"), 0.45, 0.55),
    "tick_overrun": Case(H, of_snap("tick_late_s"), 0.0020, 0.0030),
    "magnet_command_failed": Case(H, of_snap("magnet_failed"), 0, 1),
    "magnet_on_unasked": Case(H, of_snap("magnet_current_a"), 0.05, 1.5),
    "log_unwritable": Case(H, of_snap("log_failed"), 0, 1),
    "memory_unwritable": Case(H, of_snap("memory_failed"), 0, 1),
    **{f"{sensor}_stale": Case(H, aged(sensor), 0.05, 0.07) for sensor in SENSORS},
    "over_current": Case(T, of_snap("motor_current_a"), -1.4, -1.6),
    "motor_current_stuck": Case(T, lambda n: ({"same_current": Sameness(0.1, NOW, int(n))}, {}), 11, 12),
    "motor_disobeys": Case(H, of_machine("voltage_v"), 1.4, -1.6),
    "motor_runs_away": Case(H, of_machine("speed_m_s"), 0.0009, -0.0011),
    "stall": Case(T, lambda value: ({"moved_s": NOW - value}, {}), 0.55, 0.65),
    "supply_sag": Case(H, of_snap("supply_v"), 10.5, 9.5),
    "hot_motor": Case(H, of_machine("winding_rise_k"), 84.0, 86.0),
    "over_travel": Case(H, of_machine("taut_m"), -0.0005, -0.030),
    "over_compression": Case(H, of_snap("compression_m"), 0.0418, 0.0422),
    "over_force": Case(T, lambda a: ({"mean_current_a": a, "speed_m_s": 0.001}, {}), 0.55, 0.65),
    "early_release": Case(H, of_snap("latch_closed"), True, False),
    "string_broken": Case(H, of_snap("compression_m"), 0.62 * S_M, 0.55 * S_M),
    "spring_disagrees_with_encoder": Case(H, of_snap("compression_m"), 0.91 * S_M, 1.11 * S_M),
    "stored_energy_uncertain": Case(H, of_machine("compression_m"), 1.019 * S_M, 0.978 * S_M),
    "home_switch_stuck": Case(
        Phase.HOMING, lambda s: ({}, {"at_home": True, "compression_m": s}), 0.001, 0.002
    ),
    "accelerometer_stuck": Case(H, lambda n: ({"same_force": Sameness(9.0, NOW, int(n))}, {}), 11, 12),
    "accelerometer_implausible": Case(H, of_snap("specific_force_m_s2"), REST + 2.5, REST - 3.5),
    "bus_errors": Case(H, of_machine("failed_reads"), 14.0, 16.0),
    "link_lost": Case(H, lambda value: ({"heard_s": NOW - value}, {}), 110.0, 130.0),
    "latch_did_not_close": Case(
        Phase.LATCH_CHECK, lambda v: ({"since_s": NOW - v}, {"latch_closed": False}), 1.9, 2.1
    ),
    "magnet_open": Case(Phase.FIRING, magnet_after_rise, 0.6, 0.4),
    "magnet_shorted": Case(Phase.FIRING, of_snap("magnet_current_a"), 2.1, 2.3),
    "misfire": Case(Phase.FIRING, in_phase, 0.09, 0.11),
    **{
        f"{phase}_timeout": Case(phase, in_phase, 0.99 * limit, 1.01 * limit)
        for phase in Phase
        if (rule := RULES.get(f"{phase}_timeout")) and (limit := rule.above)
    },
}


def count(case: Case, value: float, ticks: int) -> Machine:
    """The machine after so many ticks of the same readings."""
    machine, snap = healthy(case.phase)
    of_machine_, of_snap_ = case.change(value)
    machine, snap = machine._replace(**of_machine_), snap._replace(**of_snap_)
    for _ in range(ticks):
        machine, dead = watch(machine, snap, SETTINGS)
        assert not dead
    return machine


def test_every_measured_monitor_has_its_case() -> None:
    assert set(CASES) == set(QUANTITIES)


@pytest.mark.parametrize(
    "phase", [Phase.HOMING, Phase.LATCH_CHECK, Phase.TENSIONING, Phase.HOLD, Phase.FIRING]
)
def test_a_healthy_robot_is_minded_by_no_monitor(phase: Phase) -> None:
    machine, snap = healthy(phase)
    assert watch(machine, snap, SETTINGS)[0].beyond_ticks == {}


@pytest.mark.parametrize("name", CASES)
def test_it_trips_beyond_its_limit_after_its_time_and_says_its_name(name: str) -> None:
    case, rule = CASES[name], RULES[name]
    machine = count(case, case.beyond, rule.for_ticks)
    assert machine.beyond_ticks[name] == rule.for_ticks
    others = {key for key in machine.beyond_ticks if key != name and RULES[key].for_ticks <= rule.for_ticks}
    # what is beyond another limit by the same reading is beyond that one, too; this one must count all the same
    fault = find_fault(machine._replace(beyond_ticks={name: rule.for_ticks}), (), SETTINGS)
    assert fault is not None
    assert fault.reason == name
    assert others <= {
        "spring_disagrees_with_encoder",
        "string_broken",
        "misfire",
        "over_compression",
        "stall",
        "motor_disobeys",
    }


@pytest.mark.parametrize("name", CASES)
def test_it_does_not_trip_within_its_limit(name: str) -> None:
    case = CASES[name]
    assert name not in count(case, case.within, RULES[name].for_ticks + 5).beyond_ticks


@pytest.mark.parametrize("name", [name for name in CASES if RULES[name].for_ticks > 1])
def test_it_does_not_trip_before_its_time_and_a_good_tick_starts_it_anew(name: str) -> None:
    case, rule = CASES[name], RULES[name]
    machine = count(case, case.beyond, rule.for_ticks - 1)
    assert machine.beyond_ticks[name] == rule.for_ticks - 1
    assert (fault := find_fault(machine, (), SETTINGS)) is None or fault.reason != name
    good, snap = healthy(case.phase)
    within_machine, within_snap = case.change(case.within)
    again = good._replace(beyond_ticks=machine.beyond_ticks, **within_machine)
    assert name not in watch(again, snap._replace(**within_snap), SETTINGS)[0].beyond_ticks


@pytest.mark.parametrize("name", CASES)
def test_it_does_not_trip_in_a_phase_where_it_is_not_watched(name: str) -> None:
    case, rule = CASES[name], RULES[name]
    elsewhere = next(phase for phase in (Phase.EVALUATE, *Phase) if phase not in rule.phases)
    machine, snap = healthy(case.phase)
    of_machine_, of_snap_ = case.change(case.beyond)
    machine = machine._replace(**{**of_machine_, "phase": elsewhere})
    assert name not in watch(machine, snap._replace(**of_snap_), SETTINGS)[0].beyond_ticks


@pytest.mark.parametrize("name", RULES)
def test_the_response_of_each_fault_is_what_the_table_says(name: str) -> None:
    """From HOLD with a loaded spring (the latch test's from there): held, relaxed, or cut off."""
    machine, snap = healthy(Phase.LATCH_CHECK if RULES[name].response == "retry" else Phase.HOLD)
    tick = hop_machine.Tick(machine, snap, SETTINGS)
    tick.fail(monitors.Fault(name))
    expected = {
        "retry": Phase.HOMING,
        "safe_hold": Phase.SAFE_HOLD,
        "de_tension": Phase.DE_TENSION,
        "power_off": Phase.SAFE,
    }[RULES[name].response]
    assert tick.machine.phase is expected
    assert tick.machine.drive_trusted is (RULES[name].response != "power_off")
    assert tick.machine.reason == ("" if expected is Phase.HOMING else name)


@pytest.mark.parametrize("name", [name for name, rule in RULES.items() if rule.response == "retry"])
def test_a_retry_is_made_so_many_times_and_then_something_else_follows(name: str) -> None:
    rule = RULES[name]
    machine, snap = healthy(Phase.LATCH_CHECK)
    for spent in range(rule.retries + 1):
        tick = hop_machine.Tick(machine._replace(retries=spent), snap, SETTINGS)
        tick.fail(monitors.Fault(name))
        assert tick.machine.phase is (Phase.HOMING if spent < rule.retries else Phase.DE_TENSION)


@pytest.mark.parametrize("broken", [float("nan"), ZeroDivisionError(), KeyError()])
def test_a_monitor_that_cannot_measure_is_dead_which_is_a_fault(
    broken: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def quantity(*_: object) -> float:
        if isinstance(broken, Exception):
            raise broken
        return float(broken)

    machine, snap = healthy(Phase.HOLD)
    well = hop_machine.step(machine, snap, (), SETTINGS)
    assert well.monitors_alive
    monkeypatch.setitem(QUANTITIES, "hot_motor", quantity)
    step = hop_machine.step(machine, snap, (), SETTINGS)
    assert not step.monitors_alive
    assert step.machine.phase is Phase.SAFE
    assert step.machine.reason == MONITOR_DEAD
    assert not step.machine.drive_trusted


def test_all_faults_have_a_meaning_in_the_dictionary() -> None:
    assert all(dictionary().events[name].severity == "fault" for name in RULES)
