"""Fault protection: runs the table of monitors (`monitors` in config/flight.yaml), once each tick. Pure.

`quantities.py` says what each monitor measures; the table says the rest. A monitor whose quantity cannot be
computed is dead, which is a fault by itself: the watchdog is stroked only while all of them are alive.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from flight.quantities import QUANTITIES, Quantity
from flight.settings import FlightSettings
from flight.states import SENSORS, Machine, Snapshot, changed
from flight.tensioning import energy_used_j

MONITOR_DEAD = "monitor_dead"


@dataclass(frozen=True)
class Fault:
    """A fault: the row of the table that says what follows, and the reason in particular (its own name)."""

    monitor: str
    detail: str = ""

    @property
    def reason(self) -> str:
        return self.detail or self.monitor


def watch(machine: Machine, snap: Snapshot, settings: FlightSettings) -> tuple[Machine, tuple[str, ...]]:
    """The machine with each monitor's count of ticks beyond its limit, and the names of dead monitors."""
    counts: dict[str, int] = {}
    dead: list[str] = []
    phase, beyond = machine.phase, machine.beyond_ticks
    measured: Quantity | None = None
    quantity: float | None = None
    for name, low, high, phases in settings.measured_monitors:
        measure = QUANTITIES[name]
        if measure is not measured:  # the timeouts, one after the other, have theirs in common
            measured = measure
            try:
                quantity = measure(machine, snap, settings)
            except (ArithmeticError, LookupError, TypeError, ValueError):
                quantity = math.nan
        if quantity is None:  # nothing new is known
            if name in beyond and phase in phases:
                counts[name] = beyond[name]
        elif not low <= quantity <= high:
            if quantity != quantity:  # no number
                dead.append(name)
            elif phase in phases:
                counts[name] = beyond.get(name, 0) + 1
    return (changed(machine, beyond_ticks=counts) if counts or beyond else machine), tuple(dead)


def find_fault(machine: Machine, dead: tuple[str, ...], settings: FlightSettings) -> Fault | None:
    """The first fault of this tick in the order of the table; None when all is well."""
    if dead:
        return Fault(MONITOR_DEAD)
    if not machine.beyond_ticks:
        return None
    for name, rule in settings.monitors.items():
        if machine.beyond_ticks.get(name, 0) >= rule.for_ticks:
            return Fault(name)
    return None


def self_test_failures(snap: Snapshot, settings: FlightSettings) -> tuple[str, ...]:
    """What a robot at rest with everything off should show, and does not; what is no number shows nothing."""
    safety, rest_m_s2 = settings.safety, settings.rig.static_reading_m_s2
    most_m = settings.max_compression_m
    missing = tuple(f"{name}_silent" for name in SENSORS if snap.age_s(name) > safety.sensor_age_s)
    if missing:
        return missing
    checks = {
        "accelerometer_not_at_rest": not abs(snap.specific_force_m_s2 - rest_m_s2)
        <= safety.static_tolerance_share * rest_m_s2,
        "spring_out_of_range": not -most_m < snap.compression_m < most_m,
        "motor_current_not_idle": not abs(snap.motor_current_a) <= safety.idle_current_a,
        "magnet_current_not_idle": not abs(snap.magnet_current_a) <= safety.idle_current_a,
    }
    return tuple(name for name, failed in checks.items() if failed)


def firing_interlocks(machine: Machine, snap: Snapshot, settings: FlightSettings) -> tuple[str, ...]:
    """Interlocks that forbid arming or firing now; empty when all allow it."""
    safety, rest_m_s2 = settings.safety, settings.rig.static_reading_m_s2
    wanted_j = machine.target.energy_used_j if machine.target else 0.0
    stored_j = energy_used_j(machine.compression_m, settings.rig)
    extremes_m_s2 = (snap.specific_force_high_m_s2, snap.specific_force_low_m_s2)
    still = all(abs(force - rest_m_s2) <= safety.standing_tolerance_m_s2 for force in extremes_m_s2)
    checks = {
        "no_target": machine.target is None,
        "latch_open": not snap.latch_closed,
        "energy_off_target": not abs(stored_j - wanted_j) <= safety.firing_energy_tolerance * wanted_j,
        "not_stable": machine.stable_ticks < safety.stable_ticks,
        "not_standing_still": not still,
        "fault_pending": bool(machine.reason) or not machine.drive_trusted,
        "monitor_beyond_limit": bool(machine.beyond_ticks),
    }
    stale = tuple(f"{name}_old" for name in SENSORS if snap.age_s(name) > safety.firing_age_s)
    return tuple(name for name, forbids in checks.items() if forbids) + stale


def reset_interlocks(
    machine: Machine, snap: Snapshot, settings: FlightSettings, dead: tuple[str, ...] = ()
) -> tuple[str, ...]:
    """What forbids leaving SAFE now; empty when the robot may start again from its self-test. `dead`: monitors."""
    stale = tuple(f"{name}_old" for name in SENSORS if snap.age_s(name) > settings.safety.sensor_age_s)
    checks = {
        "drive_not_trusted": not machine.drive_trusted,  # the watchdog has cut the power, or will
        "magnet_disobeys": snap.magnet_failed,
        "magnet_current_flows": not abs(snap.magnet_current_a) <= settings.safety.idle_current_a,
        "not_stable": machine.stable_ticks < settings.safety.stable_ticks,
        **{f"{name}_beyond_limit": True for name in machine.beyond_ticks},
        **{f"{name}_dead": True for name in dead},
    }
    return tuple(name for name, forbids in checks.items() if forbids) + stale
