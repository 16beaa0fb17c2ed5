"""What the console shows, made from the robot's telemetry message by message.

The browser page and the terminal show the same `View`; it knows nothing of where the messages come from.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from flight.commands import refusals
from flight.states import Phase
from hal.dictionary import CommandEntry, dictionary
from hal.readings import GroundCommand

EVENTS_KEPT = 200
SAMPLES_KEPT = 3000  # ten minutes at five messages a second
DANGEROUS = (Phase.ARMED, Phase.FIRING)
PLOTTED = {
    "compression_m": "outputs.compression_m",
    "current_a": "motor_current.current_a",
    "lowest_m_s2": "accelerometer.lowest_m_s2",
    "highest_m_s2": "accelerometer.highest_m_s2",
}
"""What is plotted, by the channel that it comes from."""

HOP_KEYS = ("hop_index", "place", "verdict", "reasons", "energy_used_j", "height_m", "c3", "belief")


@dataclass(frozen=True)
class Told:
    """One telemetry message: when [s, the robot's clock; None: its own time is not known], topic, payload."""

    time_s: float | None
    topic: str
    payload: Mapping[str, Any]


@dataclass
class View:
    """The state of the console. `take` a message, `content` for the page."""

    time_s: float = 0.0
    phase: str = ""
    since_s: float = 0.0
    reason: str = ""
    hop_index: int = 0
    channels: dict[str, float | bool | None] = field(default_factory=dict)
    hops: list[Mapping[str, Any]] = field(default_factory=list)
    decisions: list[Mapping[str, Any]] = field(default_factory=list)
    events: deque[Mapping[str, Any]] = field(default_factory=lambda: deque(maxlen=EVENTS_KEPT))
    answers: deque[Mapping[str, Any]] = field(default_factory=lambda: deque(maxlen=20))
    samples: deque[tuple[float, ...]] = field(default_factory=lambda: deque(maxlen=SAMPLES_KEPT))

    def take(self, told: Told) -> None:
        """Bring the view up to date with one message. A topic that it does not show changes nothing."""
        payload = {**told.payload}
        time_s = payload.pop("time_s", told.time_s)
        if time_s is not None:
            self.time_s = max(self.time_s, float(time_s))
        shown = {"time_s": self.time_s, **payload}
        if told.topic == "channels":
            self._take_channels(payload)
        elif told.topic == "state":
            self._enter(str(payload["to"]), self.time_s)
            self.reason = str(payload.get("reason", ""))
            self.hop_index = int(payload.get("hop_index", self.hop_index))
        elif told.topic == "hop":
            self.hops.append(shown)
        elif told.topic == "acknowledgement":
            self.answers.append(shown)
            if payload.get("name") != "link" and payload.get("severity") != "info":
                self.events.append(shown)
        elif told.topic == "event":
            (self.decisions if payload.get("name") == "decision" else self.events).append(shown)

    def _take_channels(self, payload: Mapping[str, Any]) -> None:
        self._enter(str(payload["phase"]), self.time_s)
        self.hop_index = int(payload["hop_index"])
        self.channels = {name: payload.get(name) for name in dictionary().channels}
        values = [self.channels[channel] for channel in PLOTTED.values()]
        self.samples.append((self.time_s, *(float("nan") if v is None else float(v) for v in values)))

    def _enter(self, phase: str, time_s: float) -> None:
        if phase != self.phase:
            self.phase, self.since_s = phase, time_s

    @property
    def armed(self) -> bool:
        """Whether the robot may let go at any moment."""
        return self.phase in DANGEROUS

    @property
    def loaded(self) -> bool:
        """Whether energy is stored, as far as is known; what is not known counts as stored."""
        return bool(self.channels.get("outputs.loaded", True))

    def content(self, after_s: float = -1.0) -> dict[str, Any]:
        """All of it as JSON-able data; of the samples those after `after_s`."""
        return {
            "time_s": self.time_s,
            "phase": self.phase,
            "in_phase_s": self.time_s - self.since_s,
            "reason": self.reason,
            "armed": self.armed,
            "loaded": self.loaded,
            "hop_index": self.hop_index,
            "channels": self.channels,
            "hops": [{key: hop.get(key) for key in HOP_KEYS} for hop in self.hops],
            "decisions": self.decisions[-20:],
            "events": list(self.events)[-60:],
            "answers": [{**answer, "words": answer_text(answer)} for answer in self.answers],
            "commands": command_list(self.phase),
            "samples": [_without_nan(row) for row in self.samples if row[0] > after_s],
        }


def _without_nan(row: tuple[float, ...]) -> list[float | None]:
    return [value if value == value else None for value in row]


def command_list(phase: str) -> list[dict[str, Any]]:
    """The dictionary's commands for buttons, each with what the dictionary has against it in this phase."""
    return [
        {
            "name": name,
            "text": entry.text,
            "arguments": {
                key: {"unit": value.unit, "low": value.low, "high": value.high}
                for key, value in entry.arguments.items()
            },
            "refusal": _refusal(name, entry, phase),
        }
        for name, entry in dictionary().commands.items()
        if name != "set_parameter"
    ]


def _refusal(name: str, entry: CommandEntry, phase: str) -> str:
    """Why the robot would refuse a command now, whatever its arguments; empty when it would not by the phase."""
    if phase not in set(Phase):
        return "the robot has not been heard yet"
    lowest = tuple((key, value.low) for key, value in entry.arguments.items())
    return "; ".join(refusals(entry, GroundCommand(0.0, name, lowest, authenticated=True), Phase(phase)))


def answer_text(answer: Mapping[str, Any]) -> str:
    """An acknowledgement in words."""
    why = answer.get("why") or ""
    reasons = why if isinstance(why, str) else "; ".join(str(each).replace("_", " ") for each in why)
    command = answer.get("command", "")
    if answer["name"] == "link":
        return f"{command}: refused by the link: {reasons}" if reasons else f"{command}: received"
    if answer["name"] == "command_refused":
        return f"{command}: refused in {answer.get('phase', '?')}: {reasons}"
    if answer["name"] == "parameter_set":
        return "set_parameter: done"
    return f"{command}: carried out"
