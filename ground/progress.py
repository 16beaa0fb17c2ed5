"""How long work tells how far it is: whoever shows it, a terminal, a file or nobody."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol


class Show(Protocol):
    """Told what goes on, and where it is known which share of the whole is done: 0 to 1 unless agreed otherwise."""

    def __call__(self, text: str, done: float | None = None, /) -> None: ...


def nobody(text: str, done: float | None = None, /) -> None:
    """Tells nobody."""


def part_of(show: Show, start: float, end: float) -> Show:
    """Progress of one part of a work: its own 0 to 1 lies between two shares of the whole."""

    def shown(text: str, done: float | None = None, /) -> None:
        show(text, None if done is None else start + done * (end - start))

    return shown


def steps_of(tell: Callable[[str], None]) -> Show:
    """Progress for one who wants the steps only, not how far each is."""

    def shown(text: str, done: float | None = None, /) -> None:
        if done is None:
            tell(text)

    return shown
