"""Sampled sensors: sample instants on the sensor's own grid, noise, digital step, range, FIFO.

In this order: white Gaussian noise is added to the true value, the sum is rounded to the step and then
limited to the range. Each sensor draws from its own substream of the seed, once for each of its sample
instants: neither reading one sensor nor how the waiting is cut into pieces changes any sensor's noise.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hal.errors import CommandRefused, ReadFailed
from sim_hal.faults import Fault
from sim_hal.settings import Mode, SensorSettings

GRID_TOLERANCE_S = 1e-9
"""A sample instant this little after `now` counts as reached: sums of tick periods round either way."""


class Sample(NamedTuple):
    """One delivered value."""

    time_s: float
    value: float
    saturated: bool


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


def _digital(value: float, step: float, low: float, high: float) -> float:
    """Rounded to the step, then limited to the range."""
    if step > 0.0:
        value = round(value / step) * step
    return low if value < low else high if value > high else value


class SampledSensor:
    """One sensor: when it samples, what it makes of the truth, and the samples not yet read."""

    def __init__(self, name: str, settings: SensorSettings, seed: np.random.SeedSequence) -> None:
        self.name = name
        self.step = settings.step
        self._modes = settings.modes
        self._random = np.random.Generator(np.random.PCG64(seed))
        self._fifo: deque[Sample] = deque(maxlen=settings.depth)
        self._latest: Sample | None = None
        self._overrun = False
        self._mode = settings.modes[0]
        self._count = 0

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
        instants: list[float] = []
        while (instant := self._count / self._mode.rate_hz) <= now_s + GRID_TOLERANCE_S:
            instants.append(min(instant, now_s))
            self._count += 1
        return instants

    def record(self, instants: Sequence[float], truth: Sequence[float], fault: Fault | None = None) -> bool:
        """Sample true values (same length as `instants`); `fault` says how the sensor is broken, if it is.

        Returns whether the fault has made a difference.
        """
        if not instants:
            return False
        mode, stuck_at, differs = self._mode, self._latest, False
        # the noise is drawn even by a broken sensor, so that a fault leaves all later samples as they were
        drawn = self._random.standard_normal(len(instants)).tolist()
        if fault is not None and fault.kind in ("silent", "fail"):
            return True
        # plain numbers: most batches are of one sample, for which arrays take several times as long
        step, noise_std, low, high = self.step, mode.noise_std, mode.low, mode.high
        for time_s, true, noise in zip(instants, truth, drawn, strict=True):
            measured = true + noise_std * noise
            shown = _digital(measured, step, low, high)
            if fault is not None:
                healthy = shown
                shown = _digital(_broken(measured, noise, fault, stuck_at), step, low, high)
                differs = differs or shown != healthy
            self._append(Sample(time_s, shown, not low < shown < high))
        return differs

    def _append(self, sample: Sample) -> None:
        self._overrun = self._overrun or len(self._fifo) == self._fifo.maxlen
        self._fifo.append(sample)
        self._latest = sample

    def drain(self) -> tuple[tuple[Sample, ...], bool]:
        """All samples since the last call, and whether older ones were lost before them."""
        batch, overrun = tuple(self._fifo), self._overrun
        self._fifo.clear()
        self._overrun = False
        return batch, overrun

    def latest(self) -> Sample:
        """The newest sample, however old. Raises `ReadFailed` when there was none yet."""
        if self._latest is None:
            raise ReadFailed(f"{self.name}: no sample yet")
        return self._latest
