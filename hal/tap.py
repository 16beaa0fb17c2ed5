"""A tap on a board: everything that passes between flight software and devices goes on record.

Each call is written to the log with its arguments and its result, or the error it raised, after the device
has acted and before the caller learns of it. Together with the settings this is all that can influence the
flight software, so a recorded mission can be flown again from its log (`hal.replay`).

A call is written to the topic of its device (the name of the field of `Board`) as
`{"method": ..., "arguments": {...}, "result": ...}`, or with `"error": {"types": [...], "message": ...}` in
place of the result. A property is a method without arguments; a reading is handed over as it is, which costs the tick
least, and goes on record as the mapping of its fields.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from hal.board import Board
from hal.calls import Answer, Call, ContractDevice, board_calls
from hal.log import LogSink, call_writer_of

NO_ARGUMENTS: Mapping[str, Any] = {}


def tap_board(board: Board, log: LogSink) -> Board:
    """A board that does what `board` does and writes every call to `log`.

    What cannot be recorded raises the log's error to the caller, after the device has acted.
    """
    recorder = _Recorder(log)
    devices: dict[str, Any] = {
        name: ContractDevice(calls, recorder.around(getattr(board, name)))
        for name, calls in board_calls().items()
    }
    return Board(name=board.name, simulated_time=board.simulated_time, **devices)


class _Recorder:
    """Writes calls to the log, dated by the last time that the clock gave out (it is not asked for more)."""

    def __init__(self, log: LogSink) -> None:
        self._log, self._write_call = log, call_writer_of(log)
        self._time_s = 0.0

    def around(self, device: Any) -> Callable[[Call], Answer]:
        """What lets `device` answer each of its calls and records it."""
        return partial(self._answering, device)

    def _answering(self, device: Any, call: Call) -> Answer:
        topic, method, of_clock, write = call.device, call.method, call.device == "clock", self._write_call
        member = partial(getattr, device, method) if call.is_property else getattr(device, method)

        def bare() -> Any:  # most calls
            try:
                result = member()
            except BaseException as error:  # an interrupt ends the flight too: it belongs on record
                self._write_failed(call, NO_ARGUMENTS, error)
                raise
            if of_clock:
                self._time_s = max(self._time_s, result)
            write(topic, self._time_s, method, NO_ARGUMENTS, result)
            return result

        def told(*positional: Any, **named: Any) -> Any:
            arguments = call.arguments(positional, named)
            try:
                result = member(**arguments)
            except BaseException as error:
                self._write_failed(call, arguments, error)
                raise
            if of_clock:
                self._time_s = max(self._time_s, arguments["time_s"])
            write(topic, self._time_s, method, arguments, result)
            return result

        return told if call.parameters else bare

    def _write_failed(self, call: Call, arguments: Mapping[str, Any], error: BaseException) -> None:
        told = {"method": call.method, "arguments": arguments, "error": describe_error(error)}
        self._log.write(call.device, self._time_s, told)


def describe_error(error: BaseException) -> dict[str, Any]:
    """Names of an error's classes, most special first, and its message."""
    types = [cls.__name__ for cls in type(error).__mro__ if cls not in (object, BaseException)]
    return {"types": types, "message": str(error)}
