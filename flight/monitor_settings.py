"""The rows of the fault table: what trips a monitor, and what follows."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Annotated

from flight.states import Phase
from hal.config import Limits
from hal.dictionary import dictionary

STARTING = frozenset({Phase.POWER_UP, Phase.SELF_TEST})
HOLDING = frozenset({Phase.READY, Phase.TENSIONING, Phase.HOLD, Phase.ARMED})
MOVING = frozenset({Phase.HOMING, Phase.LATCH_CHECK, Phase.TENSIONING, Phase.DE_TENSION})
STARTED = frozenset(Phase) - STARTING

GROUPS: dict[str, frozenset[Phase]] = {
    "all": frozenset(Phase) - {Phase.EVALUATE},  # the tick after an evaluation comes as late as that took
    # what relaxing answers must not end it: the robot would stop with its spring loaded
    "not_relaxing": frozenset(Phase) - {Phase.EVALUATE, Phase.DE_TENSION},
    "started": STARTED,
    "working": STARTED - {Phase.DE_TENSION, Phase.SAFE},
    "moving": MOVING,
    "holding": HOLDING,
    "standing": HOLDING | {Phase.HOMING, Phase.LATCH_CHECK, Phase.SAFE_HOLD},
    **{str(phase): frozenset({phase}) for phase in Phase},
}
"""What `watched_in` may name: groups of phases, and each phase."""


class Response(StrEnum):
    """What follows a fault."""

    RETRY = "retry"
    SAFE_HOLD = "safe_hold"
    DE_TENSION = "de_tension"
    POWER_OFF = "power_off"


MonitorLimit = tuple[str, float, float, frozenset[Phase]]
"""Name, low, high, phases: a quantity is beyond its limit when it is not within `low` to `high`; it counts in these
phases. A plain tuple is taken apart in a third of the time of a named one, at each tick for each monitor."""


@dataclass(frozen=True)
class MonitorSettings:
    """One row. Without a limit, a phase raises the fault by itself and only the response stands here."""

    response: str
    above: float | None = None
    below: float | None = None
    for_ticks: Annotated[int, Limits(1, 100_000)] = 1
    watched_in: tuple[str, ...] = ()
    retries: Annotated[int, Limits(0, 100)] = 0
    then: str = ""

    @property
    def measured(self) -> bool:
        """Whether a quantity is compared with a limit."""
        return self.above is not None or self.below is not None

    @cached_property
    def phases(self) -> frozenset[Phase]:
        """The phases in which it is watched."""
        return frozenset().union(*(GROUPS[name] for name in self.watched_in))

    def limit_of(self, name: str) -> MonitorLimit:
        """What is compared, under the monitor's name; of a row that measures."""
        if self.above is not None:
            return name, -math.inf, self.above, self.phases
        assert self.below is not None
        return name, self.below, math.inf, self.phases

    def problem(self) -> str:
        """What is wrong with the row, as 'key = value is no ...'; empty when nothing is."""
        responses = ", ".join(Response)
        if self.response not in set(Response):
            return f"response = {self.response!r} is none of {responses}"
        if (self.then != "") != (self.response == Response.RETRY):
            return f"then = {self.then!r}: a retry, and nothing else, needs what follows when it fails"
        last = [response for response in Response if response is not Response.RETRY]
        if self.then and self.then not in last:
            return f"then = {self.then!r} is none of {', '.join(last)}"
        if self.above is not None and self.below is not None:
            return f"above = {self.above:g}, below = {self.below:g}: only one of them can be the limit"
        if self.measured != bool(self.watched_in):
            return "a limit needs watched_in, and watched_in a limit"
        unknown = [name for name in self.watched_in if name not in GROUPS]
        if unknown:
            return f"watched_in = {unknown[0]!r} is no phase or group of phases: {', '.join(GROUPS)}"
        if self.response == Response.RETRY and not self.phases <= GROUPS["latch_check"]:
            return "response = 'retry' is possible in latch_check only"
        return ""


def monitors_problem(monitors: dict[str, MonitorSettings]) -> str:
    """What is wrong with a table, in words; empty when nothing is.

    It must have exactly the dictionary's monitors, with a limit for those that measure.
    """
    wanted = {name: entry.monitor for name, entry in dictionary().events.items() if entry.monitor}
    for name in sorted(wanted.keys() ^ monitors.keys()):
        return f"key monitors.{name} is missing" if name in wanted else f"unknown key monitors.{name}"
    for name, rule in monitors.items():
        if rule.problem():
            return f"monitors.{name}: {rule.problem()}"
        if rule.measured != (wanted[name] == "measured"):
            return f"monitors.{name}: {'needs' if wanted[name] == 'measured' else 'cannot have'} a limit"
    return ""
