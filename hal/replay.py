"""A board made of a recording: it answers each call as the recorded board did.

Flight software that is a function of what it reads makes the same calls again, in the same order, and writes
the same decisions. Where it does not, the tape stops it at the first difference.
"""

from __future__ import annotations

import builtins
import contextlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import hal.errors
from hal.board import Board
from hal.calls import Answer, Call, ContractDevice, board_calls, from_plain
from hal.log import LogError, LogMessage


class ReplayMismatch(BaseException):
    """The software did something else than what is on record.

    Not an `Exception`, so that no handler for a fault of the robot takes it for one and flies on.
    """

    def __init__(self, sequence: int, expected: str, got: str) -> None:
        super().__init__(f"message {sequence}: expected {expected}, got {got}")
        self.sequence = sequence
        self.expected = expected
        self.got = got


class ReplayEnded(ReplayMismatch):
    """The software went on after the end of the record."""


class ReplayTape:
    """The messages of one run, consumed in order by calls of devices and by decisions.

    It is also the log sink of the replayed software. After the first difference it refuses everything.
    """

    def __init__(self, messages: Sequence[LogMessage]) -> None:
        self._messages = messages
        self.compared = 0
        self.mismatch: ReplayMismatch | None = None
        self.raised: BaseException | None = None  # the recorded error that was raised last

    @property
    def remaining(self) -> Sequence[LogMessage]:
        """The messages that were not asked for yet."""
        return self._messages[self.compared :]

    def answering(self, call: Call) -> Answer:
        """What answers a call from the tape."""
        return lambda *positional, **named: self.call(call, call.arguments(positional, named))

    def call(self, call: Call, arguments: Mapping[str, Any]) -> Any:
        """The recorded outcome of the next message, which must be this call with these arguments."""
        question = {"method": call.method, "arguments": arguments}

        def questioned(payload: Mapping[str, Any]) -> Mapping[str, Any]:
            return {key: payload[key] for key in ("method", "arguments") if key in payload}

        message = self._next(call.device, question, questioned)
        if "error" in message.payload:
            self.raised = _rebuild_error(message)
            raise self.raised
        try:
            return from_plain(call.returns, message.payload["result"])
        except (KeyError, TypeError, AttributeError) as error:
            raise LogError(
                f"message {message.sequence} ({message.topic}): its result does not fit the contract of "
                f"{call.device}.{call.method}"
            ) from error

    def write(self, topic: str, time_s: float, payload: Mapping[str, Any]) -> None:
        """Compare a decision, bit for bit, with the next message."""
        if topic in board_calls():
            raise LogError(f"{topic!r} is the topic of a device; a decision cannot use it")
        message = self._next(topic, payload, lambda recorded: recorded)
        if _text(time_s) != _text(message.time_s):
            self._stop(message.sequence, f"{topic} at {message.time_s!r} s", f"{topic} at {time_s!r} s")

    def _next(self, topic: str, payload: Mapping[str, Any], part: Callable[..., Any]) -> LogMessage:
        if self.mismatch is not None:
            raise self.mismatch
        got = f"{topic} {_text(payload)}"
        if self.compared >= len(self._messages):
            self.mismatch = ReplayEnded(self.compared, "the end of the record", got)
            raise self.mismatch
        message = self._messages[self.compared]
        expected = f"{message.topic} {_text(part(message.payload))}"
        if got != expected:
            self._stop(message.sequence, expected, got)
        self.compared += 1
        return message

    def _stop(self, sequence: int, expected: str, got: str) -> None:
        self.mismatch = ReplayMismatch(sequence, expected, got)
        raise self.mismatch


def _text(value: Any) -> str:
    """Text that is equal exactly when the values are equal to the bit (floats by their shortest repr)."""
    return json.dumps(value, sort_keys=True, default=_plain_mapping)


def _plain_mapping(value: Any) -> Any:
    if isinstance(value, Mapping):
        return dict(value)
    raise LogError(f"{value!r} ({type(value).__name__}) cannot be recorded")


def _rebuild_error(message: LogMessage) -> BaseException:
    """The recorded error, as the most special of its classes that the contracts or Python know."""
    described = message.payload["error"]
    for name in described["types"]:
        for home in (hal.errors, builtins):
            found = getattr(home, name, None)
            if isinstance(found, type) and issubclass(found, BaseException):
                with contextlib.suppress(TypeError):  # a class that wants more than a message
                    return found(described["message"])
    raise LogError(f"message {message.sequence} ({message.topic}): its error has no known class")


@dataclass(frozen=True)
class ReplayBoard(Board):
    """A board whose devices answer from a tape."""

    tape: ReplayTape

    @classmethod
    def of(cls, messages: Sequence[LogMessage], name: str = "replay") -> ReplayBoard:
        """The board that answers from these messages; `name` is what the software sees as its name."""
        tape = ReplayTape(messages)
        devices: dict[str, Any] = {
            device: ContractDevice(calls, tape.answering) for device, calls in board_calls().items()
        }
        return cls(name=name, tape=tape, **devices)
