"""Sampled sensors: sample instants on the sensor's own grid, noise, digital step, range, FIFO.

In this order: white Gaussian noise is added to the true value, the sum is rounded to the step and then
limited to the range. Each sensor draws from its own substream of the seed, once for each of its sample
instants: neither reading one sensor nor how the waiting is cut into pieces changes any sensor's noise.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection, Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np

from hal.errors import CommandRefused, ReadFailed
from sim_hal.faults import Fault
from sim_hal.settings import Mode, SensorSettings

GRID_TOLERANCE_S = 1e-9
"""A sample instant this little after `now` counts as reached: sums of tick periods round either way."""

_AHEAD = 1024  # draws of noise made at once

Piece = tuple[Sequence[float], Sequence[float], Sequence[bool]]
"""Times, values, and whether each is at the end of the range."""

Still = tuple[float, tuple[float, ...], tuple[bool, ...]]
"""A truth that holds, what a sensor shows of it for each draw of noise, and whether each is at the range's end."""

_INSIDE, _AT_END = (False,), (True,)


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


def _reached(rate_hz: float, now_s: float) -> int:
    """How many of a rate's sample instants, the first at 0 s, are reached by `now_s` [s]."""
    if now_s < 0.0:
        return 0
    latest_s = now_s + GRID_TOLERANCE_S
    count = math.floor(latest_s * rate_hz) + 1
    if count / rate_hz <= latest_s:  # the product was rounded down
        return count + 1
    if (count - 1) / rate_hz > latest_s:  # or up
        return count - 1
    return count


def instants(rate_hz: float, after_s: float, until_s: float) -> tuple[float, ...]:
    """The whole multiples of a rate's period after `after_s` and until `until_s` [s], increasing.

    They count from power-up, whenever a sensor's rate was set: sensors of one rate sample together.
    """
    first, end = _reached(rate_hz, after_s), _reached(rate_hz, until_s)
    if end <= first:
        return ()
    # the last is the same as `until_s` but for rounding: what is due then is looked at once
    at_end = (end - 1) / rate_hz > until_s - GRID_TOLERANCE_S
    if end == first + 1 and at_end:  # mostly, of those at the rate of the ticks
        return (until_s,)
    multiples = [count / rate_hz for count in range(first, end)]
    if at_end:
        multiples[-1] = until_s
    return tuple(multiples)


class SampledSensor:
    """One sensor: when it samples, what it makes of the truth, and the samples not yet read."""

    def __init__(self, name: str, settings: SensorSettings, seed: np.random.SeedSequence) -> None:
        self.name = name
        self.step = settings.step
        self._modes = settings.modes
        self._random = np.random.Generator(np.random.PCG64(seed))
        self._depth = settings.depth
        self._fifo: deque[Piece] = deque()
        self._waiting = 0  # samples in it
        self._newest: Piece | None = None
        self._overrun = False
        self.mode = settings.modes[0]
        """The rate in force, with its noise and range."""
        self._noise: list[float] = []
        self._used = 0
        self._still: Still | None = None

    @property
    def modes(self) -> tuple[Mode, ...]:
        """The rates that the sensor has."""
        return self._modes

    def set_rate_hz(self, rate_hz: float) -> None:
        """Sample at another rate from now on; raises `CommandRefused` for one that the part does not have."""
        for mode in self._modes:
            if mode.rate_hz == rate_hz:
                self.mode = mode
                self._still = None
                return
        known = ", ".join(f"{mode.rate_hz:g}" for mode in self._modes)
        raise CommandRefused(f"{self.name}: rate {rate_hz!r} Hz is not one of the part's rates: {known}")

    def record(
        self, instants: Sequence[float], truth: Sequence[float] | float, fault: Fault | None = None
    ) -> bool:
        """Sample true values (same length as `instants`), or one that held all the time.

        `fault` says how the sensor is broken, if it is. Returns whether that has made a difference.
        """
        count = len(instants)
        if not count:
            return False
        # the noise is drawn even by a broken sensor, so that a fault leaves all later samples as they were
        start = self._used
        end = self._used = start + count
        if end > len(self._noise):
            start, end = self._draw_ahead(start, count)
        if fault is not None:
            return self._record_broken(instants, truth, start, fault)
        if isinstance(truth, float):
            still = self._still
            if still is None or still[0] != truth:
                still = self._of_still(truth)
            self._keep((instants, still[1][start:end], still[2][start:end]))
        elif count == 1:  # at each tick of several sensors
            self._keep(self._one(instants, truth[0], self._noise[start]))
        else:
            self._keep((instants, *self._measured(truth, start)))
        return False

    def _record_broken(
        self, instants: Sequence[float], truth: Sequence[float] | float, start: int, fault: Fault
    ) -> bool:
        """As `record`, by a broken sensor."""
        true = (truth,) * len(instants) if isinstance(truth, float) else truth
        if fault.kind in ("silent", "fail"):
            return True
        self._keep((instants, *self._measured(true, start, fault)))
        assert self._newest is not None
        return list(self._newest[1]) != list(self._measured(true, start)[0])

    def _draw_ahead(self, start: int, count: int) -> tuple[int, int]:
        """More white noise of sigma 1, of which `count` is taken: where. The sequence is that of single draws."""
        self._noise = self._noise[start:] + self._random.standard_normal(_AHEAD + count).tolist()
        self._used, self._still = count, None
        return 0, count

    def _of_still(self, truth: float) -> Still:
        """What the noise makes of a truth that holds: done at once for all noise that was drawn ahead."""
        mode = self.mode
        values = truth + mode.noise_std * np.array(self._noise)
        if self.step > 0.0:
            values = np.rint(values / self.step) * self.step + 0.0  # no -0.0, as by `round`
        inside = (mode.low < values) & (values < mode.high)
        if inside.all():  # nearly always
            self._still = truth, tuple(values.tolist()), (False,) * len(values)
        else:
            values = np.clip(values, mode.low, mode.high)
            self._still = truth, tuple(values.tolist()), tuple((~inside).tolist())
        return self._still

    def _one(self, instants: Sequence[float], true: float, noise: float) -> Piece:
        """As `_measured`, of one sample."""
        mode, step = self.mode, self.step
        value = true + mode.noise_std * noise
        if step > 0.0:
            value = round(value / step) * step
        if mode.low < value < mode.high:
            return instants, (value,), _INSIDE
        return instants, (max(mode.low, min(mode.high, value)),), _AT_END

    def _measured(
        self, truth: Sequence[float], start: int, fault: Fault | None = None
    ) -> tuple[Sequence[float], Sequence[bool]]:
        """What the noise from `start` on makes of true values; and whether each is at the range's end."""
        step, sigma, low, high = self.step, self.mode.noise_std, self.mode.low, self.mode.high
        # plain numbers: most batches are of a few samples, for which arrays take longer
        noises = self._noise[start : start + len(truth)]
        if fault is None and step > 0.0:
            shown = [
                round((true + sigma * noise) / step) * step for true, noise in zip(truth, noises, strict=True)
            ]
        else:
            shown = [true + sigma * noise for true, noise in zip(truth, noises, strict=True)]
        if fault is not None:
            latest = self.latest() if self._newest is not None else None
            shown = [_broken(value, noise, fault, latest) for value, noise in zip(shown, noises, strict=True)]
            if step > 0.0:
                shown = [round(value / step) * step for value in shown]
        if low < min(shown) and max(shown) < high:  # nearly always
            return shown, (False,) * len(shown)
        shown = [max(low, min(high, value)) for value in shown]
        return shown, [not low < value < high for value in shown]

    def _keep(self, piece: Piece) -> None:
        """To the FIFO, which loses its oldest samples when it is full: pieces here, the rest when it is drained."""
        self._newest = piece
        fifo = self._fifo
        fifo.append(piece)
        self._waiting += len(piece[0])
        if self._waiting > self._depth:
            self._overrun = True
            while self._waiting - len(fifo[0][0]) >= self._depth:
                self._waiting -= len(fifo.popleft()[0])

    def drain(self) -> Batch:
        """All samples since the last call, and whether older ones were lost before them."""
        return Batch(*self.take())

    def take(self) -> tuple[tuple[float, ...], tuple[float, ...], tuple[bool, ...], bool]:
        """As `drain`, without names."""
        times_s, values, saturated = self._fifo[0] if len(self._fifo) == 1 else _joined(self._fifo)
        if len(times_s) > self._depth:
            kept = slice(-self._depth, None)
            times_s, values, saturated = times_s[kept], values[kept], saturated[kept]
        overrun = self._overrun
        self._fifo.clear()
        self._waiting, self._overrun = 0, False
        return tuple(times_s), tuple(values), tuple(saturated), overrun

    def poll(self) -> tuple[float, float]:
        """Time and value of the newest sample, however old; none waits any more. Raises `ReadFailed` as `latest`."""
        self._fifo.clear()
        self._waiting = 0
        if self._newest is None:
            raise self._nothing_yet()
        times_s, values, _ = self._newest
        return times_s[-1], values[-1]

    def latest(self) -> Sample:
        """The newest sample, however old. Raises `ReadFailed` when there was none yet."""
        if self._newest is None:
            raise self._nothing_yet()
        times_s, values, saturated = self._newest
        return Sample(times_s[-1], values[-1], saturated[-1])

    def _nothing_yet(self) -> ReadFailed:
        return ReadFailed(f"{self.name}: no sample yet")


def _joined(pieces: Collection[Piece]) -> Piece:
    """The pieces of a FIFO as one."""
    times, values, flags = (
        (tuple(chain.from_iterable(part)) for part in zip(*pieces, strict=True)) if pieces else ((), (), ())
    )
    return times, values, flags
