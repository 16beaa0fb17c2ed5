"""Where the on-board software writes what it reads, decides and commands.

A sink takes messages by topic in one sequence; what it does with them (a file, a list, nothing) is its own
affair. It must not influence what it records: no sink may change, drop or reorder what it is handed.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol


class LogSink(Protocol):
    """Takes the messages of one run, in the order in which they happened."""

    def write(self, topic: str, time_s: float, payload: Mapping[str, Any]) -> None:
        """Record one message.

        `time_s` is the board's clock. `payload` holds strings, booleans, finite numbers, None, and lists
        (tuples) and string-keyed mappings of these; floats are kept exactly.
        """


class NullLog:
    """Records nothing."""

    def write(self, topic: str, time_s: float, payload: Mapping[str, Any]) -> None:
        """Forget the message."""
