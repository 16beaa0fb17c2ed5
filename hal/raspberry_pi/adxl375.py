"""Accelerometer ADXL375 (Analog Devices, data sheet Rev. B) over I²C: ±200 g, for hard landings.

Registers used: DEVID (00h, reads E5h), BW_RATE (2Ch: rate in bits 3-0), POWER_CTL (2Dh: measure bit 3), INT_SOURCE
(30h: overrun bit 0), DATA_FORMAT (31h: self-test bit 7; bits 3, 1 and 0 must be set), DATAX0 (32h, six bytes),
FIFO_CTL (38h: mode in bits 7-6), FIFO_STATUS (39h: entries in bits 5-0). The FIFO has 32 levels; each entry is a
read of its own, because the next one is moved up after the last byte of an entry (at least 5 µs, which the
start of the next transfer takes).

Rates above 800 Hz are not offered: there the part puts out data with one digit less, of which data sheet
(least bit 0 is zero) and parts in the field (bit 7 is) say different things.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from contextlib import suppress

from hal.devices import Clock
from hal.errors import DeviceError, DeviceReset, ReadFailed, SelfTestFailed, WrongDevice
from hal.raspberry_pi.fifo_accelerometer import STANDARD_GRAVITY_M_S2, FifoAccelerometer
from hal.raspberry_pi.settings import AccelerometerSettings
from hal.raspberry_pi.wire import I2cPart

DEVID, BW_RATE, POWER_CTL, INT_SOURCE, DATA_FORMAT, DATAX0, FIFO_CTL, FIFO_STATUS = (
    0x00, 0x2C, 0x2D, 0x30, 0x31, 0x32, 0x38, 0x39,
)  # fmt: skip
IDENTITY = 0xE5
MEASURE = 0x08
FORMAT, FORMAT_SELF_TEST = 0x0B, 0x8B
FIFO_BYPASS, FIFO_STREAM = 0x00, 0x80
OVERRUN = 0x01
ENTRIES = 0x3F
RANGE_G = 200
DIGIT_G = 49e-3
FULL_SCALE = round(RANGE_G / DIGIT_G)
RATES = {100.0: 0xA, 200.0: 0xB, 400.0: 0xC, 800.0: 0xD}

SELF_TEST_RATE_HZ, SELF_TEST_SETTLE_S, SELF_TEST_SAMPLES_S = 800.0, 0.01, 0.03
SELF_TEST_G = 6.4
"""Typical output change of the z axis (table 1); less than half of it is taken as broken."""


class Adxl375(FifoAccelerometer):
    """The accelerometer, streaming into its FIFO of 32 levels."""

    _clock_tolerance = 0.05
    _rates = {rate: (code, 1.0 / rate) for rate, code in RATES.items()}  # noqa: RUF012  constant of the part

    def __init__(self, name: str, part: I2cPart, clock: Clock, settings: AccelerometerSettings) -> None:
        """Set up the part. Raises `WrongDevice`, `SelfTestFailed` or `DeviceError`."""
        if settings.range_g != RANGE_G:
            raise DeviceError(f"{name}: range {settings.range_g} g is not the part's {RANGE_G} g")
        super().__init__(name, clock, settings, DIGIT_G * STANDARD_GRAVITY_M_S2)
        self._full_scale = FULL_SCALE
        self._part = part
        self._expected = b""
        found = part.read(DEVID, 1)[0]
        if found != IDENTITY:
            raise WrongDevice(f"{name}: DEVID reads {found:#04x}, an ADXL375 says {IDENTITY:#04x}")
        part.set(POWER_CTL, 0)
        part.set(DATA_FORMAT, FORMAT)
        if settings.self_test:
            self._test_itself()
        self.set_rate_hz(settings.rate_hz)

    def _start(self, rate_code: int) -> None:
        self._part.set(POWER_CTL, 0)
        self._part.set(FIFO_CTL, FIFO_BYPASS)
        self._part.set(BW_RATE, rate_code)
        self._part.set(FIFO_CTL, FIFO_STREAM)
        self._part.set(POWER_CTL, MEASURE)
        self._expected = bytes((rate_code, MEASURE))

    def _make_safe(self) -> None:
        with suppress(ReadFailed):  # a part that is gone samples no more
            self._part.write(POWER_CTL, 0)

    def _drain(self) -> tuple[Sequence[tuple[int, int, int]], bool]:
        block = self._part.read(BW_RATE, INT_SOURCE - BW_RATE + 1)
        if block[:2] != self._expected:
            raise DeviceReset(f"{self._name}: rate or measurement mode are not those that were set")
        overrun = bool(block[-1] & OVERRUN)
        entries = self._part.read(FIFO_STATUS, 1)[0] & ENTRIES
        return [struct.unpack("<3h", self._part.read(DATAX0, 6)) for _ in range(entries)], overrun

    def _test_itself(self) -> None:
        means = []
        for data_format in (FORMAT, FORMAT_SELF_TEST):
            self._part.set(DATA_FORMAT, data_format)
            self._start(RATES[SELF_TEST_RATE_HZ])
            self._clock.sleep_until_s(self._clock.now_s() + SELF_TEST_SETTLE_S)
            self._drain()
            self._clock.sleep_until_s(self._clock.now_s() + SELF_TEST_SAMPLES_S)
            counts, _ = self._drain()
            means.append(sum(count[2] for count in counts) / max(1, len(counts)))
        self._part.set(DATA_FORMAT, FORMAT)
        moved_g = (means[1] - means[0]) * DIGIT_G
        if moved_g < 0.5 * SELF_TEST_G:
            raise SelfTestFailed(
                f"{self._name}: self-test moves axis z by {moved_g:.2f} g, about {SELF_TEST_G} g are due"
            )
