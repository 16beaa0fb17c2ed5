"""INA226, ADS1015 and ADS1115 by their registers (`hal.raspberry_pi.ina226` and `ads1x15` cite the data sheets)."""

from __future__ import annotations

from sim_hal.chips.rig import Signal


class _WordChip:
    """A part with registers of 16 bits, high byte first."""

    defaults: dict[int, int]
    writable: frozenset[int]

    def __init__(self, signal: Signal) -> None:
        self._signal = signal
        self.registers: dict[int, int] = {}
        self._pointer = 0
        self.reset()

    def reset(self) -> None:
        """All registers as at power-up."""
        self.registers = dict(self.defaults)

    def write(self, data: bytes) -> None:
        """Register, then its value where one is given."""
        self._pointer = data[0]
        if len(data) == 3 and self._pointer in self.writable:
            self._set(self._pointer, int.from_bytes(data[1:], "big"))

    def read(self, count: int) -> bytes:
        """The register, again and again."""
        return b"".join(self._get(self._pointer).to_bytes(2, "big") for _ in range((count + 1) // 2))[:count]

    def _get(self, register: int) -> int:
        return self.registers.get(register, 0xFFFF)

    def _set(self, register: int, value: int) -> None:
        self.registers[register] = value


def _word(value: float) -> int:
    """The nearest of the values that 16 bits can hold, as two's complement."""
    return max(-0x8000, min(0x7FFF, round(value))) & 0xFFFF


class Ina226Chip(_WordChip):
    """A current sensor with its shunt.

    A conversion is taken to end with the read that fetches it; a real one may be a conversion time older.
    """

    CONFIGURATION, SHUNT, CURRENT, CALIBRATION, MASK, MANUFACTURER, DIE = 0, 1, 4, 5, 6, 0xFE, 0xFF
    AVERAGES = (1, 4, 16, 64, 128, 256, 512, 1024)
    TIMES_S = (140e-6, 204e-6, 332e-6, 588e-6, 1.1e-3, 2.116e-3, 4.156e-3, 8.244e-3)
    SHUNT_STEP_V = 2.5e-6

    defaults = {0: 0x4127, 1: 0, 2: 0, 3: 0, 4: 0, 5: 0, 6: 0, 7: 0, 0xFE: 0x5449, 0xFF: 0x2260}  # noqa: RUF012
    writable = frozenset((0, 5, 6, 7))

    def __init__(self, signal: Signal, shunt_ohm: float, sign: int) -> None:
        self._ampere_to_digits = sign * shunt_ohm / self.SHUNT_STEP_V
        super().__init__(signal)

    def reset(self) -> None:
        """As at power-up: converting, but without calibration."""
        super().reset()
        self._ready = False
        self._converted_s = self._signal.now_s
        self._configure()

    def _set(self, register: int, value: int) -> None:
        if register == self.CONFIGURATION and value & 0x8000:
            self.reset()
            return
        super()._set(register, value)
        if register == self.CONFIGURATION:
            self._configure()

    def _configure(self) -> None:
        word = self.registers[self.CONFIGURATION]
        time_s = self.AVERAGES[word >> 9 & 7] * self.TIMES_S[word >> 3 & 7]
        self._signal.set_rate_hz(1.0 / time_s)

    def _get(self, register: int) -> int:
        if register == self.MASK:
            self._convert()
            flags = self.registers[self.MASK] | (0x0008 if self._ready else 0)
            self._ready = False
            return flags
        if register in (self.SHUNT, self.CURRENT):
            self._convert()
        return super()._get(register)

    def _convert(self) -> None:
        if not self.registers[self.CONFIGURATION] & 0x1:  # mode without the shunt
            return
        newest_s = self._signal.newest_s()
        self._ready = self._ready or newest_s > self._converted_s
        self._converted_s = newest_s
        shunt = max(-0x8000, min(0x7FFF, round(self._signal.newest() * self._ampere_to_digits)))
        self.registers[self.SHUNT] = shunt & 0xFFFF
        self.registers[self.CURRENT] = _word(shunt * self.registers[self.CALIBRATION] / 2048)


class Ads1x15Chip(_WordChip):
    """A converter with the spring's sensor between its inputs 0 and 1."""

    CONVERSION, CONFIGURATION, LOW, HIGH = 0, 1, 2, 3
    RANGES_V = (6.144, 4.096, 2.048, 1.024, 0.512, 0.256, 0.256, 0.256)
    RATES_HZ = {  # noqa: RUF012  constants of the parts
        "ads1015": (128, 250, 490, 920, 1600, 2400, 3300, 3300),
        "ads1115": (8, 16, 32, 64, 128, 250, 475, 860),
    }
    IDLE = 0x8000

    defaults = {0: 0, 1: 0x8583, 2: 0x8000, 3: 0x7FFF}  # noqa: RUF012
    writable = frozenset((1, 2, 3))

    def __init__(self, signal: Signal, part: str, zero_v: float, m_per_v: float) -> None:
        self._part, self._zero_v, self._m_per_v = part, zero_v, m_per_v
        self._unused_bits = 4 if part == "ads1015" else 0
        super().__init__(signal)

    def reset(self) -> None:
        """As at power-up: idle, result zero."""
        super().reset()
        self._ready_s: float | None = None
        self._result = 0

    def _set(self, register: int, value: int) -> None:
        if register != self.CONFIGURATION:
            super()._set(register, value & ~(2**self._unused_bits - 1))
            return
        self._finish()
        super()._set(register, value & ~self.IDLE)
        if value & self.IDLE:
            self._start(value)

    def _get(self, register: int) -> int:
        self._finish()
        if register == self.CONFIGURATION:
            return super()._get(register) | (self.IDLE if self._ready_s is None else 0)
        return super()._get(register)

    def _start(self, configuration: int) -> None:
        """A conversion takes its sample when it starts."""
        rate_hz = self.RATES_HZ[self._part][configuration >> 5 & 7]
        self._signal.set_rate_hz(float(rate_hz))
        full_v = self.RANGES_V[configuration >> 9 & 7]
        volt = self._signal.newest() / self._m_per_v + self._zero_v
        digits = 2 ** (15 - self._unused_bits)
        count = max(-digits, min(digits - 1, round(volt / full_v * digits)))
        self._result = count << self._unused_bits & 0xFFFF
        self._ready_s = self._signal.now_s + 1.0 / rate_hz

    def _finish(self) -> None:
        if self._ready_s is not None and self._signal.now_s >= self._ready_s:
            self.registers[self.CONVERSION] = self._result
            self._ready_s = None
