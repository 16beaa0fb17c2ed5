"""Spring-compression sensor on an ADS1015 or ADS1115 (Texas Instruments, SBAS473 and SBAS444) over I²C.

Registers used: conversion (00h), configuration (01h: start OS bit 15, inputs MUX bits 14-12, range PGA bits 11-9,
single shot bit 8, data rate bits 7-5, comparator off bits 1-0) and low threshold (02h). Each task of the sampler
fetches the conversion that the last one started, whose instant is therefore known, and starts the next.

Each start writes the whole configuration, so a brown-out would cost one false sample and leave no trace; the
low threshold, which nothing else uses, carries a mark that is lost with it.
"""

from __future__ import annotations

from hal.errors import CommandRefused, ConfigError, DeviceReset, ReadFailed
from hal.raspberry_pi.device import PiDevice
from hal.raspberry_pi.polled_stream import PolledStream
from hal.raspberry_pi.ports import Sampler
from hal.raspberry_pi.settings import SpringSettings
from hal.raspberry_pi.wire import I2cPart, signed
from hal.readings import SpringCompression

CONVERSION, CONFIGURATION, LOW_THRESHOLD = 0x00, 0x01, 0x02
START, SINGLE_SHOT, COMPARATOR_OFF = 0x8000, 0x0100, 0x0003
DIFFERENTIAL_0_1 = 0b000
MARK = 0x1230
"""The ADS1015 keeps the upper twelve bits of a threshold."""

RANGES_V = {6.144: 0b000, 4.096: 0b001, 2.048: 0b010, 1.024: 0b011, 0.512: 0b100, 0.256: 0b101}
DATA_RATES_HZ = {
    "ads1015": (128, 250, 490, 920, 1600, 2400, 3300),
    "ads1115": (8, 16, 32, 64, 128, 250, 475, 860),
}
"""By code of the data rate."""

OSCILLATOR = 0.9
"""The slowest part converts at this share of its nominal rate."""

STEP_SHARE = 1.0 / 32768
"""A digit of the conversion register, in full scales; the ADS1015 leaves its four lowest bits zero."""


class Ads1x15Spring(PiDevice):
    """The spring sensor, sampled into a stream by a task."""

    def __init__(self, name: str, part: I2cPart, sampler: Sampler, settings: SpringSettings) -> None:
        """Set up the part. Raises `ConfigError`, or `DeviceError` when it does not take its settings."""
        super().__init__(name)
        if settings.full_scale_v not in RANGES_V:
            known = ", ".join(f"{volt:g}" for volt in RANGES_V)
            raise ConfigError(
                f"{name}: full_scale_v = {settings.full_scale_v:g} is none of the part's: {known}"
            )
        self._part, self._settings = part, settings
        self._step_v = settings.full_scale_v * STEP_SHARE
        self._configuration = 0
        self._started_s: float | None = None
        self._stream = PolledStream(sampler, settings.depth, self._take)
        part.set_word(LOW_THRESHOLD, MARK)
        self.set_rate_hz(settings.rates_hz[0])

    def set_rate_hz(self, rate_hz: float) -> None:
        """Sample at this rate from now on, each as slowly as the rate allows, for least noise.

        Raises `CommandRefused` for a rate that the settings do not name or the part cannot reach.
        """
        self._require_open()
        speeds = DATA_RATES_HZ[self._settings.part]
        codes = [code for code, speed in enumerate(speeds) if speed * OSCILLATOR > rate_hz]
        if rate_hz not in self._settings.rates_hz or not codes:
            known = ", ".join(f"{rate:g}" for rate in self._settings.rates_hz)
            raise CommandRefused(
                f"{self._name}: rate {rate_hz!r} Hz is none of {known}, or beyond the {speeds[-1]} Hz of the part"
            )
        self._configuration = (
            DIFFERENTIAL_0_1 << 12
            | RANGES_V[self._settings.full_scale_v] << 9
            | SINGLE_SHOT
            | codes[0] << 5
            | COMPARATOR_OFF
        )
        self._stream.stop()
        self._started_s = None
        self._stream.start(rate_hz)

    def read(self) -> SpringCompression:
        """All samples since the last read; may be empty. Raises `DeviceReset` when settings were lost meanwhile."""
        self._require_open()
        batch = self._stream.drain()
        try:
            self._verify()
        except ReadFailed:
            self._stream.lose()
            raise
        return SpringCompression(*batch)

    def _verify(self) -> None:
        if self._part.read_word(LOW_THRESHOLD) != MARK:
            self._part.write_word(LOW_THRESHOLD, MARK)  # the next read shows whether it took it
            raise DeviceReset(f"{self._name}: the converter has lost its settings")

    def _take(self, now_s: float) -> tuple[float, float] | None:
        sample = None
        if self._started_s is not None:
            volt = signed(self._part.read_word(CONVERSION)) * self._step_v
            sample = (self._started_s, (volt - self._settings.zero_v) * self._settings.m_per_v)
        self._started_s = None  # so that a start that fails is not taken for one
        self._part.write_word(CONFIGURATION, START | self._configuration)
        self._started_s = now_s
        return sample

    def _make_safe(self) -> None:
        self._stream.stop()
