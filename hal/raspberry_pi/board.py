"""The Raspberry Pi board: drivers put together by the settings of its wiring.

Outputs are off before anything else is opened, and whatever fails while opening closes all that was opened.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import TypeVar

from hal.board import Board
from hal.devices import Accelerometer, Motor
from hal.errors import BoardUnavailable, DeviceError
from hal.raspberry_pi.ads1x15 import Ads1x15Spring
from hal.raspberry_pi.adxl375 import Adxl375
from hal.raspberry_pi.failsafe import FailSafe
from hal.raspberry_pi.ina226 import Ina226, Ina226MagnetCurrent, Ina226MotorCurrent
from hal.raspberry_pi.ls7366r import Ls7366r
from hal.raspberry_pi.lsm6dso32 import Lsm6dso32
from hal.raspberry_pi.magnet import PwmMagnet
from hal.raspberry_pi.motor import CountedNutEncoder, HBridgeStage, PiMotor, RoboClawStage
from hal.raspberry_pi.ports import Ports
from hal.raspberry_pi.pwm import PwmChannel
from hal.raspberry_pi.roboclaw import RoboClaw
from hal.raspberry_pi.settings import PiSettings
from hal.raspberry_pi.silent_link import SilentLink
from hal.raspberry_pi.switches import GpioSwitches
from hal.raspberry_pi.watchdog import PiWatchdog
from hal.raspberry_pi.wire import I2cBus, I2cPart

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class PiBoard(Board):
    """A board of drivers, with the ports below them."""

    ports: Ports
    fail_safe: FailSafe

    def close(self) -> None:
        """Close all devices, actuators first, then the ports.

        An actuator that does not answer raises nothing here: it is told once more, and with the closed watchdog the
        supervisor takes its supply. A flight whose motor failed shall still end with its log.
        """
        with suppress(DeviceError):
            super().close()
        self.fail_safe.make_safe()
        self.fail_safe.release()
        self.ports.close()


def assemble(name: str, settings: PiSettings, ports: Ports) -> PiBoard:
    """Open all drivers on `ports`. Raises `BoardUnavailable` for what is not there, else the driver's error."""
    fail_safe = FailSafe()
    try:
        return _Assembly(name, settings, ports, fail_safe).board()
    except BaseException:
        fail_safe.make_safe()
        fail_safe.release()
        ports.close()
        raise


class _Assembly:
    def __init__(self, name: str, settings: PiSettings, ports: Ports, fail_safe: FailSafe) -> None:
        self._name, self._settings, self._ports, self._fail_safe = name, settings, ports, fail_safe
        self._buses: dict[int, I2cBus] = {}

    def board(self) -> PiBoard:
        settings, ports, clock = self._settings, self._ports, self._ports.clock
        magnet_pwm = self._opened("magnet.pwm", lambda: PwmChannel(ports.sysfs, settings.magnet.pwm))
        self._fail_safe.add(magnet_pwm.off)
        motor, encoder = self._motor()
        magnet_current = Ina226MagnetCurrent(
            "magnet_current",
            Ina226(
                "magnet_current",
                self._part("magnet_current", settings.magnet_current.bus, settings.magnet_current.address),
                settings.magnet_current,
            ),
            ports.sampler,
            settings.magnet_current,
        )
        magnet = PwmMagnet(
            "magnet", magnet_pwm, clock, ports.sampler, magnet_current.newest_a, settings.magnet
        )
        motor_part = self._part("motor_current", settings.motor_current.bus, settings.motor_current.address)
        motor_current = Ina226("motor_current", motor_part, settings.motor_current)
        spring_part = self._part("spring", settings.spring.bus, settings.spring.address)
        return PiBoard(
            name=self._name,
            clock=clock,
            motor=motor,
            magnet=magnet,
            nut_encoder=encoder,
            motor_current=Ina226MotorCurrent("motor_current", motor_current, clock, settings.motor_current),
            magnet_current=magnet_current,
            spring=Ads1x15Spring("spring", spring_part, ports.sampler, settings.spring),
            accelerometer=self._accelerometer(),
            switches=self._opened(
                "switches", lambda: GpioSwitches("switches", ports.pins, clock, settings.switches)
            ),
            watchdog=self._watchdog(),
            ground_link=SilentLink("ground_link"),
            ports=ports,
            fail_safe=self._fail_safe,
        )

    def _motor(self) -> tuple[Motor, CountedNutEncoder]:
        settings, ports = self._settings.motor, self._ports
        if settings.stage == "roboclaw" and settings.roboclaw is not None:
            claw = settings.roboclaw
            line = self._opened(
                "motor.roboclaw", lambda: ports.serial(claw.port, claw.baud, claw.reply_timeout_s)
            )
            controller = RoboClaw(line, claw)
            self._fail_safe.add(lambda: controller.drive(0))
            stage = RoboClawStage(controller)
            return PiMotor("motor", stage, settings), self._encoder(controller)
        assert settings.h_bridge is not None  # checked with the settings
        bridge = settings.h_bridge
        pwm = self._opened("motor.h_bridge.pwm", lambda: PwmChannel(ports.sysfs, bridge.pwm))
        self._fail_safe.add(pwm.off)
        half = self._opened(
            "motor.h_bridge", lambda: HBridgeStage(pwm, ports.pins, bridge.direction_pin, bridge.supply_v)
        )
        spi = self._opened("nut_encoder", lambda: ports.spi(bridge.spi_device, bridge.spi_speed_hz))
        return PiMotor("motor", half, settings), self._encoder(Ls7366r("nut_encoder", spi))

    def _encoder(self, counter: RoboClaw | Ls7366r) -> CountedNutEncoder:
        return CountedNutEncoder("nut_encoder", counter, self._ports.clock, self._settings.motor)

    def _accelerometer(self) -> Accelerometer:
        settings = self._settings.accelerometer
        part = self._part("accelerometer", settings.bus, settings.address)
        kind = Lsm6dso32 if settings.part == "lsm6dso32" else Adxl375
        return kind("accelerometer", part, self._ports.clock, settings)

    def _watchdog(self) -> PiWatchdog:
        settings, ports = self._settings.watchdog, self._ports

        def opened() -> PiWatchdog:
            device = ports.watchdog(settings.device, settings.device_timeout_s)
            return PiWatchdog("watchdog", ports.pins, device, settings)

        return self._opened("watchdog", opened)

    def _part(self, name: str, bus: int, address: int) -> I2cPart:
        if bus not in self._buses:
            self._buses[bus] = self._opened(name, lambda: I2cBus(self._ports.i2c(bus)))
        return I2cPart(self._buses[bus], address, name)

    def _opened(self, key: str, opening: Callable[[], T]) -> T:
        try:
            return opening()
        except DeviceError:
            raise
        except OSError as error:
            raise BoardUnavailable(f"board {self._name!r}: {key}: {error}") from error
