"""When the samples of a FIFO were taken, from how many there are and the times at which that was read.

A part samples by its own oscillator, some per cent off the nominal rate. At each read the newest sample is
younger than one period; the period itself follows from the count over a long time.
"""

from __future__ import annotations

SETTLED_PERIODS = 1000
"""Samples after which the counted period is better than the nominal one (an end is known to one period)."""


class SampleTimes:
    """Times of successive samples on the board's clock."""

    def __init__(self, nominal_period_s: float, tolerance: float) -> None:
        """`tolerance`: largest share by which the part's oscillator may be off (its data sheet)."""
        self._nominal_s = self._period_s = nominal_period_s
        self._tolerance = tolerance
        self.restart()

    @property
    def period_s(self) -> float:
        """Best estimate of the time between two samples."""
        return self._period_s

    def restart(self) -> None:
        """Forget what was counted: the stream was interrupted."""
        self._newest_s: float | None = None
        self._first_read_s = 0.0
        self._count = 0

    def batch(self, count: int, read_s: float) -> tuple[float, ...]:
        """Times [s] of the `count` samples that were waiting at `read_s`, oldest first.

        They are spaced by the period, except that the first follows the last batch.
        """
        if count == 0:
            return ()
        if self._newest_s is None:
            self._newest_s, self._first_read_s = read_s, read_s
        else:
            self._count += count
            self._learn(read_s)
            expected_s = self._newest_s + count * self._period_s
            self._newest_s = min(read_s, max(expected_s, read_s - self._period_s))
        newest_s = self._newest_s
        return tuple(newest_s - index * self._period_s for index in range(count - 1, -1, -1))

    def _learn(self, read_s: float) -> None:
        if self._count >= SETTLED_PERIODS:
            counted_s = (read_s - self._first_read_s) / self._count
            most = self._tolerance * self._nominal_s
            self._period_s = min(max(counted_s, self._nominal_s - most), self._nominal_s + most)
