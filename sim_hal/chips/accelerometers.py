"""LSM6DSO32 and ADXL375 by their registers (`hal.raspberry_pi.lsm6dso32` and `adxl375` cite the data sheets).

The leg's axis carries the plant's specific force; the two others read nothing.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Sequence

from sim_hal.chips.rig import Signal

STANDARD_GRAVITY_M_S2 = 9.80665
AXES = ("x", "y", "z")


class _RegisterChip:
    """A part with registers of a byte; the register moves on while a transfer lasts."""

    defaults: dict[int, int]
    read_only: frozenset[int]

    def __init__(self, signal: Signal, axis: str, sign: int) -> None:
        self._signal = signal
        self._axis, self._sign = AXES.index(axis), sign
        self.registers = bytearray(256)
        self._pointer = 0
        self.reset()

    def reset(self) -> None:
        """All registers as at power-up."""
        self.registers[:] = bytes(256)
        for register, value in self.defaults.items():
            self.registers[register] = value

    def write(self, data: bytes) -> None:
        """Register, then values for it and those after it."""
        self._pointer = data[0]
        for value in data[1:]:
            if self._pointer not in self.read_only:
                self._set(self._pointer, value)
            self._pointer = self._next(self._pointer)

    def read(self, count: int) -> bytes:
        """Values of successive registers."""
        data = bytearray()
        for _ in range(count):
            data.append(self._get(self._pointer))
            self._pointer = self._next(self._pointer)
        return bytes(data)

    def _next(self, register: int) -> int:
        return (register + 1) & 0xFF

    def _get(self, register: int) -> int:
        return self.registers[register]

    def _set(self, register: int, value: int) -> None:
        self.registers[register] = value

    def _counts(
        self, value_m_s2: float, digit_g: float, full: int, offsets: Sequence[float]
    ) -> tuple[int, ...]:
        """Counts of all axes; `offsets` [g] are those of the self-test."""
        axes = [0.0, 0.0, 0.0]
        axes[self._axis] = self._sign * value_m_s2 / STANDARD_GRAVITY_M_S2
        shown = [round((axis + offset) / digit_g) for axis, offset in zip(axes, offsets, strict=True)]
        return tuple(max(-full - 1, min(full, count)) for count in shown)


class Lsm6dso32Chip(_RegisterChip):
    """The accelerometer half of an LSM6DSO32."""

    FIFO_CTRL3, FIFO_CTRL4, WHO_AM_I, CTRL1_XL, CTRL3_C, CTRL5_C = 0x09, 0x0A, 0x0F, 0x10, 0x12, 0x14
    STATUS, OUT_X, FIFO_STATUS1, FIFO_STATUS2, FREQ_FINE, TAG, LAST = 0x1E, 0x28, 0x3A, 0x3B, 0x63, 0x78, 0x7E
    RATES_HZ = (12.5, 26.0, 52.0, 104.0, 208.0, 416.0, 833.0, 1666.0, 3332.0, 6664.0)
    DIGITS_G = (0.122e-3, 0.976e-3, 0.244e-3, 0.488e-3)  # by the code of FS_XL
    DEPTH = 512
    SELF_TEST_G = 0.4
    ACCELEROMETER_TAG = 0x02

    defaults = {WHO_AM_I: 0x6C, CTRL3_C: 0x04}  # noqa: RUF012  constants of the part
    read_only = frozenset(
        (WHO_AM_I, STATUS, FIFO_STATUS1, FIFO_STATUS2, FREQ_FINE, *range(0x28, 0x2E), *range(0x78, 0x7F))
    )

    def reset(self) -> None:
        """All registers as at power-up: powered down, FIFO empty."""
        super().reset()
        self._fifo: deque[bytes] = deque(maxlen=self.DEPTH)
        self._word = bytes(7)
        self._overrun = False
        self._tag_count = 0
        self._latest: tuple[int, ...] = (0, 0, 0)
        self._ready = False

    def _next(self, register: int) -> int:
        return self.TAG if register == self.LAST else super()._next(register)

    def _set(self, register: int, value: int) -> None:
        self._sample()  # what was sampled until now was so under the old settings
        if register == self.CTRL3_C and value & 0x01:
            self.reset()
            return
        super()._set(register, value)
        if register == self.CTRL1_XL and self._rate_hz:
            self._signal.set_rate_hz(self._rate_hz)
        if register == self.FIFO_CTRL4 and value & 0x07 == 0:
            self._fifo.clear()
            self._overrun = False

    def _get(self, register: int) -> int:
        if register == self.STATUS:
            self._sample()
            return int(self._ready)
        if self.OUT_X <= register < self.OUT_X + 6:
            self._ready = False
            return struct.pack("<3h", *self._latest)[register - self.OUT_X]
        if register == self.FIFO_STATUS1:
            self._sample()
            return len(self._fifo) & 0xFF
        if register == self.FIFO_STATUS2:
            flags = len(self._fifo) >> 8 | (0x48 if self._overrun else 0)
            self._overrun = False  # FIFO_OVR_LATCHED is reset when this register is read
            return flags
        if self.TAG <= register <= self.LAST:
            if register == self.TAG:
                self._word = self._fifo.popleft() if self._fifo else bytes(7)
            return self._word[register - self.TAG]
        return super()._get(register)

    @property
    def _rate_hz(self) -> float:
        code = self.registers[self.CTRL1_XL] >> 4
        return self.RATES_HZ[code - 1] if 1 <= code <= len(self.RATES_HZ) else 0.0

    def _sample(self) -> None:
        samples = self._signal.take()
        if not self._rate_hz:
            return
        digit_g = self.DIGITS_G[self.registers[self.CTRL1_XL] >> 2 & 0x3]
        tested_g = self.SELF_TEST_G if self.registers[self.CTRL5_C] & 0x3 == 1 else 0.0
        for sample in samples:
            self._latest = self._counts(sample.value, digit_g, 0x7FFF, (tested_g,) * 3)
            self._ready = True
            if self.registers[self.FIFO_CTRL4] & 0x07 == 0x06 and self.registers[self.FIFO_CTRL3] & 0x0F:
                self._store()

    def _store(self) -> None:
        self._overrun = self._overrun or len(self._fifo) == self.DEPTH
        tag = self.ACCELEROMETER_TAG << 3 | self._tag_count << 1
        tag |= bin(tag).count("1") & 1  # even parity
        self._fifo.append(bytes((tag,)) + struct.pack("<3h", *self._latest))
        self._tag_count = (self._tag_count + 1) & 0x3


class Adxl375Chip(_RegisterChip):
    """An ADXL375."""

    DEVID, BW_RATE, POWER_CTL, INT_SOURCE, DATA_FORMAT, DATA, FIFO_CTL, FIFO_STATUS = (
        0x00, 0x2C, 0x2D, 0x30, 0x31, 0x32, 0x38, 0x39,
    )  # fmt: skip
    RATES_HZ = (100.0, 200.0, 400.0, 800.0)
    DIGIT_G = 49e-3
    FULL = 4081  # 200 g
    DEPTH = 32
    SELF_TEST_G = 6.4

    defaults = {DEVID: 0xE5, BW_RATE: 0x0A}  # noqa: RUF012  constants of the part
    read_only = frozenset((DEVID, INT_SOURCE, FIFO_STATUS, *range(0x32, 0x38)))

    def reset(self) -> None:
        """All registers as at power-up: standby, FIFO bypassed."""
        super().reset()
        self._fifo: deque[bytes] = deque(maxlen=self.DEPTH)
        self._entry = bytes(6)
        self._overrun = False

    def _set(self, register: int, value: int) -> None:
        self._sample()
        super()._set(register, value)
        if register in (self.BW_RATE, self.POWER_CTL):
            self._signal.set_rate_hz(self.RATES_HZ[0] * 2.0 ** ((self.registers[self.BW_RATE] & 0x0F) - 0x0A))
        if register == self.FIFO_CTL and value >> 6 == 0:
            self._fifo.clear()
            self._overrun = False

    def _get(self, register: int) -> int:
        self._sample()
        if register == self.INT_SOURCE:
            return 0x80 * bool(self._fifo) | int(self._overrun)
        if register == self.FIFO_STATUS:
            return len(self._fifo)
        if self.DATA <= register < self.DATA + 6:
            if register == self.DATA:
                self._entry = self._fifo.popleft() if self._fifo else self._entry
                self._overrun = False  # cleared by reading data
            return self._entry[register - self.DATA]
        return super()._get(register)

    def _sample(self) -> None:
        samples = self._signal.take()
        if not self.registers[self.POWER_CTL] & 0x08 or self.registers[self.FIFO_CTL] >> 6 != 2:
            return
        tested_g = self.SELF_TEST_G if self.registers[self.DATA_FORMAT] & 0x80 else 0.0
        for sample in samples:
            self._overrun = self._overrun or len(self._fifo) == self.DEPTH
            self._fifo.append(
                struct.pack("<3h", *self._counts(sample.value, self.DIGIT_G, self.FULL, (0.0, 0.0, tested_g)))
            )
