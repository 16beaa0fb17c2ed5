"""Where the on-board software writes what it reads, decides and commands.

A sink takes messages by topic in one sequence; what it does with them (a file, a list, nothing) is its own
affair. It must not influence what it records: no sink may change, drop or reorder what it is handed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from hal.calls import to_plain
from hal.errors import HalError


class LogError(HalError, ValueError):
    """A message cannot be recorded, or a record cannot be read. The message says which and why."""


class LogSink(Protocol):
    """Takes the messages of one run, in the order in which they happened."""

    def write(self, topic: str, time_s: float, payload: Mapping[str, Any]) -> None:
        """Record one message.

        `time_s` is the board's clock. `payload` holds strings, booleans, finite numbers, None, and lists
        (tuples) and string-keyed mappings of these; floats are kept exactly. A value of it may also be a reading, or
        several, which go on record as the mapping of their fields (`hal.calls.to_plain`).
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


def tick_end_of(log: LogSink) -> Callable[[], None]:
    """What tells a sink that a tick is over, and time to write; for a sink that does not ask for it, nothing."""
    told: Callable[[], None] = getattr(log, "tick_done", _nothing)
    return told


CallWriter = Callable[[str, float, str, Mapping[str, Any], Any], None]
"""Records a call of a device: topic, time [s], method, arguments by name, result."""


def call_writer_of(log: LogSink) -> CallWriter:
    """What records calls of devices, several in each tick: the sink's own `write_call`, else `write` of the message.

    A sink that does not write at once may keep the parts of a call, and make a message of them when it does.
    """

    def write_call(topic: str, time_s: float, method: str, arguments: Mapping[str, Any], result: Any) -> None:
        log.write(topic, time_s, call_payload(method, arguments, result))

    own: CallWriter = getattr(log, "write_call", write_call)
    return own


def call_payload(method: str, arguments: Mapping[str, Any], result: Any) -> dict[str, Any]:
    """The message of a call that was answered."""
    return {"method": method, "arguments": arguments, "result": result}


def _nothing() -> None:
    """Tell nobody."""


class NullLog:
    """Records nothing."""

    def write(self, topic: str, time_s: float, payload: Mapping[str, Any]) -> None:
        """Forget the message."""


class MemoryLog:
    """Keeps the messages, in `messages`."""

    def __init__(self) -> None:
        self.messages: list[LogMessage] = []

    def write(self, topic: str, time_s: float, payload: Mapping[str, Any]) -> None:
        """Keep the message."""
        plain = {name: to_plain(value) for name, value in payload.items()}
        self.messages.append(LogMessage(len(self.messages), topic, time_s, plain))
