"""Energy-targeted tensioning: from an energy to a compression, and the voltages that get and stay there.

Closed forms of the drive: tau_load = r F/eta while tensioning, r F eta_b while back-driving; the nut stays
put while r F eta_b - tau_c <= K i <= r F/eta + tau_c.
"""

from __future__ import annotations

import math

from flight.rig import RigSettings
from flight.settings import DriveSettings, FlightSettings


def energy_used_j(compression_m: float, rig: RigSettings) -> float:
    """Usable energy E_used = k (f_grav + s)^2/2 - k f_grav^2/2 with f_grav = m_b g/k."""
    weight_n = rig.body_mass_kg * rig.gravity_m_s2
    return 0.5 * rig.spring_stiffness_n_m * compression_m**2 + weight_n * compression_m


def compression_for_energy_m(energy_j: float, rig: RigSettings) -> float:
    """The compression s at which E_used is `energy_j` (not negative): the inverse of `energy_used_j`."""
    k, weight_n = rig.spring_stiffness_n_m, rig.body_mass_kg * rig.gravity_m_s2
    return (math.sqrt(weight_n**2 + 2.0 * k * energy_j) - weight_n) / k


def string_force_n(compression_m: float, rig: RigSettings) -> float:
    """Force in the string, F = k s, none when slack."""
    return rig.spring_stiffness_n_m * max(compression_m, 0.0)


def hold_voltage_v(compression_m: float, settings: FlightSettings) -> float:
    """The voltage that puts the motor torque in the middle of the stuck band, where the nut rests safest."""
    drive = settings.drive
    screw_n_m = drive.travel_per_radian_m * string_force_n(compression_m, settings.rig)
    middle_n_m = 0.5 * screw_n_m * (drive.back_driving_efficiency + 1.0 / drive.tensioning_efficiency)
    return drive.resistance_ohm * middle_n_m / drive.torque_constant_n_m_a


def moving_current_a(speed_m_s: float, compression_m: float, settings: FlightSettings) -> float:
    """Motor current of steady motion at the given nut speed (its sign says which losses apply)."""
    drive = settings.drive
    omega = speed_m_s / drive.travel_per_radian_m
    screw_n_m = drive.travel_per_radian_m * string_force_n(compression_m, settings.rig)
    if speed_m_s >= 0.0:
        load_n_m = screw_n_m / drive.tensioning_efficiency + drive.coulomb_friction_n_m
    else:
        load_n_m = screw_n_m * drive.back_driving_efficiency - drive.coulomb_friction_n_m
    return (load_n_m + drive.viscous_friction_n_m_s * omega) / drive.torque_constant_n_m_a


def drive_voltage_v(
    wanted_m_s: float, speed_m_s: float, compression_m: float, mean_current_a: float, settings: FlightSettings
) -> float:
    """Voltage for a wanted nut speed: steady-state feed-forward plus a proportional correction.

    While tensioning it stays below the power limit over the current, modelled or measured (the larger).
    """
    drive = settings.drive
    current_a = moving_current_a(wanted_m_s, compression_m, settings)
    omega = wanted_m_s / drive.travel_per_radian_m
    error = (wanted_m_s - speed_m_s) / drive.travel_per_radian_m
    voltage_v = (
        drive.torque_constant_n_m_a * (omega + drive.speed_gain * error) + drive.resistance_ohm * current_a
    )
    if wanted_m_s > 0.0:
        busy_a = max(current_a, mean_current_a)
        voltage_v = min(voltage_v, drive.power_margin * drive.power_limit_w / busy_a)
    return max(-drive.max_voltage_v, min(drive.max_voltage_v, voltage_v))


def disobedience_v(commanded_v: float, current_a: float, speed_m_s: float, drive: DriveSettings) -> float:
    """How far the voltage that the motor shows, u = R i + K omega, is from the commanded one.

    This is the motor's own circuit (its inductance left out: a fraction of a millisecond), so it holds
    whatever the load, and also for a nut that jams.
    """
    omega = speed_m_s / drive.travel_per_radian_m
    return abs(commanded_v - drive.resistance_ohm * current_a - drive.torque_constant_n_m_a * omega)


def slew_limited_v(wanted_v: float, present_v: float, period_s: float, drive: DriveSettings) -> float:
    """The next voltage on the way to the wanted one, so that starting up does not draw the stall current."""
    step_v = drive.voltage_slew_v_s * period_s
    return max(present_v - step_v, min(present_v + step_v, wanted_v))


def approach_speed_m_s(remaining_m: float, drive: DriveSettings) -> float:
    """Speed allowed with `remaining_m` of nut travel to go: full, then proportional, then a creep."""
    return min(drive.tensioning_speed_m_s, max(drive.creep_speed_m_s, drive.approach_rate_1_s * remaining_m))


def fused_compression_m(
    estimate_m: float, sensed_m: float | None, travel_m: float, taut: bool, settings: FlightSettings
) -> float:
    """Compression from the spring sensor, carried along by the encoder while the string is taut.

    The encoder's prediction s = x/(1 + k/k_m) has no lag, the spring sensor no drift. Without a fresh
    reading (`None`) the encoder alone carries the estimate.
    """
    predicted_m = estimate_m + (travel_m / settings.rig.travel_per_compression if taut else 0.0)
    if sensed_m is None:
        return predicted_m
    return predicted_m + settings.tension.fusion_gain * (sensed_m - predicted_m)
