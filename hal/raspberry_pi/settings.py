"""Settings of the Raspberry Pi board: `config/boards/raspberry_pi.yaml`. Pins are GPIO (BCM) numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from hal.config import Limits
from hal.errors import ConfigError

Positive = Annotated[float, Limits(1e-12, 1e12)]
NotNegative = Annotated[float, Limits(0.0, 1e12)]
Address = Annotated[int, Limits(0x08, 0x77)]
Bus = Annotated[int, Limits(0, 31)]
Pin = Annotated[int, Limits(0, 27)]
Sign = Annotated[int, Limits(-1, 1)]

AXES = ("x", "y", "z")
ACCELEROMETERS = ("lsm6dso32", "adxl375")
CONVERTERS = ("ads1015", "ads1115")
MOTOR_STAGES = ("roboclaw", "h_bridge")


@dataclass(frozen=True)
class AccelerometerSettings:
    """The accelerometer: which part, where, which of its axes lies along the leg, and its sign."""

    part: str
    bus: Bus
    address: Address
    axis: str
    sign: Sign
    range_g: Annotated[int, Limits(4, 200)]
    rate_hz: Positive  # at power-up
    self_test: bool


@dataclass(frozen=True)
class CurrentSettings:
    """An INA226 with its shunt; `max_current_a` sets the size of its digit, a 32768th of it."""

    bus: Bus
    address: Address
    shunt_ohm: Positive
    max_current_a: Positive
    sign: Sign
    rate_hz: Positive  # at power-up; the motor's is fixed
    depth: Annotated[int, Limits(1, 1_000_000)]
    timeout_s: Positive  # without a new conversion a read fails


@dataclass(frozen=True)
class SpringSettings:
    """The spring-compression sensor: a differential voltage on AIN0-AIN1 of an ADS1x15."""

    part: str
    bus: Bus
    address: Address
    full_scale_v: Positive
    zero_v: float
    m_per_v: float
    rates_hz: tuple[Positive, ...]  # the first is taken at power-up
    depth: Annotated[int, Limits(1, 1_000_000)]


@dataclass(frozen=True)
class RoboClawSettings:
    """A motor controller of the RoboClaw kind: motor and encoder on its channel 1."""

    port: str
    baud: Annotated[int, Limits(2400, 3_000_000)]
    address: Annotated[int, Limits(0x80, 0x87)]
    reply_timeout_s: Positive
    retries: Annotated[int, Limits(0, 5)]
    watchdog_s: Annotated[float, Limits(0.1, 25.5)]  # the controller stops the motor after this silence


@dataclass(frozen=True)
class PwmSettings:
    """One channel of the kernel's PWM, below /sys/class/pwm."""

    chip: Annotated[int, Limits(0, 31)]
    channel: Annotated[int, Limits(0, 31)]
    frequency_hz: Annotated[float, Limits(1.0, 1e6)]


@dataclass(frozen=True)
class HBridgeSettings:
    """An H-bridge on a PWM, with a direction pin, and a quadrature counter LS7366R on SPI."""

    pwm: PwmSettings
    direction_pin: Pin
    supply_v: Positive
    spi_device: str
    spi_speed_hz: Annotated[int, Limits(1000, 10_000_000)]


@dataclass(frozen=True)
class MotorStageSettings:
    """The motor's driver stage: which one, its limit, and the way of the nut per count of the encoder."""

    stage: str
    max_voltage_v: Positive
    sign: Sign
    supply_min_v: Positive
    supply_max_v: Positive
    m_per_count: Positive
    roboclaw: RoboClawSettings | None = None
    h_bridge: HBridgeSettings | None = None


@dataclass(frozen=True)
class MagnetSettings:
    """The electromagnet: full supply for `peak_s`, then `hold_duty`; less current than `min_current_a` is a fault."""

    pwm: PwmSettings
    peak_s: Positive
    hold_duty: Annotated[float, Limits(0.01, 1.0)]
    min_current_a: NotNegative


@dataclass(frozen=True)
class SwitchSettings:
    """The two contacts; closed contacts pull their pin low."""

    home_pin: Pin
    latch_pin: Pin


@dataclass(frozen=True)
class WatchdogSettings:
    """The supervisor on two pins that holds the actuators' supply, and the kernel's watchdog behind it."""

    heartbeat_pin: Pin
    arm_pin: Pin
    timeout_s: Positive  # of the supervisor
    device: str
    device_timeout_s: Annotated[int, Limits(1, 15)]


@dataclass(frozen=True)
class PiSettings:
    """Everything that the board needs to know of its wiring."""

    accelerometer: AccelerometerSettings
    motor_current: CurrentSettings
    magnet_current: CurrentSettings
    spring: SpringSettings
    motor: MotorStageSettings
    magnet: MagnetSettings
    switches: SwitchSettings
    watchdog: WatchdogSettings


def check_wiring(settings: PiSettings, source: str) -> None:
    """Refuse settings that are each possible but not together. Raises `ConfigError`."""
    accelerometer, spring, motor = settings.accelerometer, settings.spring, settings.motor
    _one_of(accelerometer.part, ACCELEROMETERS, "accelerometer.part", source)
    _one_of(accelerometer.axis, AXES, "accelerometer.axis", source)
    _one_of(spring.part, CONVERTERS, "spring.part", source)
    _one_of(motor.stage, MOTOR_STAGES, "motor.stage", source)
    if not spring.rates_hz:
        raise ConfigError(f"{source}: spring.rates_hz must name at least one rate")
    if getattr(motor, motor.stage) is None:
        raise ConfigError(f"{source}: motor.stage = {motor.stage!r} needs the block motor.{motor.stage}")
    if not motor.supply_min_v <= motor.supply_max_v:
        raise ConfigError(
            f"{source}: motor.supply_min_v = {motor.supply_min_v:g} is above supply_max_v = {motor.supply_max_v:g}"
        )
    for key, sign in (
        ("accelerometer.sign", accelerometer.sign),
        ("motor.sign", motor.sign),
        ("motor_current.sign", settings.motor_current.sign),
        ("magnet_current.sign", settings.magnet_current.sign),
    ):
        if sign == 0:
            raise ConfigError(f"{source}: {key} = 0 must be 1 or -1")
    _check_places(settings, source)


def _one_of(value: str, known: tuple[str, ...], key: str, source: str) -> None:
    if value not in known:
        raise ConfigError(f"{source}: {key} = {value!r} is unknown; known here: {', '.join(known)}")


def _check_places(settings: PiSettings, source: str) -> None:
    """No pin and no address may be used twice."""
    places: dict[str, str] = {}

    def take(key: str, place: str) -> None:
        if place in places:
            raise ConfigError(f"{source}: {key} and {places[place]} are both at {place}")
        places[place] = key

    for key in ("accelerometer", "motor_current", "magnet_current", "spring"):
        part = getattr(settings, key)
        take(f"{key}.address", f"I2C bus {part.bus} address {part.address:#04x}")
    take("switches.home_pin", f"pin {settings.switches.home_pin}")
    take("switches.latch_pin", f"pin {settings.switches.latch_pin}")
    take("watchdog.heartbeat_pin", f"pin {settings.watchdog.heartbeat_pin}")
    take("watchdog.arm_pin", f"pin {settings.watchdog.arm_pin}")
    take("magnet.pwm", f"PWM {settings.magnet.pwm.chip}.{settings.magnet.pwm.channel}")
    if settings.motor.stage == "h_bridge" and settings.motor.h_bridge is not None:
        bridge = settings.motor.h_bridge
        take("motor.h_bridge.direction_pin", f"pin {bridge.direction_pin}")
        take("motor.h_bridge.pwm", f"PWM {bridge.pwm.chip}.{bridge.pwm.channel}")
