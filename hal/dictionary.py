"""The dictionary: every command, event, telemetry channel and parameter by name (`config/dictionary.yaml`).

Flight software, ground tools, documentation and the link all read this one file. Asking it for a name that it
does not hold raises `KeyError`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Annotated, Any

from hal.config import Limits, config_path, load_settings
from hal.errors import ConfigError

SEVERITIES = ("info", "warning", "fault")
CHANGEABLE = ("start", "standing")
Identifier = Annotated[int, Limits(1, 65535)]


@dataclass(frozen=True)
class Range:
    """A number's unit (`1`: none, `bool`: 0 or 1) and its smallest and largest allowed value."""

    unit: str
    low: float
    high: float

    def refusal(self, value: float) -> str:
        """Why a value is refused, in words; empty when it is not. NaN is outside every range."""
        return "" if self.low <= value <= self.high else f"{value!r} is outside [{self.low:g}, {self.high:g}]"


@dataclass(frozen=True)
class CommandEntry:
    """A command: its number on the link, what it does, in which phases it is accepted, its arguments.

    `authenticated`: it is refused from a source that has not shown that it may command the robot.
    """

    id: Identifier
    text: str
    accepted_in: tuple[str, ...]
    authenticated: bool = True
    arguments: dict[str, Range] = field(default_factory=dict)


@dataclass(frozen=True)
class EventEntry:
    """An event. `monitor` marks a row of the fault table: `measured` against a limit, or `raised` by a phase."""

    id: Identifier
    severity: str
    text: str
    monitor: str = ""


@dataclass(frozen=True)
class ChannelEntry(Range):
    """A telemetry channel."""

    text: str = ""


@dataclass(frozen=True)
class ParameterEntry(Range):
    """A parameter of the flight software; its default is its value in `config/flight.yaml`.

    `type` is float or int. `changeable`: at the `start` only, or by command while the robot is `standing`.
    """

    type: str = "float"
    changeable: str = "start"

    def refusal(self, value: float) -> str:
        """Why a value is refused, in words; empty when it is not."""
        if self.type == "int" and not (math.isfinite(value) and value == math.floor(value)):
            return f"{value!r} is no whole number"
        return Range.refusal(self, value)


@dataclass(frozen=True)
class Dictionary:
    """All names."""

    commands: dict[str, CommandEntry]
    events: dict[str, EventEntry]
    topics: dict[str, Identifier]
    phases: dict[str, Identifier]
    channels: dict[str, ChannelEntry]
    parameters: dict[str, ParameterEntry]


def load_dictionary(path: Path | None = None) -> Dictionary:
    """Read and check a dictionary. Raises `ConfigError` naming file, key and value."""
    where = path or config_path("dictionary.yaml")
    found = load_settings(where, Dictionary)
    for problem in _problems(found):
        raise ConfigError(f"{where}: {problem}")
    return found


@cache
def dictionary() -> Dictionary:
    """The dictionary of this installation, read once."""
    return load_dictionary()


def _problems(found: Dictionary) -> list[str]:
    problems: list[str] = []
    kinds: dict[str, dict[str, Any]] = {"commands": found.commands, "events": found.events}
    for kind, entries in kinds.items():
        problems += _doubles(kind, {name: entry.id for name, entry in entries.items()})
    problems += _doubles("topics", found.topics) + _doubles("phases", found.phases)
    for name, event in found.events.items():
        if event.severity not in SEVERITIES:
            problems.append(f"events.{name}.severity = {event.severity!r} is none of {', '.join(SEVERITIES)}")
        if event.monitor not in ("", "measured", "raised"):
            problems.append(f"events.{name}.monitor = {event.monitor!r} is neither measured nor raised")
    ranges: dict[str, Range] = {f"channels.{name}": entry for name, entry in found.channels.items()}
    ranges |= {f"parameters.{name}": entry for name, entry in found.parameters.items()}
    for command, entry in found.commands.items():
        ranges |= {f"commands.{command}.arguments.{key}": value for key, value in entry.arguments.items()}
    problems += [
        f"{name}.low = {entry.low:g} is above its high"
        for name, entry in ranges.items()
        if entry.low > entry.high
    ]
    for name, parameter in found.parameters.items():
        if parameter.type not in ("float", "int") or parameter.changeable not in CHANGEABLE:
            problems.append(f"parameters.{name}: type or changeable is unknown")
    return problems


def _doubles(kind: str, ids: dict[str, int]) -> list[str]:
    seen: dict[int, str] = {}
    problems = []
    for name, number in ids.items():
        if number in seen:
            problems.append(f"{kind}.{name}.id = {number} is taken by {seen[number]}")
        seen[number] = name
    return problems
