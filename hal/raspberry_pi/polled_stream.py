"""A stream made of a converter without FIFO: a task samples it at its rate, `drain` hands the samples over."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable

from hal.errors import ReadFailed
from hal.raspberry_pi.ports import Sampler

LATE_PERIODS = 1.5
"""A gap longer than this between two samples is one in which samples were lost."""


class PolledStream:
    """Samples between two reads. `take(now_s)` gives the time and value of the sample then due, or None."""

    def __init__(
        self, sampler: Sampler, depth: int, take: Callable[[float], tuple[float, float] | None]
    ) -> None:
        self._sampler = sampler
        self._take = take
        self._samples: deque[tuple[float, float]] = deque(maxlen=depth)
        self._lock = threading.Lock()
        self._error: ReadFailed | None = None
        self._overrun = False
        self._newest: tuple[float, float] | None = None
        self._period_s = 0.0
        self._stop: Callable[[], None] = lambda: None

    def start(self, rate_hz: float) -> None:
        """Sample at another rate from now on; what was sampled stays."""
        self._stop()
        with self._lock:
            self._newest = None
            self._period_s = 1.0 / rate_hz
        self._stop = self._sampler.every(rate_hz, self._sample)

    def stop(self) -> None:
        """Sample no more."""
        self._stop()

    def newest(self) -> float | None:
        """The newest value, also after it was handed over; None before the first."""
        with self._lock:
            return self._newest[1] if self._newest else None

    def drain(self) -> tuple[tuple[float, ...], tuple[float, ...], bool]:
        """Times [s] and values since the last call, and whether older ones were lost.

        Raises the `ReadFailed` of a sample that failed since then; the next call tells of the loss.
        """
        with self._lock:
            samples, overrun, error = tuple(self._samples), self._overrun, self._error
            self._samples.clear()
            self._overrun, self._error = error is not None, None
        if error is not None:
            raise error
        return tuple(time_s for time_s, _ in samples), tuple(value for _, value in samples), overrun

    def lose(self) -> None:
        """What was sampled since the last `drain` cannot be trusted."""
        with self._lock:
            self._samples.clear()
            self._overrun = True

    def _sample(self, now_s: float) -> None:
        try:
            sample = self._take(now_s)
        except ReadFailed as error:
            with self._lock:
                self._error = error
            return
        if sample is None:
            return
        with self._lock:
            full = len(self._samples) == self._samples.maxlen
            late = self._newest is not None and sample[0] - self._newest[0] > LATE_PERIODS * self._period_s
            self._overrun = self._overrun or full or late
            self._samples.append(sample)
            self._newest = sample
