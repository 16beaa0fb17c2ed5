"""What the robot records of one hop, from arming to standing still again."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from flight.sensor_clock import ClockMap, SensorClock
from hal.readings import MagnetCurrent, SpecificForce, SpringCompression

Array = NDArray[np.float64]
Batch = TypeVar("Batch", SpecificForce, SpringCompression, MagnetCurrent)


_KEPT_S = 12.0  # longer than any hop


@dataclass(frozen=True)
class HopRecord:
    """Samples of one hop on the board's clock; each sensor has its own times, increasing.

    Shapes: accelerometer arrays (n,), spring arrays (m,), magnet arrays (l,). `fire_s` is when the magnet was
    energised. `complete` is False when a sensor lost samples within the record. `rate_sigma`: relative error of the
    accelerometer's clock rate, where that had to be estimated.
    """

    fire_s: float
    times_s: Array
    specific_force_m_s2: Array
    saturated: NDArray[np.bool_]
    spring_times_s: Array
    compression_m: Array
    complete: bool = True
    magnet_times_s: Array = field(default_factory=lambda: np.empty(0))
    magnet_current_a: Array = field(default_factory=lambda: np.empty(0))
    rate_sigma: float = 0.0


@dataclass
class HopRecorder:
    """Collects the batches of one hop as they come from the FIFOs, and each sensor's clock against the board's.

    Memory is bounded: of a long wait before the hop the newest seconds are kept, and of a hop, once `hold` was
    called, the first: a spring may ring on for long after the foot is down. After `rest` only the clocks go on.
    """

    _accelerometer: deque[SpecificForce] = field(default_factory=deque)
    _spring: deque[SpringCompression] = field(default_factory=deque)
    _magnet: deque[MagnetCurrent] = field(default_factory=deque)
    _clocks: dict[str, SensorClock] = field(
        default_factory=lambda: {name: SensorClock() for name in ("accelerometer", "spring", "magnet")}
    )
    _holding: bool = False
    _resting: bool = False

    def rest(self) -> None:
        """The hop is over: forget the samples, and keep none until `clear`."""
        self.clear()
        self._resting = True

    def hold(self) -> None:
        """The hop begins: what was kept stays until `clear`."""
        self._holding = True

    def clear(self) -> None:
        """Forget the samples, and keep those to come; what is known of the clocks stays."""
        self._holding = self._resting = False
        self._accelerometer.clear()
        self._spring.clear()
        self._magnet.clear()

    def add(
        self,
        force: SpecificForce | None,
        spring: SpringCompression | None,
        magnet: MagnetCurrent | None,
        now_s: float | None = None,
    ) -> None:
        """Keep one tick's batches; a batch that could not be read is None.

        `now_s`: the board's time of reading them. Without it the samples' times count as the board's.
        """
        if force is not None:
            self._keep("accelerometer", self._accelerometer, force, now_s)
        if spring is not None:
            self._keep("spring", self._spring, spring, now_s)
        if magnet is not None:
            self._keep("magnet", self._magnet, magnet, now_s)

    def _keep(self, name: str, batches: deque[Batch], batch: Batch, now_s: float | None) -> None:
        times_s = batch.times_s
        if not times_s:
            if batch.overrun and not self._resting:  # it tells of a loss
                batches.append(batch)
            return
        newest = times_s[-1]
        if now_s is not None:
            self._clocks[name].add(newest, now_s)
        if self._resting or (self._holding and newest - _oldest(batches, newest) > _KEPT_S):
            return
        batches.append(batch)
        while not (oldest := batches[0].times_s) or newest - oldest[-1] > _KEPT_S:
            batches.popleft()

    def clock(self, name: str) -> ClockMap:
        """What is known of the clock of `accelerometer`, `spring` or `magnet`."""
        return self._clocks[name].map()

    def record(self, fire_s: float) -> HopRecord:
        """The hop so far, as arrays."""
        flags = [
            batch.saturated if batch.saturated else (False,) * len(batch.times_s)
            for batch in self._accelerometer
        ]
        return HopRecord(
            fire_s=fire_s,
            times_s=self._times("accelerometer", self._accelerometer),
            specific_force_m_s2=_joined([batch.specific_force_m_s2 for batch in self._accelerometer]),
            saturated=np.array([flag for batch in flags for flag in batch], dtype=np.bool_),
            spring_times_s=self._times("spring", self._spring),
            compression_m=_joined([batch.compression_m for batch in self._spring]),
            # An overrun told by the first batch concerns samples from before the record.
            complete=not (_overrun(self._accelerometer) or _overrun(self._spring)),
            magnet_times_s=self._times("magnet", self._magnet),
            magnet_current_a=_joined([batch.current_a for batch in self._magnet]),
            rate_sigma=self.clock("accelerometer").rate_sigma,
        )

    def _times(self, name: str, batches: Iterable[Batch]) -> Array:
        stamps = _joined([batch.times_s for batch in batches])
        clock = self.clock(name)
        if clock == ClockMap():
            return stamps
        return clock.origin_s + clock.offset_s + clock.rate * (stamps - clock.origin_s)


def _oldest(batches: Iterable[Batch], newest: float) -> float:
    for kept in batches:
        if kept.times_s:
            return kept.times_s[0]
    return newest


def _overrun(batches: Iterable[SpecificForce | SpringCompression]) -> bool:
    return any(batch.overrun for batch in itertools.islice(batches, 1, None))


def _joined(batches: Sequence[tuple[float, ...]]) -> Array:
    return np.fromiter(itertools.chain.from_iterable(batches), dtype=np.float64)
