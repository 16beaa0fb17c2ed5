"""Runs a campaign: hands out cases, keeps each row as it comes, and stops when the first so many cases are there.

The result is that of the shortest run of indices from 0 whose rows hold what is wanted. So it does not depend on
which case ended first, on how many workers there were, or on how often the campaign was stopped and gone on with.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass
from itertools import count, islice
from pathlib import Path
from typing import Any

from ground.campaign import store
from ground.campaign.crews import WAITING_BY_WORKER, Crew
from ground.campaign.study import FAILED, Answer, Row, Study, failed_row, row_of, stamp_of
from hal.errors import ConfigError

Show = Callable[[str, float], None]
MOST_FAILURES = 20
"""Failures in a row at which a campaign ends: something is wrong with it, not with its cases."""


@dataclass(frozen=True)
class Throughput:
    """How fast the cases of this start were done. `busy_s` is the sum of what workers spent on cases [s]."""

    cases: int
    workers: int
    seconds: float
    busy_s: float

    @property
    def text(self) -> str:
        """In words."""
        if not self.cases:
            return "all cases were there already"
        rate = self.cases / self.seconds
        share = self.busy_s / (self.seconds * self.workers)
        return (
            f"{self.cases} cases in {self.seconds:.1f} s by {self.workers} workers: {rate:.3g} cases a second, "
            f"{rate / self.workers:.3g} a worker, each busy {100.0 * min(share, 1.0):.0f} % of the time"
        )


@dataclass(frozen=True)
class StudyResult:
    """Rows of the cases that count, by index: those that came to a result, and those that failed."""

    rows: tuple[Row, ...]
    failed: tuple[Row, ...]
    throughput: Throughput


class Prefix:
    """The rows from index 0 on without a gap, until they hold what is wanted."""

    def __init__(self, study: Study, rows: dict[int, Row], wanted: float) -> None:
        self._study, self._rows, self._wanted = study, rows, wanted
        self.length, self.counted, self._failures = 0, 0.0, 0

    def full(self) -> bool:
        """Look at new rows. Raises `ConfigError` after too many failures in a row."""
        while self.counted < self._wanted and self.length in self._rows:
            row = self._rows[self.length]
            self.length += 1
            self.counted += self._study.counts(row)
            self._failures = 0 if row[FAILED] is None else self._failures + 1
            if self._failures >= MOST_FAILURES:
                raise ConfigError(
                    f"{self._failures} cases failed one after the other, the last: {row[FAILED]}"
                )
        return self.counted >= self._wanted

    def result(self, throughput: Throughput) -> StudyResult:
        """What counts."""
        rows = [self._rows[index] for index in range(self.length)]
        good = tuple(row for row in rows if row[FAILED] is None)
        return StudyResult(good, tuple(row for row in rows if row[FAILED] is not None), throughput)


def run_study(study: Study, wanted: float, folder: Path, workers: Crew, show: Show) -> StudyResult:
    """Do cases until they hold `wanted`; those kept in `folder` count. `show` is told a text and how much there is.

    Raises `ConfigError` when the folder is of another campaign, or when cases do nothing but fail.
    """
    stamp = stamp_of(study)
    start, busy_s, done = time.monotonic(), 0.0, 0
    with store.opened(folder, stamp, study.schema()) as kept:
        prefix = Prefix(study, kept.rows, wanted)
        if not prefix.full():
            most = study.most_cases(wanted)
            cases = count(prefix.length) if most is None else range(prefix.length, most)
            todo = (index for index in cases if index not in kept.rows)
            for answer in _answers(study, stamp, todo, workers):
                kept.add(answer.row)
                busy_s, done = busy_s + answer.seconds, done + 1
                full = prefix.full()
                show(_progress(study, prefix, kept.rows, wanted), min(prefix.counted, wanted))
                if full:
                    break
    return prefix.result(Throughput(done, workers.workers(), time.monotonic() - start, busy_s))


def _progress(study: Study, prefix: Prefix, rows: dict[int, Row], wanted: float) -> str:
    failed = sum(row[FAILED] is not None for row in rows.values())
    odd = sum(row[FAILED] is None and study.suspicious(row) for row in rows.values())
    return f"{prefix.counted:g} of {wanted:g} in {prefix.length} cases, {odd} to look at, {failed} failed"


def _answers(study: Study, stamp: dict[str, Any], todo: Iterator[int], workers: Crew) -> Iterator[Answer]:
    """Answers as they come. What runs is never more than a few cases ahead of what is kept."""
    waiting = dict[Future[Answer], int]()
    try:
        while True:
            room = 1 if workers.workers() == 1 else WAITING_BY_WORKER * workers.workers()
            for index in islice(todo, max(0, room - len(waiting))):
                waiting[workers.submit(study, index, stamp)] = index
            if not waiting:
                return
            ended, _ = wait(waiting, return_when=FIRST_COMPLETED)
            for future in sorted(ended, key=waiting.__getitem__):
                yield workers.result(future, study, waiting.pop(future), stamp)
    finally:
        for future in waiting:
            future.cancel()


def replay(study: Study, index: int) -> tuple[Row, str]:
    """Do one case again, here: its row as it would be kept, and the traceback of one that fails."""
    try:
        return row_of(study, index), ""
    except Exception as error:  # as in a worker
        return failed_row(index, f"{type(error).__name__}: {error}"), traceback.format_exc()
