"""Sampled sensors: sample instants on the sensor's own grid, noise, digital step, range, FIFO.

In this order: white Gaussian noise is added to the true value, the sum is rounded to the step and then
limited to the range. Each sensor draws from its own substream of the seed, once for each of its sample
instants: neither reading one sensor nor how the waiting is cut into pieces changes any sensor's noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hal.errors import CommandRefused, ReadFailed
from sim_hal.faults import Fault
from sim_hal.settings import Mode, SensorSettings

GRID_TOLERANCE_S = 1e-9
"""A sample instant this little after `now` counts as reached: sums of tick periods round either way."""

_AHEAD = 256  # draws of noise made at once


class Sample(NamedTuple):
    """One delivered value."""

    time_s: float
    value: float
    saturated: bool


class Batch(NamedTuple):
    """Samples as a FIFO delivers them, oldest first; `overrun`: older ones were lost before them."""

    times_s: tuple[float, ...]
    values: tuple[float, ...]
    saturated: tuple[bool, ...]
    overrun: bool


def _broken(value: float, noise: float, fault: Fault, latest: Sample | None) -> float:
    """What a broken sensor makes of a sample; `noise` is white with a sigma of 1."""
    if fault.kind == "offset":
        return value + fault.size
    if fault.kind in ("scale", "short"):
        return value * fault.size
    if fault.kind == "noise":
        return value + fault.size * noise
    if fault.kind == "stick" and latest is not None:
        return latest.value
    return value


class SampledSensor:
    """One sensor: when it samples, what it makes of the truth, and the samples not yet read."""

    def __init__(self, name: str, settings: SensorSettings, seed: np.random.SeedSequence) -> None:
        self.name = name
        self.step = settings.step
        self._modes = settings.modes
        self._random = np.random.Generator(np.random.PCG64(seed))
        self._depth = settings.depth
        self._fifo: tuple[list[float], list[float], list[bool]] = [], [], []
        self._latest: Sample | None = None
        self._overrun = False
        self._mode = settings.modes[0]
        self._count = 0
        self._noise: list[float] = []
        self._used = 0

    @property
    def modes(self) -> tuple[Mode, ...]:
        """The rates that the sensor has."""
        return self._modes

    @property
    def mode(self) -> Mode:
        """The rate in force, with its noise and range."""
        return self._mode

    def set_rate_hz(self, rate_hz: float, now_s: float) -> None:
        """Sample at another rate after `now_s`; raises `CommandRefused` for one that the part does not have.

        Instants are whole multiples of the period since power-up, whenever the rate was set: sensors of one
        rate sample together.
        """
        for mode in self._modes:
            if mode.rate_hz == rate_hz:
                self._mode = mode
                self._count = math.floor((now_s + GRID_TOLERANCE_S) * rate_hz) + 1
                return
        known = ", ".join(f"{mode.rate_hz:g}" for mode in self._modes)
        raise CommandRefused(f"{self.name}: rate {rate_hz!r} Hz is not one of the part's rates: {known}")

    def due(self, now_s: float) -> list[float]:
        """Take the sample instants reached by `now_s` [s]; each is handed out once, oldest first."""
        rate_hz, latest_s = self._mode.rate_hz, now_s + GRID_TOLERANCE_S
        end = math.floor(latest_s * rate_hz) + 1
        if end / rate_hz <= latest_s:  # the product was rounded down
            end += 1
        elif (end - 1) / rate_hz > latest_s:  # or up
            end -= 1
        if end <= self._count:
            return []
        instants = [count / rate_hz for count in range(self._count, end)]
        self._count = end
        if instants[-1] > now_s - GRID_TOLERANCE_S:
            instants[-1] = now_s  # the same but for rounding: what is due now is looked at once
        return instants

    def record(self, instants: Sequence[float], truth: Sequence[float], fault: Fault | None = None) -> bool:
        """Sample true values (same length as `instants`); `fault` says how the sensor is broken, if it is.

        Returns whether the fault has made a difference.
        """
        if not instants:
            return False
        # the noise is drawn even by a broken sensor, so that a fault leaves all later samples as they were
        drawn = self._drawn(len(instants))
        # plain numbers: most batches are of a few samples, for which arrays take longer
        sigma = self._mode.noise_std
        measured = [true + sigma * noise for true, noise in zip(truth, drawn, strict=True)]
        if fault is None:
            self._keep(instants, *self._digital(measured))
            return False
        if fault.kind in ("silent", "fail"):
            return True
        broken = [_broken(*each, fault, self._latest) for each in zip(measured, drawn, strict=True)]
        shown, saturated = self._digital(broken)
        self._keep(instants, shown, saturated)
        return shown != self._digital(measured)[0]

    def _drawn(self, count: int) -> list[float]:
        """White noise of sigma 1, drawn ahead: the sequence is that of single draws."""
        start, self._used = self._used, self._used + count
        if self._used > len(self._noise):
            self._noise = self._noise[start:] + self._random.standard_normal(_AHEAD + count).tolist()
            start, self._used = 0, count
        return self._noise[start : self._used]

    def _digital(self, values: list[float]) -> tuple[list[float], list[bool]]:
        """Rounded to the step, then limited to the range; and whether each is at its end."""
        step, low, high = self.step, self._mode.low, self._mode.high
        if step > 0.0:
            values = [round(value / step) * step for value in values]
        if low < min(values) and max(values) < high:
            return values, [False] * len(values)
        values = [low if value < low else high if value > high else value for value in values]
        return values, [not low < value < high for value in values]

    def _keep(self, times_s: Sequence[float], shown: list[float], saturated: list[bool]) -> None:
        """To the FIFO, which loses its oldest samples when it is full."""
        times, values, flags = self._fifo
        times += times_s
        values += shown
        flags += saturated
        if len(times) > self._depth:
            self._overrun = True
            for kept in self._fifo:
                del kept[: -self._depth]
        self._latest = Sample(times_s[-1], shown[-1], saturated[-1])

    def drain(self) -> Batch:
        """All samples since the last call, and whether older ones were lost before them."""
        times_s, values, saturated = self._fifo
        batch = Batch(tuple(times_s), tuple(values), tuple(saturated), self._overrun)
        self._fifo = [], [], []
        self._overrun = False
        return batch

    def latest(self) -> Sample:
        """The newest sample, however old. Raises `ReadFailed` when there was none yet."""
        if self._latest is None:
            raise ReadFailed(f"{self.name}: no sample yet")
        return self._latest
