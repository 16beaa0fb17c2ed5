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

from collections.abc import Callable
from functools import partial
from typing import Any

from hal.board import Board
from hal.calls import Answer, Call, ContractDevice, board_calls
from hal.log import LogSink


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
        self._log = log
        self._time_s = 0.0

    def around(self, device: Any) -> Callable[[Call], Answer]:
        """What lets `device` answer each of its calls and records it."""
        return partial(self._answering, device)

    def _answering(self, device: Any, call: Call) -> Answer:
        topic, method, is_property, of_clock, write = (
            call.device,
            call.method,
            call.is_property,
            call.device == "clock",
            self._log.write,
        )

        def answer(arguments: dict[str, Any]) -> Any:
            try:
                member = getattr(device, method)
                result = member if is_property else member(**arguments)
            except BaseException as error:  # an interrupt ends the flight too: it belongs on record
                told = {"method": method, "arguments": arguments, "error": describe_error(error)}
                write(topic, self._time_s, told)
                raise
            if of_clock:
                self._time_s = max(self._time_s, result if result is not None else arguments["time_s"])
            write(topic, self._time_s, {"method": method, "arguments": arguments, "result": result})
            return result

        return answer


def describe_error(error: BaseException) -> dict[str, Any]:
    """Names of an error's classes, most special first, and its message."""
    types = [cls.__name__ for cls in type(error).__mro__ if cls not in (object, BaseException)]
    return {"types": types, "message": str(error)}
