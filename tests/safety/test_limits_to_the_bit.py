"""Checks of the self-test and the interlocks at their limits to the last bit: the limit itself is still good."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from monitor_cases import NOW, SETTINGS, healthy

from flight import monitors
from flight.quantities import QUANTITIES
from flight.settings import FlightSettings
from flight.states import SENSORS, Machine, Phase, Snapshot
from flight.tensioning import compression_for_energy_m, energy_used_j

REST, SHARE, IDLE_A, STANDING = 8.0, 0.25, 0.5, 1.0
"""Numbers with few bits, so that sums and differences with them are exact."""
AGE_S = 0.125


@pytest.fixture
def settings() -> FlightSettings:
    safety = replace(
        SETTINGS.safety,
        static_tolerance_share=SHARE,
        idle_current_a=IDLE_A,
        sensor_age_s=AGE_S,
        firing_age_s=AGE_S,
        standing_tolerance_m_s2=STANDING,
    )
    rig = SETTINGS.rig
    vertical = replace(rig.equivalent, gravity_m_s2=REST)
    return replace(
        SETTINGS, safety=safety, rig=replace(rig, geometry="vertical", vertical=vertical, arm=None)
    )


def at_rest() -> Snapshot:
    return Snapshot(time_s=NOW, specific_force_m_s2=REST, sampled_s=dict.fromkeys(SENSORS, NOW))


def above(value: float) -> float:
    """The next number further from zero."""
    return math.nextafter(value, math.copysign(math.inf, value))


def test_a_robot_at_rest_passes_its_self_test(settings: FlightSettings) -> None:
    assert monitors.self_test_failures(at_rest(), settings) == ()


@pytest.mark.parametrize(
    ("name", "field", "limit", "good_at_limit"),
    [
        ("accelerometer_not_at_rest", "specific_force_m_s2", REST * (1.0 + SHARE), True),
        ("accelerometer_not_at_rest", "specific_force_m_s2", REST * (1.0 - SHARE), True),
        ("motor_current_not_idle", "motor_current_a", IDLE_A, True),
        ("motor_current_not_idle", "motor_current_a", -IDLE_A, True),
        ("magnet_current_not_idle", "magnet_current_a", IDLE_A, True),
        ("magnet_current_not_idle", "magnet_current_a", -IDLE_A, True),
        ("spring_out_of_range", "compression_m", SETTINGS.max_compression_m, False),
        ("spring_out_of_range", "compression_m", -SETTINGS.max_compression_m, False),
    ],
)
def test_the_self_test_fails_beyond_each_limit_alone(
    name: str, field: str, limit: float, good_at_limit: bool, settings: FlightSettings
) -> None:
    beyond = limit - 1e-9 if limit == REST * (1.0 - SHARE) else above(limit)
    within = limit if good_at_limit else math.nextafter(limit, 0.0)
    assert monitors.self_test_failures(at_rest()._replace(**{field: within}), settings) == ()
    outside = beyond if good_at_limit else limit
    assert monitors.self_test_failures(at_rest()._replace(**{field: outside}), settings) == (name,)


@pytest.mark.parametrize(
    ("name", "field"),
    [
        ("accelerometer_not_at_rest", "specific_force_m_s2"),
        ("motor_current_not_idle", "motor_current_a"),
        ("magnet_current_not_idle", "magnet_current_a"),
        ("spring_out_of_range", "compression_m"),
    ],
)
def test_what_is_no_number_passes_no_self_test(name: str, field: str, settings: FlightSettings) -> None:
    assert monitors.self_test_failures(at_rest()._replace(**{field: math.nan}), settings) == (name,)


@pytest.mark.parametrize("field", ["specific_force_high_m_s2", "specific_force_low_m_s2"])
def test_what_is_no_number_stands_not_still(field: str, settings: FlightSettings) -> None:
    machine, snap = ready(settings)
    assert monitors.firing_interlocks(machine, snap, settings) == ()
    lost = snap._replace(**{field: math.nan})
    assert monitors.firing_interlocks(machine, lost, settings) == ("not_standing_still",)


def test_a_monitor_counts_what_is_below_its_limit_and_not_the_limit(settings: FlightSettings) -> None:
    machine, snap = healthy(Phase.HOLD)
    least_v = settings.monitors["supply_sag"].below
    assert least_v is not None
    for supply_v, counted in ((least_v, 0), (math.nextafter(least_v, 0.0), 1)):
        watched, dead = monitors.watch(machine, snap._replace(supply_v=supply_v), settings)
        assert (watched.beyond_ticks.get("supply_sag", 0), dead) == (counted, ())


def test_silent_sensors_are_named_and_nothing_that_they_would_have_said(settings: FlightSettings) -> None:
    snap = at_rest()._replace(specific_force_m_s2=0.0)
    for name in SENSORS:
        old = snap._replace(sampled_s={**snap.sampled_s, name: above(NOW - AGE_S)})
        assert monitors.self_test_failures(old, settings) == ("accelerometer_not_at_rest",)
        silent = snap._replace(sampled_s={**snap.sampled_s, name: math.nextafter(NOW - AGE_S, 0.0)})
        assert monitors.self_test_failures(silent, settings) == (f"{name}_silent",)
        at_limit = snap._replace(sampled_s={**snap.sampled_s, name: NOW - AGE_S})
        assert monitors.self_test_failures(at_limit, settings) == ("accelerometer_not_at_rest",)
    never = at_rest()._replace(sampled_s={})
    assert monitors.self_test_failures(never, settings) == tuple(f"{name}_silent" for name in SENSORS)


def ready(settings: FlightSettings) -> tuple[Machine, Snapshot]:
    """A robot that may be armed."""
    machine, snap = healthy(Phase.HOLD)
    stored_j = energy_used_j(machine.compression_m, settings.rig)
    assert machine.target is not None
    machine = machine._replace(
        stable_ticks=settings.safety.stable_ticks,
        target=replace(machine.target, energy_used_j=stored_j),
        drive_trusted=True,
    )
    return machine, snap._replace(
        specific_force_m_s2=REST, specific_force_low_m_s2=REST, specific_force_high_m_s2=REST
    )


Change = Callable[[Machine, Snapshot], tuple[Machine, Snapshot]]


def of_snap(**changes: Any) -> Change:
    return lambda machine, snap: (machine, snap._replace(**changes))


def of_machine(**changes: Any) -> Change:
    return lambda machine, snap: (machine._replace(**changes), snap)


def aged(name: str, age_s: float) -> Change:
    return lambda machine, snap: (machine, snap._replace(sampled_s={**snap.sampled_s, name: NOW - age_s}))


STABLE = SETTINGS.safety.stable_ticks
FORBIDDING: dict[str, tuple[tuple[str, Change], ...]] = {
    "latch_open": (("open", of_snap(latch_closed=False)),),
    "not_stable": (("one tick short", of_machine(stable_ticks=STABLE - 1)),),
    "not_standing_still": (
        ("high", of_snap(specific_force_high_m_s2=above(REST + STANDING))),
        ("low", of_snap(specific_force_low_m_s2=math.nextafter(REST - STANDING, 0.0))),
    ),
    "fault_pending": (
        ("a reason", of_machine(reason="stall")),
        ("the drive", of_machine(drive_trusted=False)),
    ),
    "monitor_beyond_limit": (("one", of_machine(beyond_ticks={"stall": 1})),),
    **{f"{name}_old": (("old", aged(name, AGE_S + 1e-9)),) for name in SENSORS},
}
ALLOWING: dict[str, Change] = {
    "standing, high": of_snap(specific_force_high_m_s2=REST + STANDING),
    "standing, low": of_snap(specific_force_low_m_s2=REST - STANDING),
    "more than stable": of_machine(stable_ticks=STABLE + 1),
    **{f"{name} of the limit's age": aged(name, AGE_S) for name in SENSORS},
}


def test_a_robot_that_is_ready_may_fire(settings: FlightSettings) -> None:
    assert monitors.firing_interlocks(*ready(settings), settings) == ()


@pytest.mark.parametrize("name", FORBIDDING)
def test_each_interlock_forbids_firing_alone(name: str, settings: FlightSettings) -> None:
    for _, change in FORBIDDING[name]:
        assert monitors.firing_interlocks(*change(*ready(settings)), settings) == (name,)


@pytest.mark.parametrize("name", ALLOWING)
def test_the_limit_itself_allows_firing(name: str, settings: FlightSettings) -> None:
    assert monitors.firing_interlocks(*ALLOWING[name](*ready(settings)), settings) == ()


def test_without_a_target_no_energy_is_right(settings: FlightSettings) -> None:
    machine, snap = ready(settings)
    for stored_j in (0.01, 1.0, 15.0):
        held = machine._replace(target=None, compression_m=compression_for_energy_m(stored_j, settings.rig))
        assert monitors.firing_interlocks(held, snap, settings) == ("no_target", "energy_off_target")


def test_at_no_tolerance_the_wanted_energy_itself_may_be_fired(settings: FlightSettings) -> None:
    exact = replace(settings, safety=replace(settings.safety, firing_energy_tolerance=0.0))
    assert monitors.firing_interlocks(*ready(exact), exact) == ()


def test_all_monitors_that_cannot_be_computed_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> float:
        raise ZeroDivisionError

    names = [rule[0] for rule in SETTINGS.measured_monitors]
    dead = (names[0], names[-1])
    for name in dead:
        monkeypatch.setitem(QUANTITIES, name, broken)
    machine, snap = healthy(Phase.HOLD)
    found, named = monitors.watch(machine, snap, SETTINGS)
    assert (found is machine, named) == (True, dead)  # nothing was counted, so nothing is copied


def test_where_nothing_new_is_known_a_count_stays_in_its_phases_only(monkeypatch: pytest.MonkeyPatch) -> None:
    name, _, _, phases = next(rule for rule in SETTINGS.measured_monitors if len(rule[3]) < len(Phase))
    monkeypatch.setitem(QUANTITIES, name, lambda *_: None)
    for phase in Phase:
        machine, snap = healthy(Phase.HOLD)
        counting = machine._replace(phase=phase, beyond_ticks={name: 2})
        found = monitors.watch(counting, snap, SETTINGS)[0].beyond_ticks
        assert found.get(name) == (2 if phase in phases else None)


def test_the_stored_energy_may_be_off_by_its_tolerance(settings: FlightSettings) -> None:
    machine, snap = ready(settings)
    tolerance = settings.safety.firing_energy_tolerance
    stored_j = energy_used_j(machine.compression_m, settings.rig)
    assert machine.target is not None
    for off, forbidden in ((0.99, False), (1.01, True), (-0.99, False), (-1.01, True)):
        wanted_j = stored_j / (1.0 + off * tolerance)
        aimed = machine._replace(target=replace(machine.target, energy_used_j=wanted_j))
        found = monitors.firing_interlocks(aimed, snap, settings)
        assert found == (("energy_off_target",) if forbidden else ())


def test_the_limit_itself_allows_leaving_safe(settings: FlightSettings) -> None:
    machine, snap = ready(settings)
    assert monitors.reset_interlocks(machine, snap, settings) == ()
    for magnet_a in (IDLE_A, -IDLE_A):
        assert monitors.reset_interlocks(machine, snap._replace(magnet_current_a=magnet_a), settings) == ()
        flows = snap._replace(magnet_current_a=above(magnet_a))
        assert monitors.reset_interlocks(machine, flows, settings) == ("magnet_current_flows",)
    short = machine._replace(stable_ticks=STABLE - 1)
    assert monitors.reset_interlocks(short, snap, settings) == ("not_stable",)
    for name in SENSORS:
        assert monitors.reset_interlocks(*aged(name, AGE_S)(machine, snap), settings) == ()
        assert monitors.reset_interlocks(*aged(name, AGE_S + 1e-9)(machine, snap), settings) == (
            f"{name}_old",
        )
