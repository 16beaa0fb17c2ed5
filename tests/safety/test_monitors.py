"""Each monitor of the fault table: it trips beyond its limit after its time, and not below it or before.

The readings are those of a robot in a phase where all is well (which no monitor minds), changed in one respect.
"""

from __future__ import annotations

from typing import Any

import pytest
from monitor_cases import CASES, RULES, SETTINGS, Case, healthy

from flight import hop_machine, monitors
from flight.monitors import MONITOR_DEAD, find_fault, watch
from flight.quantities import QUANTITIES
from flight.states import Machine, Phase
from hal.dictionary import dictionary


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
