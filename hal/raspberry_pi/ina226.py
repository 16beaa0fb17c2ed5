"""Current sensor INA226 (Texas Instruments, data sheet SBOS547) over I²C.

Registers used: configuration (00h: reset bit 15, averages bits 11-9, shunt conversion time bits 5-3, mode bits
2-0), current (04h), calibration (05h), mask/enable (06h: conversion-ready flag CVRF bit 3, cleared by reading;
overflow OVF bit 2), manufacturer (FEh, reads 5449h) and die (FFh, reads 2260h).
Equation 1 there: calibration = 0.00512 / (current_LSB shunt).
"""

from __future__ import annotations

from hal.devices import Clock
from hal.errors import (
    CommandRefused,
    ConfigError,
    DeviceReset,
    ReadFailed,
    ReadTimeout,
    WrongDevice,
)
from hal.raspberry_pi.device import PiDevice
from hal.raspberry_pi.polled_stream import PolledStream
from hal.raspberry_pi.ports import Sampler
from hal.raspberry_pi.settings import CurrentSettings
from hal.raspberry_pi.wire import I2cPart, signed
from hal.readings import MagnetCurrent, MotorCurrent

CONFIGURATION, CURRENT, CALIBRATION, MASK_ENABLE, MANUFACTURER, DIE = 0x00, 0x04, 0x05, 0x06, 0xFE, 0xFF
IDENTITY = (0x5449, 0x2260)
RESET = 0x8000
FIXED_BITS = 0x4000  # bit 14 reads as one
CONTINUOUS_SHUNT = 0b101
CONVERSION_READY, OVERFLOW = 0x0008, 0x0004
CALIBRATION_SCALE = 0.00512
DIGITS = 32768

CONVERSIONS = {200.0: (0b001, 0b100), 1666.0: (0b000, 0b010)}
"""Codes of averages and conversion time by rate [Hz]: 4 of 1.1 ms, and one of 332 µs (tables 6 and 8).

Both end within the period even by the slowest part (110 %)."""


class Ina226:
    """The part, set up to measure one current continuously."""

    def __init__(self, name: str, part: I2cPart, settings: CurrentSettings) -> None:
        """Reset and calibrate. Raises `WrongDevice`, `ConfigError` or `DeviceError`."""
        self._name, self._part = name, part
        self._step_a = settings.max_current_a / DIGITS
        self._sign = settings.sign
        self._calibration = round(CALIBRATION_SCALE / (self._step_a * settings.shunt_ohm))
        if not 1 <= self._calibration < DIGITS:
            raise ConfigError(
                f"{name}: shunt_ohm = {settings.shunt_ohm:g} with max_current_a = {settings.max_current_a:g} "
                f"gives calibration {self._calibration}, outside [1, {DIGITS - 1}]"
            )
        found = (part.read_word(MANUFACTURER), part.read_word(DIE))
        if found != IDENTITY:
            raise WrongDevice(
                f"{name}: identity reads {found[0]:#06x} {found[1]:#06x}, an INA226 says 0x5449 0x2260"
            )
        part.write_word(CONFIGURATION, RESET)
        self._configuration = 0

    def set_rate_hz(self, rate_hz: float) -> None:
        """Convert fast enough for this rate. Raises `CommandRefused` for a rate that is not offered."""
        if rate_hz not in CONVERSIONS:
            known = ", ".join(f"{rate:g}" for rate in CONVERSIONS)
            raise CommandRefused(f"{self._name}: rate {rate_hz!r} Hz is not one of the part's rates: {known}")
        averages, time = CONVERSIONS[rate_hz]
        self._configuration = FIXED_BITS | averages << 9 | time << 3 | CONTINUOUS_SHUNT
        self._part.set_word(CONFIGURATION, self._configuration)
        self._part.set_word(CALIBRATION, self._calibration)

    def conversion_ready(self) -> bool:
        """Whether a conversion ended since the last call. Raises `ReadFailed` on an overflow."""
        flags = self._part.read_word(MASK_ENABLE)
        if flags & OVERFLOW:
            raise ReadFailed(f"{self._name}: the current is beyond what its register holds")
        return bool(flags & CONVERSION_READY)

    def current_a(self) -> float:
        """The newest conversion."""
        return self._sign * signed(self._part.read_word(CURRENT)) * self._step_a

    def verify(self) -> None:
        """Raise `DeviceReset` when the settings are lost: without calibration the part reads 0 A for ever."""
        found = (self._part.read_word(CONFIGURATION), self._part.read_word(CALIBRATION))
        if found != (self._configuration, self._calibration):
            raise DeviceReset(
                f"{self._name}: configuration {found[0]:#06x} and calibration {found[1]} are not those that were set"
            )


class Ina226MotorCurrent(PiDevice):
    """The motor's current, asked for once a tick."""

    def __init__(self, name: str, part: Ina226, clock: Clock, settings: CurrentSettings) -> None:
        super().__init__(name)
        self._part, self._clock = part, clock
        self._timeout_s = settings.timeout_s
        part.set_rate_hz(settings.rate_hz)
        self._newest: MotorCurrent | None = None
        self._opened_s = clock.now_s()

    def read(self) -> MotorCurrent:
        """The newest conversion; one that was delivered before keeps its time.

        Raises `ReadTimeout` when none ended for `timeout_s`, `DeviceReset` when the part lost its settings.
        """
        self._require_open()
        ready = self._part.conversion_ready()
        current_a = self._part.current_a()
        self._part.verify()
        now_s = self._clock.now_s()
        if ready:
            self._newest = MotorCurrent(now_s, current_a)
        since_s = self._newest.time_s if self._newest else self._opened_s
        if self._newest is None or now_s - since_s > self._timeout_s:
            raise ReadTimeout(f"{self._name}: no conversion since {since_s:.4f} s")
        return self._newest


class Ina226MagnetCurrent(PiDevice):
    """The magnet's current, sampled into a stream by a task; a sample is at most one conversion old."""

    def __init__(self, name: str, part: Ina226, sampler: Sampler, settings: CurrentSettings) -> None:
        super().__init__(name)
        self._part = part
        self._stream = PolledStream(sampler, settings.depth, lambda now_s: (now_s, part.current_a()))
        self.set_rate_hz(settings.rate_hz)

    def set_rate_hz(self, rate_hz: float) -> None:
        """Sample at this rate from now on. Raises `CommandRefused` for a rate that is not offered."""
        self._require_open()
        self._part.set_rate_hz(rate_hz)
        self._stream.start(rate_hz)

    def read(self) -> MagnetCurrent:
        """All samples since the last read; may be empty. Raises `DeviceReset` when settings were lost meanwhile."""
        self._require_open()
        batch = self._stream.drain()
        try:
            self._part.verify()
        except ReadFailed:
            self._stream.lose()
            raise
        return MagnetCurrent(*batch)

    def newest_a(self) -> float | None:
        """The newest sample, whether read or not; None before the first."""
        return self._stream.newest()

    def _make_safe(self) -> None:
        self._stream.stop()
