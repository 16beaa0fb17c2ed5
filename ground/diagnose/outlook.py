"""How far a diagnosis is: an estimate, since nobody knows beforehand how many effects it will find."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TypeVar

from ground.progress import Show, nobody

T = TypeVar("T")

WORK = {
    "refit": 2.0,
    "locate": 4.0,
    "screen": 4.0,
    "fit": 40.0,
    "replace": 25.0,
    "between": 10.0,
    "settle": 40.0,
    "verify": 5.0,
}
"""About how long the stages take beside each other; seconds for 24 s of an axis at 1 kHz on one core."""
LOOKS = 3
"""Screenings, each with its fits, that are expected until nothing more is found; when more come, one is ahead."""
LOOK = ("screen", "fit")
ORDER = ("refit", "locate", *LOOK, "settle", "verify")


class Outlook:
    """Tells which stage has begun, and about which share of the whole is done; the share never falls."""

    def __init__(self, show: Show = nobody) -> None:
        self._show = show
        self._stage, self._text = "refit", ""
        self._main = "refit"  # of `ORDER`; replacing belongs to whichever it happens in
        self._done = self._share = 0.0
        self._looks = 0

    def begin(self, stage: str, text: str) -> None:
        """A stage of `WORK` begins, the one before it is over."""
        if self._text:
            self._done += WORK[self._stage]
        self._stage, self._text = stage, text
        self._main = stage if stage in ORDER else self._main
        self._looks += stage == "screen"
        self._show(text)
        self._part(0.0)

    def say(self, text: str) -> None:
        """Something that was found on the way."""
        self._show(text)

    def counted(self, results: Iterable[T], tasks: Sequence[object]) -> Iterator[T]:
        """The results of a stage's tasks, each told when it comes."""
        for number, result in enumerate(results, start=1):
            self._part(number / len(tasks))
            yield result

    def _part(self, share: float) -> None:
        done = self._done + share * WORK[self._stage]
        ahead = (1.0 - share) * WORK[self._stage] + self._ahead()
        self._share = max(self._share, done / (done + ahead))
        self._show(self._text, self._share)

    def _ahead(self) -> float:
        """Work of the stages that are expected after the present one."""
        later = ORDER[ORDER.index(self._main) + 1 :]
        looks = 0 if "settle" not in later else max(LOOKS - max(self._looks, 1), 0)
        return sum(WORK[each] for each in later) + looks * sum(WORK[each] for each in LOOK)
