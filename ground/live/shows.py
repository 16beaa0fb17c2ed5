"""What the console can show: a source of messages as they come, or a recording."""

from __future__ import annotations

import threading
from typing import Any

from flight.monitor_settings import Response
from flight.settings import FlightSettings
from flight.states import Phase
from ground.live.playback import Recorded
from ground.live.sources import ConsoleError, Source
from ground.live.view import View
from hal.dictionary import dictionary

POLL_S = 0.05
ASIDE = (Phase.DE_TENSION, Phase.SAFE_HOLD, Phase.SAFE)


def about(title: str, live: bool, settings: FlightSettings) -> dict[str, Any]:
    """What a page needs to know once: phases in their order, the gauges' limits, the dictionary's words."""
    over_force = settings.monitors["over_force"]
    return {
        "title": title,
        "live": live,
        "cycle": [str(phase) for phase in Phase if phase not in ASIDE],
        "aside": [str(phase) for phase in ASIDE],
        "limits": {
            "energy_j": settings.tension.max_energy_j,
            "force_n": over_force.above,
            "force_answer": str(Response(over_force.response)).replace("_", " "),
        },
        "words": {name: entry.text for name, entry in dictionary().events.items()},
    }


class LiveShow:
    """Takes the messages of a source in a thread of its own, and passes commands on. Close it with `close`."""

    def __init__(self, source: Source, settings: FlightSettings) -> None:
        self._source, self._settings = source, settings
        self._view, self._lock, self._ended = View(), threading.Lock(), threading.Event()
        self._thread = threading.Thread(target=self._pump, name="telemetry", daemon=True)
        self._thread.start()

    def about(self) -> dict[str, Any]:
        """What stays the same."""
        return about(self._source.title, True, self._settings)

    def content(self, query: dict[str, float]) -> dict[str, Any]:
        """The console's state now."""
        with self._lock:
            return {**self._view.content(query.get("after", -1.0)), "status": self._source.status()}

    def series(self, low_s: float, high_s: float) -> dict[str, Any]:
        """Nothing is recorded here."""
        return {}

    def command(self, name: str, arguments: dict[str, float]) -> None:
        """Send a signed command. Raises `ConsoleError` when it is unknown or cannot be sent."""
        if name not in dictionary().commands:
            raise ConsoleError(f"{name}: not sent: it is not in the dictionary")
        with self._lock:
            self._source.command(name, tuple(arguments.items()))

    def close(self) -> str:
        """Stop listening; returns what was kept, in words."""
        self._ended.set()
        self._thread.join()
        kept = self._source.close()
        self._take()
        return kept

    def _pump(self) -> None:
        while not self._ended.wait(POLL_S):
            self._take()

    def _take(self) -> None:
        with self._lock:
            for message in self._source.poll():
                self._view.take(message)


class RecordedShow:
    """A recording, shown as it stood at any of its times."""

    def __init__(self, recorded: Recorded) -> None:
        self._recorded = recorded

    def about(self) -> dict[str, Any]:
        """What stays the same, with the recording's first and last time."""
        fixed = about(self._recorded.title, False, self._recorded.settings)
        return {**fixed, "start_s": self._recorded.start_s, "end_s": self._recorded.end_s}

    def content(self, query: dict[str, float]) -> dict[str, Any]:
        """The console as it stood `at` a time."""
        view = self._recorded.at(query.get("at", self._recorded.start_s))
        damage = f"The log is cut: {self._recorded.damage}" if self._recorded.damage else ""
        return {**view.content(), "samples": [], "status": damage}

    def series(self, low_s: float, high_s: float) -> dict[str, Any]:
        """The recorded lines between two times."""
        return self._recorded.series(low_s, high_s)

    def command(self, name: str, arguments: dict[str, float]) -> None:
        """A recording cannot be commanded."""
        raise ConsoleError(f"{name}: not sent: this is a recording, there is no robot to command")
