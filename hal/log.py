"""Where the on-board software writes what it reads, decides and commands.

A sink takes messages by topic in one sequence; what it does with them (a file, a list, nothing) is its own
affair. It must not influence what it records: no sink may change, drop or reorder what it is handed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from hal.errors import HalError


class LogError(HalError, ValueError):
    """A message cannot be recorded, or a record cannot be read. The message says which and why."""


class LogSink(Protocol):
    """Takes the messages of one run, in the order in which they happened."""

    def write(self, topic: str, time_s: float, payload: Mapping[str, Any]) -> None:
        """Record one message.

        `time_s` is the board's clock. `payload` holds strings, booleans, finite numbers, None, and lists
        (tuples) and string-keyed mappings of these; floats are kept exactly.
        """


@dataclass(frozen=True, slots=True)
class LogMessage:
    """One recorded message; `sequence` counts the messages of a log from 0."""

    sequence: int
    topic: str
    time_s: float
    payload: Mapping[str, Any]


def log_problem(log: LogSink) -> str:
    """Why a sink no longer records, in words; empty while it does (and for sinks that cannot fail silently)."""
    return str(getattr(log, "problem", ""))


class NullLog:
    """Records nothing."""

    def write(self, topic: str, time_s: float, payload: Mapping[str, Any]) -> None:
        """Forget the message."""


class MemoryLog:
    """Keeps the messages as they are handed over, in `messages`."""

    def __init__(self) -> None:
        self.messages: list[LogMessage] = []

    def write(self, topic: str, time_s: float, payload: Mapping[str, Any]) -> None:
        """Keep the message."""
        self.messages.append(LogMessage(len(self.messages), topic, time_s, payload))
