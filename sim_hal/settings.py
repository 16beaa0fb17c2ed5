"""Settings of the simulated board, checked key by key (`config/boards/sim.yaml`)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from hal.config import Limits
from hal.errors import ConfigError

Positive = Limits(1e-12, 1e12)
NotNegative = Limits(0.0, 1e12)


@dataclass(frozen=True)
class Mode:
    """One rate of a sensor, with the noise and the range that come with it (units of the channel)."""

    rate_hz: Annotated[float, Limits(0.1, 20_000.0)]
    noise_std: Annotated[float, NotNegative]
    low: float
    high: float


@dataclass(frozen=True)
class SensorSettings:
    """One sensor: digital step (0: none), samples its FIFO holds, rates it has; it wakes up in the first."""

    step: Annotated[float, NotNegative]
    depth: Annotated[int, Limits(1, 1_000_000)]
    modes: tuple[Mode, ...]


@dataclass(frozen=True)
class Sensors:
    """All sampled sensors, by the name of their device on the board."""

    motor_current: SensorSettings
    nut_encoder: SensorSettings
    spring: SensorSettings
    accelerometer: SensorSettings
    magnet_current: SensorSettings


@dataclass(frozen=True)
class PlantFiles:
    """Plant files of the two phases: absolute, or below the configuration folder."""

    drive: str
    hop: str


@dataclass(frozen=True)
class Spot:
    """The ground under one hop, and how the robot stands on it.

    `values` are the hop plant's parameters that are other in this hop than in its file, by flat name: another
    foot's masses, this place's soil (`quartz_sand.chi`), a mechanism that runs rougher today (`c`).
    """

    surface: str
    foot: Annotated[int, Limits(0, 4)] = 1
    tilt_deg: Annotated[float, Limits(-45.0, 45.0)] = 0.0
    values: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class RigSettings:
    """Where the nut's travel ends; positions [m] count from where the string is just taut."""

    home_position_m: Annotated[float, Limits(-0.1, 0.0)]
    stop_low_m: Annotated[float, Limits(-0.2, 0.0)]
    stop_high_m: Annotated[float, Limits(0.0, 1.0)]
    stop_resistance_ohm: Annotated[float, Positive]


@dataclass(frozen=True)
class Initial:
    """How the robot is found at power-up: nut anywhere; with the latch closed and x > 0, loaded."""

    nut_position_m: Annotated[float, Limits(-0.2, 1.0)]
    latch_closed: bool


@dataclass(frozen=True)
class RestSettings:
    """When a hop is over: both masses slower than `speed_m_s` for `for_s`; an error after `timeout_s`."""

    speed_m_s: Annotated[float, Positive]
    for_s: Annotated[float, Limits(0.01, 10.0)]
    timeout_s: Annotated[float, Limits(1.0, 600.0)]


@dataclass(frozen=True)
class MotorSettings:
    """The motor's driver stage, and the supply that feeds it."""

    max_voltage_v: Annotated[float, Limits(0.1, 100.0)]
    supply_v: Annotated[float, Limits(0.1, 100.0)]


@dataclass(frozen=True)
class WatchdogSettings:
    """Longest time between two strokes."""

    timeout_s: Annotated[float, Limits(0.001, 60.0)]


@dataclass(frozen=True)
class LinkSettings:
    """Messages that the loopback keeps for the ground side to read."""

    depth: Annotated[int, Limits(1, 10_000_000)]


@dataclass(frozen=True)
class FaultSettings:
    """One planted fault; see `sim_hal.faults`."""

    device: str
    kind: str
    from_s: Annotated[float, NotNegative]
    until_s: Annotated[float | None, NotNegative] = None
    size: float = 0.0


@dataclass(frozen=True)
class SimSettings:
    """Everything that the simulated board needs."""

    seed: Annotated[int, Limits(0, 2**63)]
    plants: PlantFiles
    spots: tuple[Spot, ...]
    rig: RigSettings
    initial: Initial
    rest: RestSettings
    motor: MotorSettings
    watchdog: WatchdogSettings
    ground_link: LinkSettings
    sensors: Sensors
    conditions: dict[str, float] = field(default_factory=dict)
    faults: tuple[FaultSettings, ...] = ()


def check_contradictions(settings: SimSettings, source: str) -> None:
    """Refuse settings that are each possible but not together. Raises `ConfigError`."""
    rig, initial = settings.rig, settings.initial
    if not rig.stop_low_m < rig.home_position_m:
        raise ConfigError(f"{source}: rig.stop_low_m = {rig.stop_low_m} must lie below rig.home_position_m")
    if not rig.stop_low_m <= initial.nut_position_m <= rig.stop_high_m:
        raise ConfigError(
            f"{source}: initial.nut_position_m = {initial.nut_position_m} is outside the end stops "
            f"[{rig.stop_low_m}, {rig.stop_high_m}]"
        )
    if not settings.spots:
        raise ConfigError(f"{source}: spots must name at least one ground")
    for name, sensor in vars(settings.sensors).items():
        if not sensor.modes:
            raise ConfigError(f"{source}: sensors.{name}.modes must name at least one rate")
        for index, mode in enumerate(sensor.modes):
            if not mode.low < mode.high:
                raise ConfigError(
                    f"{source}: sensors.{name}.modes[{index}].low = {mode.low} "
                    f"must lie below its high = {mode.high}"
                )
