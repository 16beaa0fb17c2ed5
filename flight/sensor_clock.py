"""The clock of a sensor against the board's, from the sensor's own time stamps and the times at which they were read.

A sample is read no earlier than it was taken, and now and then almost at once. So in the plane of stamp and reading
time all batches lie on or above the line that maps one clock to the other, and the lower hull of the points tells it:
of the hull's edges, the one under the middle of the record (the least mean delay that no reading contradicts).
V. Paxson, "On calibrating measurements of packet transit times" (SIGMETRICS 1998), uses the same envelope.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

_HORIZON_S = 20.0  # older readings are forgotten: a crystal's temperature drifts
_MOST_POINTS = 256
_LEAST_READINGS = 30
_LEAST_SPAN_S = 0.2
_BELIEVED_SIGMAS = 4.0


@dataclass(frozen=True)
class ClockMap:
    """Board time = `offset_s` + `rate` * (stamp - `origin_s`) + `origin_s`; the rate with its sigma.

    The offset has an unknown, constant delay of reading in it, of which intervals are free.
    """

    rate: float = 1.0
    offset_s: float = 0.0
    origin_s: float = 0.0
    rate_sigma: float = 0.0

    def board_s(self, stamp_s: float) -> float:
        return self.origin_s + self.offset_s + self.rate * (stamp_s - self.origin_s)


@dataclass
class SensorClock:
    """Gathers stamp and reading time of the newest sample of each batch; memory is bounded."""

    _hull: list[tuple[float, float]] = field(default_factory=list)
    _first: tuple[float, float] | None = None
    _count: int = 0
    _stamps: float = 0.0
    _reads: float = 0.0
    _newest: float = float("-inf")

    def add(self, stamp_s: float, read_s: float) -> None:
        """One reading. Stamps that do not increase restart the clock."""
        if stamp_s == self._newest or not (math.isfinite(stamp_s) and math.isfinite(read_s)):
            return
        first, hull = self._first, self._hull
        back = stamp_s < self._newest
        if first is None or back or stamp_s - first[0] > _HORIZON_S or len(hull) > _MOST_POINTS:
            first = self._restart(stamp_s, read_s)
            hull = self._hull
        self._newest = stamp_s
        x, y = stamp_s - first[0], read_s - first[1]
        self._count += 1
        self._stamps += x
        self._reads += y
        while len(hull) > 1:
            (first_x, first_y), (last_x, last_y) = hull[-2], hull[-1]
            if (last_x - first_x) * (y - first_y) - (last_y - first_y) * (x - first_x) > 0.0:
                break
            hull.pop()
        hull.append((x, y))

    def _restart(self, stamp_s: float, read_s: float) -> tuple[float, float]:
        self._first, self._hull, self._count = (stamp_s, read_s), [], 0
        self._stamps = self._reads = 0.0
        return self._first

    def map(self) -> ClockMap:
        """The map so far; the identity where the readings do not contradict it, or are too few to tell."""
        if self._first is None or self._count < _LEAST_READINGS or len(self._hull) < 2:
            return ClockMap()
        span_s = self._hull[-1][0] - self._hull[0][0]
        if span_s < _LEAST_SPAN_S:
            return ClockMap()
        middle = self._stamps / self._count
        below, above = next(
            (pair for pair in zip(self._hull, self._hull[1:], strict=False) if pair[1][0] >= middle),
            (self._hull[-2], self._hull[-1]),
        )
        rate = (above[1] - below[1]) / (above[0] - below[0])
        delay_s = self._reads / self._count - below[1] - rate * (middle - below[0])
        # The envelope is touched to about the mean delay over the readings; some samples and some readings fail it.
        sigma = 14.0 * delay_s / (self._count * span_s) + 1e-9
        first_stamp, first_read = self._first
        lag_s = (
            first_read + below[1] - (first_stamp + below[0])
        )  # of the identity, where the envelope is touched
        if abs(rate - 1.0) < _BELIEVED_SIGMAS * sigma and abs(lag_s) < 2.0 * delay_s + 1e-6:
            return ClockMap()
        origin = first_stamp + below[0]
        return ClockMap(rate, lag_s, origin, sigma)
