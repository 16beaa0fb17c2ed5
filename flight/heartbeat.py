"""Shows that a long computation is alive, and only for as long as it may take."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field


class Stalled(Exception):
    """A computation took more steps than it was allowed."""


@dataclass
class Heartbeat:
    """Calls `stroke` at each step of a computation, at most `most` times.

    A computation that never ends therefore stops keeping the watchdog quiet: `beat` raises `Stalled`.
    """

    stroke: Callable[[], None] = lambda: None
    most: int = 5000
    beats: int = field(default=0, init=False)

    def beat(self) -> None:
        self.beats += 1
        if self.beats > self.most:
            raise Stalled(f"no end after {self.most} steps")
        self.stroke()
