"""What must hold while the robot works, and what must hold before it fires. Pure functions of one tick."""

from __future__ import annotations

from dataclasses import dataclass

from flight.settings import FlightSettings
from flight.states import SENSORS, Machine, Phase, Snapshot
from flight.tensioning import energy_used_j

MOVING = frozenset({Phase.HOMING, Phase.LATCH_CHECK, Phase.TENSIONING, Phase.DE_TENSION})
HOLDING = frozenset({Phase.READY, Phase.TENSIONING, Phase.HOLD, Phase.ARMED})
STARTING = frozenset({Phase.POWER_UP, Phase.SELF_TEST})

# Sensors without which the drive cannot be moved safely.
DRIVE_SENSORS = frozenset({"motor_current", "nut_encoder", "switches"})


@dataclass(frozen=True)
class Fault:
    """A named fault; `drive_trusted` says whether the spring may still be relaxed under control."""

    reason: str
    drive_trusted: bool = True


def find_fault(machine: Machine, snap: Snapshot, settings: FlightSettings) -> Fault | None:
    """The first fault of this tick, the gravest kinds first; None when all is well."""
    if snap.power_maybe_cut:
        return Fault("watchdog", drive_trusted=True)
    if snap.magnet_failed and machine.phase is not Phase.DE_TENSION:  # which is the answer to it
        return Fault("magnet_command_failed", drive_trusted=True)
    for check in (_stale, _current, _stuck, _obedience, _stall, _travel, _lock, _disagreement, _overtime):
        fault = check(machine, snap, settings)
        if fault is not None:
            return fault
    return None


def _stale(machine: Machine, snap: Snapshot, settings: FlightSettings) -> Fault | None:
    if machine.phase in STARTING:  # the self-test waits for first readings, within its own time
        return None
    for sensor in SENSORS:
        needed = machine.phase is not Phase.DE_TENSION or sensor in DRIVE_SENSORS
        if needed and snap.age_s(sensor) > settings.safety.sensor_age_s:
            return Fault(f"{sensor}_stale", drive_trusted=sensor not in DRIVE_SENSORS)
    return None


def _current(machine: Machine, snap: Snapshot, settings: FlightSettings) -> Fault | None:
    if machine.over_current_ticks >= settings.safety.over_current_ticks:
        return Fault("over_current", drive_trusted=False)
    return None


def _stuck(machine: Machine, snap: Snapshot, settings: FlightSettings) -> Fault | None:
    """A reading that carries noise or must move, and stays the same to the last bit."""
    if machine.phase in STARTING:
        return None
    most = settings.safety.stuck_samples
    if machine.same_current.repeats >= most:
        return Fault("motor_current_stuck", drive_trusted=False)
    if machine.same_force.repeats >= most and machine.phase is not Phase.DE_TENSION:  # not needed there
        return Fault("accelerometer_stuck")
    return None


def _obedience(machine: Machine, snap: Snapshot, settings: FlightSettings) -> Fault | None:
    if machine.disobeyed_ticks >= settings.safety.disobey_ticks:
        return Fault("motor_disobeys", drive_trusted=False)
    return None


def _stall(machine: Machine, snap: Snapshot, settings: FlightSettings) -> Fault | None:
    if machine.phase in MOVING and snap.time_s - machine.moved_s > settings.safety.stall_s:
        return Fault("stall", drive_trusted=False)
    return None


def _travel(machine: Machine, snap: Snapshot, settings: FlightSettings) -> Fault | None:
    if machine.phase not in HOLDING | {Phase.LATCH_CHECK}:
        return None
    if snap.compression_m > settings.safety.max_compression_m:
        return Fault("over_travel")
    if machine.taut_m is not None and snap.nut_position_m - machine.taut_m > settings.safety.max_travel_m:
        return Fault("over_travel")
    return None


def _lock(machine: Machine, snap: Snapshot, settings: FlightSettings) -> Fault | None:
    """The lock has let go although nobody fired."""
    if machine.phase not in HOLDING:
        return None
    expected_m, safety = machine.compression_m, settings.safety
    dropped = snap.compression_m < safety.early_release_share * expected_m
    if not snap.latch_closed or (dropped and expected_m > 2.0 * safety.unloaded_compression_m):
        return Fault("early_release")
    return None


def _disagreement(machine: Machine, snap: Snapshot, settings: FlightSettings) -> Fault | None:
    """Spring sensor against encoder, s = (x - x_taut)/(1 + k/k_m)."""
    if machine.phase not in HOLDING or machine.taut_m is None:
        return None
    by_encoder_m = (snap.nut_position_m - machine.taut_m) / settings.rig.travel_per_compression
    allowed_m = settings.safety.disagreement_m + settings.safety.disagreement_share * abs(by_encoder_m)
    if abs(snap.compression_m - by_encoder_m) > allowed_m:
        return Fault("spring_disagrees_with_encoder")
    return None


def _overtime(machine: Machine, snap: Snapshot, settings: FlightSettings) -> Fault | None:
    timeouts = settings.timeouts
    limit_s = {
        Phase.HOMING: timeouts.homing_s,
        Phase.LATCH_CHECK: timeouts.latch_s,
        Phase.READY: timeouts.ready_s,
        Phase.TENSIONING: timeouts.tensioning_s,
        Phase.HOLD: timeouts.hold_s,
        Phase.DE_TENSION: timeouts.de_tension_s,
        Phase.FLIGHT: timeouts.flight_s,
    }.get(machine.phase)
    if limit_s is not None and snap.time_s - machine.since_s > limit_s:
        moving = machine.phase in (Phase.HOMING, Phase.DE_TENSION)
        return Fault(f"{machine.phase}_timeout", drive_trusted=not moving)
    return None


def self_test_failures(snap: Snapshot, settings: FlightSettings) -> tuple[str, ...]:
    """What a robot at rest with everything off should show, and does not."""
    safety, rest_m_s2 = settings.safety, settings.rig.static_reading_m_s2
    missing = tuple(f"{name}_silent" for name in SENSORS if snap.age_s(name) > safety.sensor_age_s)
    if missing:
        return missing
    checks = {
        "accelerometer_not_at_rest": abs(snap.specific_force_m_s2 - rest_m_s2)
        > safety.static_tolerance_share * rest_m_s2,
        "spring_out_of_range": not -safety.max_compression_m < snap.compression_m < safety.max_compression_m,
        "motor_current_not_idle": abs(snap.motor_current_a) > safety.idle_current_a,
        "magnet_current_not_idle": abs(snap.magnet_current_a) > safety.idle_current_a,
    }
    return tuple(name for name, failed in checks.items() if failed)


def firing_interlocks(machine: Machine, snap: Snapshot, settings: FlightSettings) -> tuple[str, ...]:
    """Interlocks that forbid arming or firing now; empty when all allow it."""
    safety, rest_m_s2 = settings.safety, settings.rig.static_reading_m_s2
    wanted_j = machine.target.energy_used_j if machine.target else 0.0
    stored_j = energy_used_j(machine.compression_m, settings.rig)
    unrest_m_s2 = max(
        abs(snap.specific_force_high_m_s2 - rest_m_s2), abs(snap.specific_force_low_m_s2 - rest_m_s2)
    )
    checks = {
        "no_target": machine.target is None,
        "latch_open": not snap.latch_closed,
        "energy_off_target": abs(stored_j - wanted_j) > safety.firing_energy_tolerance * wanted_j,
        "not_stable": machine.stable_ticks < safety.stable_ticks,
        "not_standing_still": unrest_m_s2 > safety.standing_tolerance_m_s2,
        "fault_pending": bool(machine.reason) or not machine.drive_trusted,
    }
    stale = tuple(f"{name}_old" for name in SENSORS if snap.age_s(name) > safety.firing_age_s)
    return tuple(name for name, forbids in checks.items() if forbids) + stale
