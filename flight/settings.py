"""The settings of the flight software: one checked, frozen dataclass per part of `config/flight.yaml`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated

from flight.log import LogSettings
from flight.monitor_settings import MonitorLimit, MonitorSettings, monitors_problem
from flight.parameters import parameters_problem
from flight.rig import NotNegative, Positive, Share, rig_problem
from flight.rig import RigSettings as RigSettings
from flight.surface.settings import SurfaceLearning
from hal.config import Limits, config_path, load_settings
from hal.errors import ConfigError

Count = Annotated[int, Limits(1, 100000)]


@dataclass(frozen=True)
class TickSettings:
    """The fixed rate of the executive."""

    rate_hz: Annotated[float, Limits(10.0, 2000.0)]
    overrun_share: Share
    telemetry_period_s: Positive

    @cached_property
    def period_s(self) -> float:
        return 1.0 / self.rate_hz


@dataclass(frozen=True)
class GroundSettings:
    """What the estimator expects of grounds under the foot: wide priors, in logarithms."""

    soft_stiffness_n_m: Positive
    hard_stiffness_n_m: Positive
    loading_stiffness_n_m: Positive
    stiffness_log_std: Positive


@dataclass(frozen=True)
class EvaluationSettings:
    """Stated errors of the evaluation's own models (1 sigma)."""

    gravity_error_m_s2: Positive
    rise_error_m: Positive
    push_error_share: Positive
    take_off_error_s: Positive
    touchdown_error_s: Positive
    sampling_error_1_s: NotNegative
    friction_error_s3_m: NotNegative
    reference_repeatability: Share
    ground: GroundSettings


@dataclass(frozen=True)
class DriveSettings:
    """The tensioning drive and how it is driven."""

    resistance_ohm: Positive
    torque_constant_n_m_a: Positive
    viscous_friction_n_m_s: NotNegative
    coulomb_friction_n_m: NotNegative
    screw_lead_m: Positive
    gear_ratio: Positive
    tensioning_efficiency: Annotated[float, Limits(0.05, 1.0)]
    back_driving_efficiency: Annotated[float, Limits(0.0, 1.0)]
    max_voltage_v: Positive
    voltage_slew_v_s: Positive
    power_limit_w: Positive
    power_margin: Annotated[float, Limits(0.1, 1.0)]
    winding_resistance_k_w: Positive
    winding_time_constant_s: Positive
    current_smoothing: Annotated[float, Limits(0.001, 1.0)]
    speed_gain: NotNegative
    tensioning_speed_m_s: Positive
    creep_speed_m_s: Positive
    approach_rate_1_s: Positive
    homing_speed_m_s: Positive
    latch_check_speed_m_s: Positive

    @cached_property
    def travel_per_radian_m(self) -> float:
        """Nut travel per motor angle, r = p/(2 pi N)."""
        return self.screw_lead_m / (2.0 * math.pi * self.gear_ratio)


@dataclass(frozen=True)
class TensionSettings:
    """Energies that may be asked for and how precisely they are met."""

    max_energy_j: Positive
    min_energy_j: Positive
    tolerance: Annotated[float, Limits(1e-4, 0.1)]
    settle_s: Positive
    fusion_gain: Annotated[float, Limits(0.001, 1.0)]


@dataclass(frozen=True)
class SafetySettings:
    """Limits of the monitors and interlocks."""

    max_slack_m: Positive
    unloaded_compression_m: Positive
    latch_check_compression_m: Positive
    latch_check_start_m: Positive
    latch_check_slope_tolerance: Share
    disagreement_share: Share
    stall_speed_m_s: Positive
    sensor_age_s: Positive
    firing_age_s: Positive
    firing_energy_tolerance: Share
    stable_ticks: Count
    stable_speed_m_s: Positive
    standing_tolerance_m_s2: Positive
    static_tolerance_share: Share
    idle_current_a: Positive
    home_agreement_m: Positive
    magnet_rise_s: Positive
    error_memory_ticks: Count


@dataclass(frozen=True)
class TimeoutSettings:
    """How long each phase may take."""

    self_test_s: Positive
    arm_min_s: Positive
    arm_window_s: Positive
    landing_quiet_s: Positive
    flight_min_s: Positive


@dataclass(frozen=True)
class SensorSettings:
    """Rates asked of the sensors and their white noise (1 sigma)."""

    spring_drive_rate_hz: Positive
    spring_hop_rate_hz: Positive
    accelerometer_rate_hz: Positive
    magnet_current_rate_hz: Positive
    spring_drive_noise_m: Positive
    spring_hop_noise_m: Positive
    spring_step_m: Positive
    accelerometer_noise_m_s2: Positive
    accelerometer_step_m_s2: Positive
    scale_std_share: Share


@dataclass(frozen=True)
class FlightSettings:
    """All settings of the flight software."""

    tick: TickSettings
    rig: RigSettings
    evaluation: EvaluationSettings
    drive: DriveSettings
    tension: TensionSettings
    safety: SafetySettings
    timeouts: TimeoutSettings
    sensors: SensorSettings
    log: LogSettings
    surface: SurfaceLearning
    monitors: dict[str, MonitorSettings]

    @cached_property
    def measured_monitors(self) -> tuple[MonitorLimit, ...]:
        """The monitors that compare a quantity with a limit, in the order of the table."""
        return tuple(rule.limit_of(name) for name, rule in self.monitors.items() if rule.measured)

    @property
    def max_compression_m(self) -> float:
        """Compression beyond which the fault table ends the tensioning."""
        return self.monitors["over_compression"].above or 0.0


def load(path: Path | None = None) -> FlightSettings:
    """Read and check the settings, `config/flight.yaml` unless another file is given.

    Raises `ConfigError` naming file, key, value and limit, also where two settings contradict each other.
    """
    where = path or config_path("flight.yaml")
    settings = load_settings(where, FlightSettings)
    if problem := settings_problem(settings):
        raise ConfigError(f"{where}: {problem}")
    return settings


def settings_problem(settings: FlightSettings) -> str:
    """What is wrong with settings, in words: outside the dictionary, or in contradiction; empty for nothing."""
    return (
        parameters_problem(settings)
        or monitors_problem(settings.monitors)
        or rig_problem(settings.rig)
        or _motion_problem(settings)
        or _safety_problem(settings)
    )


def _motion_problem(settings: FlightSettings) -> str:
    rig, drive, safety = settings.rig, settings.drive, settings.safety
    most_travel_m = settings.monitors["over_travel"].above or 0.0
    weight_n = rig.body_mass_kg * rig.gravity_m_s2
    most_m = settings.max_compression_m
    most_j = 0.5 * rig.spring_stiffness_n_m * most_m**2 + weight_n * most_m
    if settings.tension.max_energy_j > most_j:
        return (
            f"tension.max_energy_j = {settings.tension.max_energy_j:g} is beyond what "
            f"monitors.over_compression.above = {most_m:g} stores ({most_j:.4g} J)"
        )
    if settings.tension.min_energy_j >= settings.tension.max_energy_j:
        return "tension.min_energy_j must be below tension.max_energy_j"
    if most_m * rig.travel_per_compression > most_travel_m:
        return (
            f"monitors.over_travel.above = {most_travel_m:g} does not reach "
            f"monitors.over_compression.above = {most_m:g} ({most_m * rig.travel_per_compression:.4g} m of travel)"
        )
    if drive.creep_speed_m_s <= safety.stall_speed_m_s:
        return "drive.creep_speed_m_s must be above safety.stall_speed_m_s"
    no_load_m_s = drive.max_voltage_v / drive.torque_constant_n_m_a * drive.travel_per_radian_m
    for key in ("tensioning_speed_m_s", "homing_speed_m_s", "latch_check_speed_m_s", "creep_speed_m_s"):
        if getattr(drive, key) > no_load_m_s:
            return (
                f"drive.{key} = {getattr(drive, key):g} is beyond the drive's no-load speed {no_load_m_s:.4g}"
            )
    return ""


def _safety_problem(settings: FlightSettings) -> str:
    safety, timeouts = settings.safety, settings.timeouts
    if not safety.latch_check_start_m < safety.latch_check_compression_m:
        return "safety.latch_check_start_m must be below safety.latch_check_compression_m"
    if safety.latch_check_compression_m <= safety.unloaded_compression_m:
        return "safety.latch_check_compression_m must be above safety.unloaded_compression_m"
    if timeouts.arm_min_s >= timeouts.arm_window_s:
        return "timeouts.arm_min_s must be below timeouts.arm_window_s"
    for key in ("sensor_age_s", "firing_age_s"):
        if getattr(safety, key) < 2.0 * settings.tick.period_s:
            least_s = 2.0 * settings.tick.period_s
            return f"safety.{key} = {getattr(safety, key):g} is below two ticks ({least_s:g} s)"
    if settings.tension.tolerance > safety.firing_energy_tolerance:
        return "safety.firing_energy_tolerance must not be below tension.tolerance"
    return ""
