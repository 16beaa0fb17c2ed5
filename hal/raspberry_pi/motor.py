"""The tensioning motor and its encoder, behind a RoboClaw or an H-bridge with a quadrature counter."""

from __future__ import annotations

import math
from typing import Protocol

from hal.devices import Clock
from hal.errors import CommandRefused, DeviceError, ReadFailed
from hal.raspberry_pi.device import PiDevice
from hal.raspberry_pi.ports import Pins
from hal.raspberry_pi.pwm import PwmChannel
from hal.raspberry_pi.roboclaw import FULL_DUTY, RoboClaw
from hal.raspberry_pi.settings import MotorStageSettings
from hal.raspberry_pi.wire import commanded
from hal.readings import NutPosition

SUPPLY_CHECK_COMMANDS = 200
"""The supply is measured again after so many commands (a second of flight)."""


class Stage(Protocol):
    """What drives the motor. Both calls raise `DeviceError` or `OSError` when it does not obey."""

    def drive(self, share: float) -> None:
        """Apply this share (-1 to 1) of the supply."""

    def supply_v(self) -> float:
        """The supply."""


class RoboClawStage:
    """Motor channel 1 of a controller."""

    def __init__(self, controller: RoboClaw) -> None:
        self._controller = controller

    def drive(self, share: float) -> None:
        """Apply this share (-1 to 1) of the supply, in steps of 1/32767."""
        self._controller.drive(round(share * FULL_DUTY))

    def supply_v(self) -> float:
        """The supply, as the controller measures it."""
        return self._controller.battery_v()


class HBridgeStage:
    """A bridge with one PWM and one direction input, low for forward."""

    def __init__(self, pwm: PwmChannel, pins: Pins, direction_pin: int, supply_v: float) -> None:
        self._pwm, self._pins, self._pin = pwm, pins, direction_pin
        self._supply_v = supply_v
        self._backward = False
        pins.claim_output(direction_pin, False)

    def drive(self, share: float) -> None:
        """Apply this share (-1 to 1) of the supply; direction changes at zero duty only."""
        backward = share < 0.0
        if backward != self._backward:
            self._pwm.off()
            self._pins.write(self._pin, backward)
            self._backward = backward
        if share == 0.0:
            self._pwm.off()
        else:
            self._pwm.set_duty(abs(share))

    def supply_v(self) -> float:
        """The supply that the settings state; this stage does not measure it."""
        return self._supply_v


class PiMotor(PiDevice):
    """The motor, commanded by voltage: a share of the supply that was measured last."""

    def __init__(self, name: str, stage: Stage, settings: MotorStageSettings) -> None:
        """Stop the motor. Raises `DeviceError` when the supply is not what the settings allow."""
        super().__init__(name)
        self._stage, self._settings = stage, settings
        self._commands = 0
        commanded(name, lambda: stage.drive(0.0))
        self._supply_v = self._measured_v()

    @property
    def max_voltage_v(self) -> float:
        """Largest magnitude of voltage that can be commanded: the settings', or the supply when that is less."""
        return min(self._settings.max_voltage_v, self._supply_v)

    def set_voltage_v(self, voltage_v: float) -> None:
        """Apply the voltage until the next command; positive tensions."""
        self._require_open()
        if not (math.isfinite(voltage_v) and abs(voltage_v) <= self.max_voltage_v):
            raise CommandRefused(f"{self._name}: {voltage_v!r} V is outside ±{self.max_voltage_v:g} V")
        share = self._settings.sign * voltage_v / self._supply_v
        commanded(self._name, lambda: self._stage.drive(share))
        self._commands += 1
        if self._commands % SUPPLY_CHECK_COMMANDS == 0:
            self._supply_v = self._measured_v()

    def _measured_v(self) -> float:
        supply_v = commanded(self._name, self._stage.supply_v)
        low_v, high_v = self._settings.supply_min_v, self._settings.supply_max_v
        if not low_v <= supply_v <= high_v:
            raise DeviceError(
                f"{self._name}: its supply is {supply_v:.1f} V, allowed are {low_v:g} to {high_v:g} V"
            )
        return supply_v

    def _make_safe(self) -> None:
        commanded(self._name, lambda: self._stage.drive(0.0))


class Counter(Protocol):
    """What counts the encoder's edges."""

    def encoder_count(self) -> int:
        """The count. Raises a `ReadFailed` that names the fault."""


class CountedNutEncoder(PiDevice):
    """Nut travel by counting the encoder, from its position at power-up."""

    def __init__(self, name: str, counter: Counter, clock: Clock, settings: MotorStageSettings) -> None:
        super().__init__(name)
        self._counter, self._clock = counter, clock
        self._m_per_count = settings.sign * settings.m_per_count
        self._zero = counter.encoder_count()

    def read(self) -> NutPosition:
        """The latest position. Raises `DeviceReset` when the count was lost, else a `ReadFailed`."""
        self._require_open()
        try:
            count = self._counter.encoder_count()
        except ReadFailed as error:
            raise type(error)(f"{self._name}: {error}") from error
        return NutPosition(self._clock.now_s(), (count - self._zero) * self._m_per_count)
