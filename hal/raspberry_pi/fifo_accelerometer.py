"""What both accelerometers share: batches from a FIFO become specific force along the leg."""

from __future__ import annotations

import abc
from collections.abc import Sequence

from hal.devices import Clock
from hal.errors import CommandRefused
from hal.raspberry_pi.device import PiDevice
from hal.raspberry_pi.sample_times import SampleTimes
from hal.raspberry_pi.settings import AXES, AccelerometerSettings
from hal.readings import SpecificForce

STANDARD_GRAVITY_M_S2 = 9.80665

FULL_SCALE = 32767


class FifoAccelerometer(PiDevice, abc.ABC):
    """One axis of a three-axis accelerometer with a FIFO."""

    _rates: dict[float, tuple[int, float]]
    """Code in the part's rate register and period [s], by the rate's name [Hz]."""

    _clock_tolerance: float
    """Largest share by which the part's oscillator is off."""

    def __init__(self, name: str, clock: Clock, settings: AccelerometerSettings, step_m_s2: float) -> None:
        super().__init__(name)
        self._clock = clock
        self._axis = AXES.index(settings.axis)
        self._sign = settings.sign
        self._step_m_s2 = step_m_s2
        self._full_scale = FULL_SCALE
        self._times = SampleTimes(1.0, self._clock_tolerance)

    @property
    def range_m_s2(self) -> float:
        """Largest magnitude that can be read."""
        return self._full_scale * self._step_m_s2

    @property
    def resolution_m_s2(self) -> float:
        """Size of one digital step."""
        return self._step_m_s2

    def set_rate_hz(self, rate_hz: float) -> None:
        """Sample at this rate from now on; what waits in the FIFO is dropped.

        Raises `CommandRefused` for a rate the part does not have.
        """
        self._require_open()
        if rate_hz not in self._rates:
            known = ", ".join(f"{rate:g}" for rate in self._rates)
            raise CommandRefused(f"{self._name}: rate {rate_hz!r} Hz is not one of the part's rates: {known}")
        code, period_s = self._rates[rate_hz]
        self._start(code)
        self._times = SampleTimes(period_s, self._clock_tolerance)

    def read(self) -> SpecificForce:
        """All samples since the last read; may be empty.

        Raises `DeviceReset` when the part lost its settings, another `ReadFailed` when the bus or the data do.
        """
        self._require_open()
        read_s = self._clock.now_s()
        counts, overrun = self._drain()
        if overrun:
            self._times.restart()
        values = [self._sign * count[self._axis] for count in counts]
        return SpecificForce(
            self._times.batch(len(values), read_s),
            tuple(value * self._step_m_s2 for value in values),
            tuple(abs(value) >= self._full_scale for value in values),
            overrun,
        )

    @abc.abstractmethod
    def _start(self, rate_code: int) -> None:
        """Empty the FIFO and sample at the rate of this code."""

    @abc.abstractmethod
    def _drain(self) -> tuple[Sequence[tuple[int, int, int]], bool]:
        """All waiting samples of the three axes, and whether older ones were lost."""
