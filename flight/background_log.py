"""A log that never makes the tick wait: messages queue up for a thread of their own, which writes them.

They are handed over in batches, at the end of a tick: the thread writes while the flight software waits for the next
one, and waking it costs once a tick.

When the disc is full, or so slow that too many messages wait, the log gives up: `problem` says why, nothing more is
recorded (a log with a hole could not be replayed), and the fault table has the robot relax its spring and stop.
Where time is simulated a slow disc holds the flight up instead: how fast this machine is must not change a mission.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Mapping
from typing import Any

from flight.log import McapLog
from hal.log import call_payload

_END = None
LOOK_AGAIN_S = 0.01
"""How long a simulated flight waits for the log's thread before it looks whether there is one still."""

BATCH = 64
"""Messages that are handed over at the latest, should no tick end: several ticks' worth."""

Message = tuple[Any, ...]
"""Topic, time [s] and payload; or, of a call of a device, topic, time [s] and the parts of its payload."""


class BackgroundLog:
    """Hands messages to a `McapLog` in the order in which they came. Use as a context manager, or call `close`.

    At most `waiting_messages` wait; one more is a `problem`, or waits for its turn when time is simulated.
    """

    def __init__(self, log: McapLog, waiting_messages: int, *, simulated_time: bool = False) -> None:
        self._log = log
        self._queue: queue.SimpleQueue[list[Message] | None] = queue.SimpleQueue()
        self._batch: list[Message] = []
        self._handed = self._done = 0  # messages: the first is the flight's to count, the other the thread's
        self._spare = 0  # so many may still come until somebody looks again
        self._most, self._may_hold_up = waiting_messages, simulated_time
        self._room = threading.Event()
        self.problem = ""
        self._broken = False
        self._thread = threading.Thread(target=self._work, name="log", daemon=True)
        self._thread.start()

    def write(self, topic: str, time_s: float, payload: Mapping[str, Any]) -> None:
        """Queue one message; once there is a `problem`, it is dropped."""
        self._take(topic, time_s, payload)

    def _take(self, *message: Any) -> None:
        if not self._spare and not self._has_room():
            return
        self._spare -= 1
        self._batch.append(message)
        if len(self._batch) >= BATCH:
            self.tick_done()

    write_call = _take
    """Queue one call of a device (`hal.log.CallWriter`): its message is made when it is written."""

    def tick_done(self) -> None:
        """Let the thread write what has come since this was called last."""
        if self._batch:
            self._handed += len(self._batch)
            self._queue.put(self._batch)
            self._batch = []
            self._spare = 0

    @property
    def waiting(self) -> int:
        """Messages that wait to be written."""
        return self._handed + len(self._batch) - self._done

    def close(self) -> None:
        """Write what waits and complete the file. May be called again."""
        if self._thread.is_alive():
            self.tick_done()
            self._queue.put(_END)
            self._thread.join()

    def _has_room(self) -> bool:
        """Look, once a tick, whether messages may still come, and how many."""
        if self.problem:
            return False
        if self.waiting >= self._most and not self._waited_for_room():
            self.problem = f"{self._most} messages wait for a disc that is too slow"
            return False
        self._spare = max(1, self._most - self.waiting)
        return True

    def _waited_for_room(self) -> bool:
        self.tick_done()
        while self._may_hold_up and self._thread.is_alive() and self.waiting >= self._most:
            self._room.clear()
            self._room.wait(LOOK_AGAIN_S)
        return self._may_hold_up

    def _work(self) -> None:
        while (batch := self._queue.get()) is not _END:
            for message in batch:
                if (
                    not self._broken
                ):  # what waited for a slow disc is still written: there is no hole before it
                    self._try(self._write, *message)
                self._done += 1
                if not self._room.is_set():
                    self._room.set()
        self._try(self._log.close)

    def _write(self, topic: str, time_s: float, *said: Any) -> None:
        self._log.write(topic, time_s, said[0] if len(said) == 1 else call_payload(*said))

    def _try(self, act: Callable[..., None], *arguments: Any) -> None:
        try:
            act(*arguments)
        except (ValueError, OSError) as error:  # LogError is a ValueError
            self._broken = True
            self.problem = self.problem or str(error)

    def __enter__(self) -> BackgroundLog:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
