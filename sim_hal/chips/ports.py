"""The kernel's interfaces with chip models behind them: what `hal.raspberry_pi` is opened on in a simulation."""

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path

from hal.raspberry_pi.ports import SmBus
from hal.raspberry_pi.settings import PiSettings
from sim_hal.chips.accelerometers import Adxl375Chip, Lsm6dso32Chip
from sim_hal.chips.bridge import Ls7366rChip, MockPins, PwmTree
from sim_hal.chips.converters import Ads1x15Chip, Ina226Chip
from sim_hal.chips.faults import I2C_BLOCKS, I2C_WORDS, SERIAL, WireFaults
from sim_hal.chips.i2c import Chip, EmulatedBus
from sim_hal.chips.rig import ChipRig, RigClock, RigSampler
from sim_hal.chips.roboclaw import PLACE, RoboClawChip, ServedLine
from sim_hal.chips.supervisor import EmulatedWatchdog, Supervisor

PLACES = {
    "accelerometer": I2C_BLOCKS,
    "motor_current": I2C_WORDS,
    "magnet_current": I2C_WORDS,
    "spring": I2C_WORDS,
    PLACE: SERIAL,
}
"""Where faults of the wire can be planted, and which."""


class EmulatedPorts:
    """All chips of one robot. `folder` (which is deleted at the end) holds the PWM files."""

    def __init__(
        self, rig: ChipRig, wiring: PiSettings, faults: WireFaults, folder: Path, supply_v: float
    ) -> None:
        self.rig, self.faults = rig, faults
        self.clock, self.sampler = RigClock(rig), RigSampler(rig)
        self._wiring, self._folder, self._supply_v = wiring, folder, supply_v
        self.pins = MockPins()
        self.sysfs = PwmTree(folder, wiring.magnet.pwm.chip, channels=4)
        self.i2c_chips = self._make_i2c_chips()
        self.watchdogs: list[EmulatedWatchdog] = []
        self._lines: list[ServedLine] = []
        self._backward = False
        motor, nut = wiring.motor, rig.signals["nut_encoder"]
        self.controller = RoboClawChip(
            rig, faults, nut, rig.signals["motor_current"].newest,
            motor.roboclaw.address if motor.roboclaw else 0x80, supply_v, motor.m_per_count, motor.sign,
        )  # fmt: skip
        self.counter = Ls7366rChip(nut, lambda: self._fails("nut_encoder"), motor.m_per_count, motor.sign)
        rig.guards.append(self.controller)
        self._connect()

    def i2c(self, bus: int) -> SmBus:
        """The chips of one bus."""
        chips = [
            (getattr(self._wiring, name).address, name, chip)
            for name, chip in self.i2c_chips.items()
            if getattr(self._wiring, name).bus == bus
        ]
        return EmulatedBus(chips, self.faults, self._fails, lambda: self.rig.now_s)

    def serial(self, port: str, baud: int, timeout_s: float) -> ServedLine:
        """The line to the motor controller."""
        line = self.controller.open_line(baud, timeout_s)
        self._lines.append(line)
        return line

    def spi(self, device: str, speed_hz: int) -> Ls7366rChip:
        """The quadrature counter."""
        return self.counter

    def watchdog(self, device: str, timeout_s: int) -> EmulatedWatchdog:
        """The computer's watchdog."""
        self.watchdogs.append(EmulatedWatchdog(self.rig, timeout_s))
        return self.watchdogs[-1]

    def close(self) -> None:
        """Close lines and remove files. May be called again."""
        while self._lines:
            self._lines.pop().close()
        self.controller.close()
        shutil.rmtree(self._folder, ignore_errors=True)

    def _make_i2c_chips(self) -> dict[str, Chip]:
        wiring, signals = self._wiring, self.rig.signals
        accelerometer, spring = wiring.accelerometer, wiring.spring
        kind = Lsm6dso32Chip if accelerometer.part == "lsm6dso32" else Adxl375Chip
        return {
            "accelerometer": kind(signals["accelerometer"], accelerometer.axis, accelerometer.sign),
            "motor_current": Ina226Chip(
                signals["motor_current"], wiring.motor_current.shunt_ohm, wiring.motor_current.sign
            ),
            "magnet_current": Ina226Chip(
                signals["magnet_current"], wiring.magnet_current.shunt_ohm, wiring.magnet_current.sign
            ),
            "spring": Ads1x15Chip(signals["spring"], spring.part, spring.zero_v, spring.m_per_v),
        }

    def _connect(self) -> None:
        wiring, world = self._wiring, self.rig.world
        self.sysfs.listen(wiring.magnet.pwm.channel, self._magnet)
        switches = wiring.switches
        self.pins.connect_input(switches.home_pin, lambda: not world.at_home)
        self.pins.connect_input(switches.latch_pin, lambda: not world.latch_closed)
        self.pins.broken = lambda pin: (
            pin in (switches.home_pin, switches.latch_pin) and self._fails("switches")
        )
        supervisor = Supervisor(self.rig, wiring.watchdog.timeout_s)
        self.rig.guards.append(supervisor)
        self.pins.connect_output(wiring.watchdog.heartbeat_pin, supervisor.heartbeat)
        self.pins.connect_output(wiring.watchdog.arm_pin, supervisor.arm)
        bridge = wiring.motor.h_bridge
        if wiring.motor.stage == "h_bridge" and bridge is not None:
            self.sysfs.listen(bridge.pwm.channel, self._motor)
            self.pins.connect_output(bridge.direction_pin, self._direct)

    def _magnet(self, duty: float) -> None:
        """The plant knows the coil with its supply or without; any duty counts as with."""
        if self._fails("magnet"):
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        self.rig.command_magnet(duty > 0.0)

    def _motor(self, duty: float) -> None:
        if self._fails("motor"):
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        sign = -self._wiring.motor.sign if self._backward else self._wiring.motor.sign
        self.rig.command_voltage_v(sign * duty * self._supply_v)

    def _direct(self, backward: bool) -> None:
        self._backward = backward

    def _fails(self, device: str) -> bool:
        return self.rig.faults.active(device, self.rig.now_s) == "fail"
