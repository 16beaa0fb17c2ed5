"""Accelerometer LSM6DSO32 (ST, data sheet DS13105) over I²C.

Registers used, by section 9 of the data sheet: FIFO_CTRL1-4 (07h-0Ah), WHO_AM_I (0Fh, reads 6Ch), CTRL1_XL
(10h: ODR_XL in bits 7-4, FS_XL in bits 3-2), CTRL3_C (12h: BDU bit 6, IF_INC bit 2, SW_RESET bit 0), CTRL5_C
(14h: ST_XL in bits 1-0), STATUS_REG (1Eh: XLDA bit 0), OUTX_L_A (28h), FIFO_STATUS1-2 (3Ah-3Bh: number of words
in ten bits, FIFO_OVR_LATCHED bit 3), INTERNAL_FREQ_FINE (63h: 0.15 % per digit), FIFO_DATA_OUT_TAG (78h: TAG_SENSOR
in bits 7-3, TAG_CNT in bits 2-1), followed by six bytes of data; reading on from 7Eh goes back to 78h.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from contextlib import suppress

from hal.devices import Clock
from hal.errors import (
    BadChecksum,
    DeviceError,
    DeviceReset,
    ReadFailed,
    ReadTimeout,
    SelfTestFailed,
    WrongDevice,
)
from hal.raspberry_pi.fifo_accelerometer import STANDARD_GRAVITY_M_S2, FifoAccelerometer
from hal.raspberry_pi.settings import AccelerometerSettings
from hal.raspberry_pi.wire import I2cPart, signed

FIFO_CTRL3, FIFO_CTRL4, WHO_AM_I, CTRL1_XL, CTRL3_C, CTRL5_C = 0x09, 0x0A, 0x0F, 0x10, 0x12, 0x14
STATUS_REG, OUTX_L_A, FIFO_STATUS1, INTERNAL_FREQ_FINE, FIFO_DATA_OUT_TAG = 0x1E, 0x28, 0x3A, 0x63, 0x78
IDENTITY = 0x6C
BDU_AND_IF_INC, SW_RESET = 0x44, 0x01
FIFO_BYPASS, FIFO_CONTINUOUS = 0x00, 0x06
DATA_READY = 0x01
OVERRUN_LATCHED = 0x08
TAG_ACCELEROMETER = 0x02
WORD_BYTES = 7

FULL_SCALES = {4: (0b00, 0.122e-3), 8: (0b10, 0.244e-3), 16: (0b11, 0.488e-3), 32: (0b01, 0.976e-3)}
"""FS_XL code and sensitivity [g per digit] by range [g] (tables 3 and 49)."""

RATE_NAMES = (12.5, 26.0, 52.0, 104.0, 208.0, 416.0, 833.0, 1666.0, 3332.0, 6664.0)
HIGHEST_RATE_HZ = 6667.0
"""Of code 10; each lower code halves it (section 9.54: ODR_actual = 6667 (1 + 0.0015 FREQ_FINE) / ODR_coeff)."""

SELF_TEST_CODE_52_HZ, SELF_TEST_SETTLE_S, SELF_TEST_SAMPLES = 0x3, 0.1, 5
SELF_TEST_RANGE_G, SELF_TEST_LIMITS_G = 4, (0.050, 1.700)
"""Table 3: output change by the linear acceleration self-test; procedure of application note AN5473, section 8."""


class Lsm6dso32(FifoAccelerometer):
    """The accelerometer, sampling into its FIFO of 512 words."""

    _clock_tolerance = 0.05

    def __init__(self, name: str, part: I2cPart, clock: Clock, settings: AccelerometerSettings) -> None:
        """Reset and set up the part. Raises `WrongDevice`, `SelfTestFailed` or `DeviceError`."""
        if settings.range_g not in FULL_SCALES:
            raise DeviceError(
                f"{name}: range {settings.range_g} g is none of {', '.join(map(str, FULL_SCALES))}"
            )
        self._full_scale_code, digit_g = FULL_SCALES[settings.range_g]
        super().__init__(name, clock, settings, digit_g * STANDARD_GRAVITY_M_S2)
        self._part = part
        self._tag_count: int | None = None
        self._expected = b""
        found = part.read(WHO_AM_I, 1)[0]
        if found != IDENTITY:
            raise WrongDevice(f"{name}: WHO_AM_I reads {found:#04x}, an LSM6DSO32 says {IDENTITY:#04x}")
        self._reset()
        if settings.self_test:
            self._test_itself()
        fine = struct.unpack("b", part.read(INTERNAL_FREQ_FINE, 1))[0]
        highest_hz = HIGHEST_RATE_HZ * (1.0 + 0.0015 * fine)
        self._rates = {
            rate: (code, 2.0 ** (10 - code) / highest_hz) for code, rate in enumerate(RATE_NAMES, start=1)
        }
        self.set_rate_hz(settings.rate_hz)

    def _reset(self) -> None:
        self._part.write(CTRL3_C, SW_RESET)
        self._clock.sleep_until_s(self._clock.now_s() + 1e-3)  # 50 µs by the data sheet
        if self._part.read(CTRL3_C, 1)[0] & SW_RESET:
            raise ReadTimeout(f"{self._name}: the reset does not end")
        self._part.set(CTRL3_C, BDU_AND_IF_INC)

    def _start(self, rate_code: int) -> None:
        self._part.set(FIFO_CTRL4, FIFO_BYPASS)
        self._part.set(CTRL1_XL, rate_code << 4 | self._full_scale_code << 2)
        self._part.set(FIFO_CTRL3, rate_code)
        self._part.set(FIFO_CTRL4, FIFO_CONTINUOUS)
        self._tag_count = None
        self._expected = self._part.read(FIFO_CTRL4, 1) + bytes((IDENTITY,)) + self._part.read(CTRL1_XL, 1)

    def _make_safe(self) -> None:
        with suppress(ReadFailed):  # a part that is gone samples no more
            self._part.write(CTRL1_XL, 0)

    def _drain(self) -> tuple[Sequence[tuple[int, int, int]], bool]:
        low, high = self._part.read(FIFO_STATUS1, 2)
        # one block shows FIFO mode (0Ah), identity (0Fh) and rate (10h): a part that was reset has lost them
        block = self._part.read(FIFO_CTRL4, CTRL1_XL - FIFO_CTRL4 + 1)
        if bytes((block[0], block[-2], block[-1])) != self._expected:
            raise DeviceReset(f"{self._name}: FIFO mode, identity or rate are not those that were set")
        count, overrun = (high & 0x03) << 8 | low, bool(high & OVERRUN_LATCHED)
        if count == 0:
            return (), overrun
        data = self._part.read_long(FIFO_DATA_OUT_TAG, count * WORD_BYTES, WORD_BYTES)
        words = list(struct.iter_unpack("<B3h", data))
        missing = self._check_tags([word[0] for word in words])
        return [word[1:] for word in words], overrun or missing

    def _check_tags(self, tags: list[int]) -> bool:
        """Whether words are missing before these; raises `BadChecksum` when one is missing among them."""
        expected = self._tag_count
        missing = False
        for index, tag in enumerate(tags):
            counter = tag >> 1 & 0x3
            if tag >> 3 != TAG_ACCELEROMETER:
                self._tag_count = None
                raise BadChecksum(
                    f"{self._name}: FIFO word {index} has tag {tag >> 3:#04x}, not the accelerometer's"
                )
            if expected is not None and counter != expected:
                if index > 0:
                    self._tag_count = None
                    raise BadChecksum(f"{self._name}: FIFO word {index} does not follow the one before")
                missing = True
            expected = (counter + 1) & 0x3
        self._tag_count = expected
        return missing

    def _test_itself(self) -> None:
        code, digit_g = FULL_SCALES[SELF_TEST_RANGE_G]
        self._part.set(CTRL1_XL, SELF_TEST_CODE_52_HZ << 4 | code << 2)
        means = []
        for stimulus in (0, 1):
            self._part.set(CTRL5_C, stimulus)
            self._clock.sleep_until_s(self._clock.now_s() + SELF_TEST_SETTLE_S)
            means.append(self._mean_counts())
        self._part.set(CTRL5_C, 0)
        low, high = SELF_TEST_LIMITS_G
        for axis, before, after in zip("xyz", *means, strict=True):
            moved_g = abs(after - before) * digit_g
            if not low <= moved_g <= high:
                raise SelfTestFailed(
                    f"{self._name}: self-test moves axis {axis} by {moved_g * 1e3:.0f} mg, "
                    f"allowed are {low * 1e3:.0f} to {high * 1e3:.0f} mg"
                )

    def _mean_counts(self) -> tuple[float, ...]:
        samples = []
        for _ in range(SELF_TEST_SAMPLES):
            self._clock.sleep_until_s(self._clock.now_s() + 0.021)  # a period of 52 Hz and a little
            if not self._part.read(STATUS_REG, 1)[0] & DATA_READY:
                raise ReadTimeout(f"{self._name}: no data ready within a period")
            data = self._part.read(OUTX_L_A, 6)
            samples.append([signed(low | high << 8) for low, high in zip(data[::2], data[1::2], strict=True)])
        return tuple(sum(axis) / len(samples) for axis in zip(*samples, strict=True))
