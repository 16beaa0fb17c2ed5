"""What the monitors measure: one number each, compared with the limit of its row in the fault table.

`None` says that there is nothing to measure at this tick. Pure functions of machine and snapshot.
"""

from __future__ import annotations

from collections.abc import Callable

from flight import tensioning
from flight.settings import FlightSettings
from flight.states import NEVER, SENSORS, Machine, Phase, Snapshot

Quantity = Callable[[Machine, Snapshot, FlightSettings], float | None]


def _age_of(sensor: str) -> Quantity:
    return lambda machine, snap, settings: snap.time_s - snap.sampled_s.get(sensor, NEVER)


def _time_in_phase_s(machine: Machine, snap: Snapshot, settings: FlightSettings) -> float:
    return snap.time_s - machine.since_s


def _clock_step_s(machine: Machine, snap: Snapshot, settings: FlightSettings) -> float | None:
    """How far the clock's step is from a tick's period; a step back counts whole."""
    if machine.elapsed_s is None:
        return None
    return float("inf") if machine.elapsed_s < 0.0 else abs(machine.elapsed_s - settings.tick.period_s)


def _disobedience_v(machine: Machine, snap: Snapshot, settings: FlightSettings) -> float | None:
    """How far the motor's own circuit is from the voltage that it can have; unknown without fresh readings.

    A supply that sags has a monitor of its own, which lets the motor relax the spring with what there is.
    """
    most_s = settings.safety.firing_age_s
    if snap.age_s("nut_encoder") > most_s or snap.age_s("motor_current") > most_s:
        return None
    voltage_v = machine.voltage_v
    if snap.supply_v is not None and not abs(voltage_v) <= snap.supply_v:
        most_v = max(snap.supply_v, 0.0)
        voltage_v = max(-most_v, min(most_v, voltage_v))
    return tensioning.disobedience_v(voltage_v, snap.motor_current_a, machine.speed_m_s, settings.drive)


def _excess_speed_m_s(machine: Machine, snap: Snapshot, settings: FlightSettings) -> float:
    """How much faster the nut moves than it shall."""
    return abs(machine.speed_m_s) - abs(machine.wanted_m_s)


def _still_s(machine: Machine, snap: Snapshot, settings: FlightSettings) -> float:
    return snap.time_s - machine.moved_s


def _travel_m(machine: Machine, snap: Snapshot, settings: FlightSettings) -> float | None:
    return None if machine.taut_m is None else snap.nut_position_m - machine.taut_m


def _by_encoder_m(machine: Machine, snap: Snapshot, settings: FlightSettings) -> float | None:
    """The compression that the encoder shows, s = (x - x_taut)/(1 + k/k_m)."""
    travel_m = _travel_m(machine, snap, settings)
    return None if travel_m is None else travel_m / settings.rig.travel_per_compression


def _string_force_n(machine: Machine, snap: Snapshot, settings: FlightSettings) -> float:
    """Force in the string: the larger of what the spring shows and what the pulling motor's current does."""
    drive, shown_n = settings.drive, tensioning.string_force_n(snap.compression_m, settings.rig)
    if machine.phase is not Phase.TENSIONING or machine.speed_m_s < settings.safety.stall_speed_m_s:
        return shown_n
    torque_n_m = drive.torque_constant_n_m_a * machine.mean_current_a - drive.coulomb_friction_n_m
    return max(shown_n, torque_n_m * drive.tensioning_efficiency / drive.travel_per_radian_m)


def _share_lost(machine: Machine, snap: Snapshot, settings: FlightSettings) -> float | None:
    """Share of the compression wound up by the nut that the spring does not show."""
    wound_m = _by_encoder_m(machine, snap, settings)
    if wound_m is None or wound_m < 2.0 * settings.safety.unloaded_compression_m:
        return None
    return 1.0 - snap.compression_m / wound_m


def _disagreement_m(machine: Machine, snap: Snapshot, settings: FlightSettings) -> float | None:
    """Spring sensor against encoder, less the share that is allowed."""
    wound_m = _by_encoder_m(machine, snap, settings)
    if wound_m is None:
        return None
    return abs(snap.compression_m - wound_m) - settings.safety.disagreement_share * abs(wound_m)


def _compression_doubt(machine: Machine, snap: Snapshot, settings: FlightSettings) -> float | None:
    """Share by which the compression to be fired with is in doubt: fused against encoder, beyond the noise."""
    wound_m = _by_encoder_m(machine, snap, settings)
    if wound_m is None or wound_m < 2.0 * settings.safety.unloaded_compression_m:
        return None
    return max(0.0, abs(machine.compression_m - wound_m) - settings.sensors.spring_drive_noise_m) / wound_m


def _compression_at_home_m(machine: Machine, snap: Snapshot, settings: FlightSettings) -> float | None:
    """Compression while the home switch is closed, where there should be none."""
    return snap.compression_m if snap.at_home else None


def _unrest_m_s2(machine: Machine, snap: Snapshot, settings: FlightSettings) -> float:
    return abs(snap.specific_force_m_s2 - settings.rig.static_reading_m_s2)


def _silence_of_ground_s(machine: Machine, snap: Snapshot, settings: FlightSettings) -> float | None:
    """Time since the ground was heard; a mission that never heard it flies on its own."""
    return None if machine.heard_s is None else snap.time_s - machine.heard_s


def _open_latch_s(machine: Machine, snap: Snapshot, settings: FlightSettings) -> float:
    return 0.0 if snap.latch_closed else snap.time_s - machine.since_s


def _risen_magnet_current_a(machine: Machine, snap: Snapshot, settings: FlightSettings) -> float | None:
    risen = snap.time_s - machine.since_s > settings.safety.magnet_rise_s
    return snap.magnet_current_a if risen else None


QUANTITIES: dict[str, Quantity] = {
    "clock_jump": _clock_step_s,
    "watchdog": lambda machine, snap, settings: snap.unstroked_share,
    "tick_overrun": lambda machine, snap, settings: snap.tick_late_s / settings.tick.period_s,
    "magnet_command_failed": lambda machine, snap, settings: float(snap.magnet_failed),
    "magnet_on_unasked": lambda machine, snap, settings: abs(snap.magnet_current_a),
    "log_unwritable": lambda machine, snap, settings: float(snap.log_failed),
    "memory_unwritable": lambda machine, snap, settings: float(snap.memory_failed),
    **{f"{sensor}_stale": _age_of(sensor) for sensor in SENSORS},
    "over_current": lambda machine, snap, settings: abs(snap.motor_current_a),
    "motor_current_stuck": lambda machine, snap, settings: float(machine.same_current.repeats),
    "motor_disobeys": _disobedience_v,
    "motor_runs_away": _excess_speed_m_s,
    "stall": _still_s,
    "supply_sag": lambda machine, snap, settings: snap.supply_v,
    "hot_motor": lambda machine, snap, settings: machine.winding_rise_k,
    "over_travel": _travel_m,
    "over_compression": lambda machine, snap, settings: snap.compression_m,
    "over_force": _string_force_n,
    "early_release": lambda machine, snap, settings: float(not snap.latch_closed),
    "string_broken": _share_lost,
    "spring_disagrees_with_encoder": _disagreement_m,
    "stored_energy_uncertain": _compression_doubt,
    "home_switch_stuck": _compression_at_home_m,
    "accelerometer_stuck": lambda machine, snap, settings: float(machine.same_force.repeats),
    "accelerometer_implausible": _unrest_m_s2,
    "bus_errors": lambda machine, snap, settings: machine.failed_reads,
    "link_lost": _silence_of_ground_s,
    "latch_did_not_close": _open_latch_s,
    "magnet_open": _risen_magnet_current_a,
    "magnet_shorted": lambda machine, snap, settings: snap.magnet_current_a,
    "misfire": _time_in_phase_s,
    **{
        f"{phase}_timeout": _time_in_phase_s
        for phase in (
            Phase.HOMING,
            Phase.LATCH_CHECK,
            Phase.READY,
            Phase.TENSIONING,
            Phase.HOLD,
            Phase.SAFE_HOLD,
            Phase.DE_TENSION,
            Phase.FLIGHT,
        )
    },
}
"""The quantity of each monitor, by the monitor's name."""
