"""Rows of the table: medians and spreads of ours and the peer's, and their ratio; how cost grows with size."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

Job = Callable[[], object]


@dataclass(frozen=True)
class Row:
    """`ours` and `theirs` are what the repetitions gave; `theirs` is empty where there is no peer.

    `gain` says whether more is better. `note`: what makes the two alike, or why ours is the slower one.
    """

    name: str
    unit: str
    ours: tuple[float, ...]
    peer: str = ""
    theirs: tuple[float, ...] = ()
    gain: bool = False
    note: str = ""

    @property
    def ratio(self) -> float | None:
        """How many times better ours is than the peer; None without a peer, or where one of them is nothing."""
        if not self.theirs:
            return None
        ours, theirs = float(np.median(self.ours)), float(np.median(self.theirs))
        if ours <= 0.0 or theirs <= 0.0:
            return None
        return ours / theirs if self.gain else theirs / ours

    @property
    def cells(self) -> tuple[str, ...]:
        """As the table shows it."""
        ratio = "–" if self.ratio is None else f"{plain(self.ratio, 3)} ×"
        return (
            self.name,
            spread(self.ours),
            self.unit,
            self.peer or "–",
            spread(self.theirs),
            ratio,
            self.note,
        )


@dataclass(frozen=True)
class Growth:
    """Cost [s] against size, and the exponent of the power law through both."""

    name: str
    sizes: tuple[float, ...]
    seconds: tuple[float, ...]

    @property
    def exponent(self) -> tuple[float, float]:
        """Least squares of the logarithms: the slope and its standard error (NaN for two points)."""
        x, y = np.log(self.sizes), np.log(self.seconds)
        slope, offset = np.polyfit(x, y, 1)
        left = y - slope * x - offset
        if len(x) < 3:
            return float(slope), float("nan")
        return float(slope), float(np.sqrt(left @ left / (len(x) - 2) / np.sum((x - x.mean()) ** 2)))

    @property
    def cells(self) -> tuple[str, ...]:
        """As the table shows it."""
        slope, error = self.exponent
        points = ", ".join(
            f"{size:g}: {plain(1e3 * s, 3)} ms" for size, s in zip(self.sizes, self.seconds, strict=True)
        )
        return self.name, points, f"{slope:.2f} ± {error:.2f}"


def spread(values: Sequence[float]) -> str:
    """Median and the range of all."""
    if not values:
        return "–"
    middle = plain(float(np.median(values)), 4)
    return middle if len(values) == 1 else f"{middle} ({plain(min(values), 3)} to {plain(max(values), 3)})"


def plain(value: float, digits: int) -> str:
    """So many digits, without an exponent where the number is large, in groups of three from ten thousand on."""
    short = f"{value:.{digits}g}"
    rounded = float(short)
    if abs(rounded) < 1000.0:
        return short
    return f"{rounded:,.0f}".replace(",", "\N{NO-BREAK SPACE}" if abs(rounded) >= 10_000.0 else "")


def seconds(job: Job) -> float:
    """Processor time of a job, this process's alone."""
    start = time.process_time()
    job()
    return time.process_time() - start


def by_turns(repeats: int, *jobs: Job) -> tuple[tuple[float, ...], ...]:
    """Processor times of the jobs, each warmed up, then one after the other again and again: alike disturbed."""
    for job in jobs:
        job()
    taken = [tuple(seconds(job) for job in jobs) for _ in range(repeats)]
    return tuple(zip(*taken, strict=True))


def rates(count: float, taken: Sequence[float]) -> tuple[float, ...]:
    """So many of something in such times, as rates."""
    return tuple(count / one for one in taken)
