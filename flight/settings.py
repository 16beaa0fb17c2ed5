"""The settings of the flight software: one checked, frozen dataclass per part of `config/flight.yaml`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from hal.config import Limits, config_path, load_settings
from hal.errors import ConfigError

Positive = Annotated[float, Limits(1e-12, 1e12)]
NotNegative = Annotated[float, Limits(0.0, 1e12)]
Share = Annotated[float, Limits(0.0, 1.0)]
Count = Annotated[int, Limits(1, 100000)]


@dataclass(frozen=True)
class TickSettings:
    """The fixed rate of the executive."""

    rate_hz: Annotated[float, Limits(10.0, 2000.0)]
    overrun_share: Share
    watchdog_margin: Share

    @property
    def period_s(self) -> float:
        return 1.0 / self.rate_hz


@dataclass(frozen=True)
class VerticalRig:
    """Two masses that move along a vertical line."""

    body_mass_kg: Positive
    leg_mass_kg: Positive
    gravity_m_s2: Positive


@dataclass(frozen=True)
class ArmRig:
    """A robot on a rotating arm: radius of its centre of mass, of the accelerometer, and what moves."""

    com_radius_m: Positive
    sensor_radius_m: Positive
    local_gravity_m_s2: Positive
    moving_mass_without_foot_kg: Positive


@dataclass(frozen=True)
class Foot:
    """One foot of Table 3: mass, moments of inertia with it, and its reference dissipation C2_ref."""

    mass_kg: NotNegative
    leg_inertia_kg_m2: Positive
    total_inertia_kg_m2: Positive
    c2_ref_mean: Share
    c2_ref_std: Share


@dataclass(frozen=True)
class RigSettings:
    """Masses, springs and geometry. Masses and gravity are the (equivalent) ones of a vertical motion."""

    name: str
    geometry: str
    foot: str
    feet: dict[str, Foot]
    mass_std_share: Share
    gravity_std_share: Share
    spring_stiffness_n_m: Positive
    spring_stiffness_std_share: Share
    spring_damping_n_s_m: Positive
    spring_damping_std_share: Share
    series_stiffness_n_m: Positive
    series_stiffness_std_share: Share
    vertical: VerticalRig | None = None
    arm: ArmRig | None = None

    @property
    def equivalent(self) -> VerticalRig:
        """The two masses and the gravity of the motion along the leg.

        On an arm: m_l = I_leg/L^2, m_b = (I_total - I_leg)/L^2, g = M g_local L^2/I_total.
        """
        if self.geometry == "vertical":
            assert self.vertical is not None
            return self.vertical
        return self.arm_equivalent

    @property
    def arm_equivalent(self) -> VerticalRig:
        assert self.arm is not None
        foot, square = self.feet[self.foot], self.arm.com_radius_m**2
        moving_kg = self.arm.moving_mass_without_foot_kg + foot.mass_kg
        return VerticalRig(
            (foot.total_inertia_kg_m2 - foot.leg_inertia_kg_m2) / square,
            foot.leg_inertia_kg_m2 / square,
            moving_kg * self.arm.local_gravity_m_s2 * square / foot.total_inertia_kg_m2,
        )

    @property
    def body_mass_kg(self) -> float:
        return self.equivalent.body_mass_kg

    @property
    def leg_mass_kg(self) -> float:
        return self.equivalent.leg_mass_kg

    @property
    def gravity_m_s2(self) -> float:
        return self.equivalent.gravity_m_s2

    @property
    def sensor_gain(self) -> float:
        """Accelerometer reading per acceleration of the body: rho/L on an arm, 1 on a vertical line."""
        if self.geometry == "vertical" or self.arm is None:
            return 1.0
        return self.arm.sensor_radius_m / self.arm.com_radius_m

    @property
    def static_reading_m_s2(self) -> float:
        """What the accelerometer reads at rest."""
        if self.geometry == "vertical" or self.arm is None:
            return self.gravity_m_s2
        return self.arm.local_gravity_m_s2

    @property
    def travel_per_compression(self) -> float:
        """Nut travel per spring compression, x/s = 1 + k/k_m."""
        return 1.0 + self.spring_stiffness_n_m / self.series_stiffness_n_m


@dataclass(frozen=True)
class EvaluationSettings:
    """Stated errors of the evaluation's own models (1 sigma)."""

    gravity_error_m_s2: Positive
    rise_error_m: Positive
    chatter_s: NotNegative
    reference_repeatability: Share


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
    current_smoothing: Annotated[float, Limits(0.001, 1.0)]
    speed_gain: NotNegative
    tensioning_speed_m_s: Positive
    creep_speed_m_s: Positive
    approach_rate_1_s: Positive
    homing_speed_m_s: Positive
    latch_check_speed_m_s: Positive

    @property
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

    max_compression_m: Positive
    max_travel_m: Positive
    max_slack_m: Positive
    unloaded_compression_m: Positive
    latch_check_compression_m: Positive
    latch_check_start_m: Positive
    latch_check_slope_tolerance: Share
    disagreement_m: Positive
    disagreement_share: Share
    early_release_share: Share
    over_current_a: Positive
    over_current_ticks: Count
    stall_speed_m_s: Positive
    stall_s: Positive
    sensor_age_s: Positive
    firing_age_s: Positive
    firing_energy_tolerance: Share
    stable_ticks: Count
    stable_speed_m_s: Positive
    standing_tolerance_m_s2: Positive
    static_tolerance_share: Share
    idle_current_a: Positive


@dataclass(frozen=True)
class TimeoutSettings:
    """How long each phase may take."""

    self_test_s: Positive
    homing_s: Positive
    de_tension_s: Positive
    latch_s: Positive
    tensioning_s: Positive
    hold_s: Positive
    arm_min_s: Positive
    arm_window_s: Positive
    release_s: Positive
    flight_s: Positive
    landing_quiet_s: Positive
    flight_min_s: Positive
    ready_s: Positive


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


def load(path: Path | None = None) -> FlightSettings:
    """Read and check the settings, `config/flight.yaml` unless another file is given.

    Raises `ConfigError` naming file, key, value and limit, also where two settings contradict each other.
    """
    where = path or config_path("flight.yaml")
    settings = load_settings(where, FlightSettings)
    for problem in (_rig_problem(settings.rig), _motion_problem(settings), _safety_problem(settings)):
        if problem:
            raise ConfigError(f"{where}: {problem}")
    return settings


def _rig_problem(rig: RigSettings) -> str:
    if rig.geometry not in ("vertical", "arm"):
        return f"rig.geometry = {rig.geometry!r} must be 'vertical' or 'arm'"
    if getattr(rig, rig.geometry) is None:
        return f"rig.geometry = {rig.geometry!r} needs the block rig.{rig.geometry}"
    if rig.foot not in rig.feet:
        return f"rig.foot = {rig.foot!r} is not among rig.feet ({', '.join(rig.feet)})"
    for name, foot in rig.feet.items():
        if foot.leg_inertia_kg_m2 >= foot.total_inertia_kg_m2:
            return (
                f"rig.feet.{name}: leg_inertia_kg_m2 = {foot.leg_inertia_kg_m2:g} must be below "
                f"total_inertia_kg_m2 = {foot.total_inertia_kg_m2:g}"
            )
    return _equivalence_problem(rig) if rig.vertical and rig.arm else ""


def _equivalence_problem(rig: RigSettings) -> str:
    """Two descriptions of one rig must agree; 0.5 % leaves room for rounded figures."""
    assert rig.vertical is not None
    for key in ("body_mass_kg", "leg_mass_kg", "gravity_m_s2"):
        said, follows = getattr(rig.vertical, key), getattr(rig.arm_equivalent, key)
        if abs(said / follows - 1.0) > 0.005:
            return (
                f"rig.vertical.{key} = {said:g} contradicts rig.arm with foot {rig.foot}, "
                f"which give {follows:.4g}"
            )
    return ""


def _motion_problem(settings: FlightSettings) -> str:
    rig, drive, safety = settings.rig, settings.drive, settings.safety
    weight_n = rig.body_mass_kg * rig.gravity_m_s2
    most_m = safety.max_compression_m
    most_j = 0.5 * rig.spring_stiffness_n_m * most_m**2 + weight_n * most_m
    if settings.tension.max_energy_j > most_j:
        return (
            f"tension.max_energy_j = {settings.tension.max_energy_j:g} is beyond what "
            f"safety.max_compression_m = {most_m:g} stores ({most_j:.4g} J)"
        )
    if settings.tension.min_energy_j >= settings.tension.max_energy_j:
        return "tension.min_energy_j must be below tension.max_energy_j"
    if most_m * rig.travel_per_compression > safety.max_travel_m:
        return (
            f"safety.max_travel_m = {safety.max_travel_m:g} does not reach "
            f"safety.max_compression_m = {most_m:g} ({most_m * rig.travel_per_compression:.4g} m of travel)"
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
