"""The sidecar of a recording: what is known about a run, as checked YAML.

Every refusal names file, line, column and key. Numbers are SI and finite; nothing is converted but whole
numbers to floats.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

import yaml

from ground.recordings.model import Event, Recording, RecordingError, SensorSpec, is_name
from hal.config import StrictLoader, to_yaml

FORMAT = 1
_KEYS = ("format", "run", "rig", "kind", "sensors", "conditions", "events", "state", "notes")
_REQUIRED = _KEYS[:4]
_SENSOR_KEYS = ("noise_std", "resolution", "range")
_TEXT_CONDITIONS = ("surface", "place")
_WHOLE_CONDITIONS = {"foot": 4, "hop_index": 1_000_000}  # largest value; the smallest is 0
_FLOAT_CONDITIONS = ("tilt_deg", "gravity_m_s2", "temperature_c")
_CONDITIONS = (*_TEXT_CONDITIONS, *_WHOLE_CONDITIONS, *_FLOAT_CONDITIONS)

Key = tuple[str | int, ...]


@dataclass(frozen=True)
class Sidecar:
    """The content of a sidecar; fields as in `Recording`."""

    run: str
    rig: str
    kind: str
    sensors: dict[str, SensorSpec] = field(default_factory=dict)
    conditions: dict[str, float | str] = field(default_factory=dict)
    events: tuple[Event, ...] = ()
    state: dict[str, float] = field(default_factory=dict)
    notes: str = ""


def read_sidecar(path: Path) -> Sidecar:
    """Read and check `NAME.yaml`. Raises `RecordingError` as `file:line:column: ...`."""
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise RecordingError(f"{path}: the sidecar cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        raise RecordingError(f"{path}:{line}:1: is not UTF-8 text (byte {error.start})") from error
    return parse_sidecar(text, str(path))


def parse_sidecar(text: str, source: str) -> Sidecar:
    """Check the text of a sidecar; `source` names its origin in errors."""
    data, marks = _load(text, source)
    return check_sidecar(data, source, marks)


def check_sidecar(data: Any, source: str, marks: Mapping[Key, tuple[int, int]] | None = None) -> Sidecar:
    """Check a sidecar that is read already; `marks` give line and column of each key, for the errors."""
    checker = _Checker(source, marks or {})
    if not isinstance(data, dict):
        where = f"{source}:1:1" if marks is not None else source
        raise RecordingError(f"{where}: the sidecar must be a mapping with the keys {', '.join(_KEYS)}")
    checker.keys(data, (), _KEYS, _REQUIRED)
    if data["format"] != FORMAT or isinstance(data["format"], bool | float):
        checker.refuse(("format",), f"is {data['format']!r}; this reader knows format {FORMAT}")
    if not is_name(checker.text(data["kind"], ("kind",))):
        checker.refuse(("kind",), f"is {data['kind']!r}; a kind is a name such as drive, hop, axis or drop")
    return Sidecar(
        run=checker.text(data["run"], ("run",)),
        rig=checker.text(data["rig"], ("rig",)),
        kind=data["kind"],
        sensors=checker.sensors(data.get("sensors", {})),
        conditions=checker.conditions(data.get("conditions", {})),
        events=checker.events(data.get("events", [])),
        state=checker.state(data.get("state", {})),
        notes=checker.text(data.get("notes", ""), ("notes",), may_be_empty=True),
    )


def _load(text: str, source: str) -> tuple[Any, dict[Key, tuple[int, int]]]:
    """The parsed YAML, and line and column (from 1) of each key and list entry."""
    try:
        loader = StrictLoader(text)
        node = loader.get_single_node()
        if node is None:
            raise RecordingError(f"{source}:1:1: the sidecar is empty")
        data = loader.construct_document(node)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        where = f":{mark.line + 1}:{mark.column + 1}" if mark else ""
        raise RecordingError(f"{source}{where}: {error.problem or 'is no valid YAML'}") from error
    except RecordingError:
        raise
    except (yaml.YAMLError, ValueError, TypeError, RecursionError) as error:
        # what the YAML library lets through: control characters, dates that are none, keys that are lists
        raise RecordingError(f"{source}: is no valid YAML ({str(error).splitlines()[0]})") from error
    marks: dict[Key, tuple[int, int]] = {}
    _mark(node, (), marks)
    return data, marks


def _mark(node: yaml.Node, key: Key, marks: dict[Key, tuple[int, int]]) -> None:
    if len(key) > 3:  # a sidecar is no deeper; an alias that holds itself would be
        return
    children: Iterable[tuple[str | int, yaml.Node, yaml.Node]] = ()
    if isinstance(node, yaml.MappingNode):
        children = ((str(name.value), name, value) for name, value in node.value)
    elif isinstance(node, yaml.SequenceNode):
        children = ((index, value, value) for index, value in enumerate(node.value))
    for name, place, value in children:
        marks[(*key, name)] = (place.start_mark.line + 1, place.start_mark.column + 1)
        _mark(value, (*key, name), marks)


class _Checker:
    """Checks values, and refuses with their place."""

    def __init__(self, source: str, marks: Mapping[Key, tuple[int, int]]) -> None:
        self._source = source
        self._marks = marks

    def refuse(self, key: Key, says: str) -> NoReturn:
        where = ""
        if self._marks:
            known = (key[:n] for n in range(len(key), 0, -1) if key[:n] in self._marks)
            line, column = self._marks.get(next(known, ()), (1, 1))
            where = f":{line}:{column}"
        raise RecordingError(f"{self._source}{where}: key {'.'.join(str(part) for part in key)} {says}")

    def keys(self, data: Mapping[Any, Any], key: Key, known: Iterable[str], required: Iterable[str]) -> None:
        for name in data:
            if name not in known:
                self.refuse((*key, str(name)), f"is not known; known here: {', '.join(known)}")
        for name in required:
            if name not in data:
                self.refuse((*key, name), "is missing")

    def mapping(self, value: Any, key: Key) -> dict[str, Any]:
        if not isinstance(value, dict):
            self.refuse(key, f"must be a mapping, not {value!r}")
        for name in value:
            if not isinstance(name, str):
                self.refuse((*key, str(name)), "must be text")
        return value

    def text(self, value: Any, key: Key, may_be_empty: bool = False) -> str:
        if not isinstance(value, str):
            self.refuse(key, f"must be text, not {value!r} ({type(value).__name__})")
        if not value.strip() and not may_be_empty:
            self.refuse(key, "is empty")
        return value

    def number(self, value: Any, key: Key, low: float = -math.inf) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            self.refuse(key, f"must be a number, not {value!r}")
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            self.refuse(key, f"must be finite, not {number!r}")
        if number < low:
            self.refuse(key, f"is {value!r}, below its limit {low:g}")
        return number

    def sensors(self, value: Any) -> dict[str, SensorSpec]:
        specs = {}
        for channel, entry in self.mapping(value, ("sensors",)).items():
            key = ("sensors", channel)
            self.keys(self.mapping(entry, key), key, _SENSOR_KEYS, ())
            noise, step = (
                self.number(entry[name], (*key, name), low=0.0) if name in entry else None
                for name in ("noise_std", "resolution")
            )
            limits = self.limits(entry["range"], (*key, "range")) if "range" in entry else None
            specs[channel] = SensorSpec(noise, step, limits)
        return specs

    def limits(self, value: Any, key: Key) -> tuple[float, float]:
        if not isinstance(value, list) or len(value) != 2:
            self.refuse(key, f"must be a list [low, high], not {value!r}")
        low, high = self.number(value[0], (*key, 0)), self.number(value[1], (*key, 1))
        if not low < high:
            self.refuse(key, f"is {value!r}; the low end must be below the high end")
        return low, high

    def conditions(self, value: Any) -> dict[str, float | str]:
        return {
            name: self.condition(name, entry, ("conditions", name))
            for name, entry in self.mapping(value, ("conditions",)).items()
        }

    def condition(self, name: str, value: Any, key: Key) -> float | str:
        if name in _TEXT_CONDITIONS:
            return self.text(value, key)
        if name in _WHOLE_CONDITIONS:
            if isinstance(value, bool) or not isinstance(value, int):
                self.refuse(key, f"must be a whole number, not {value!r}")
            if not 0 <= value <= _WHOLE_CONDITIONS[name]:
                self.refuse(key, f"is {value!r}, outside [0, {_WHOLE_CONDITIONS[name]}]")
            return value
        if name not in _FLOAT_CONDITIONS:  # other rigs have other conditions, but a slip of the pen is none
            self.not_nearly(name, _CONDITIONS, key)
            if isinstance(value, str):
                return value
        return self.number(value, key)

    def not_nearly(self, name: str, known: Iterable[str], key: Key) -> None:
        meant = difflib.get_close_matches(name, known, n=1, cutoff=0.8)
        if meant:
            self.refuse(key, f"is not known; {meant[0]} is meant?")

    def events(self, value: Any) -> tuple[Event, ...]:
        if not isinstance(value, list):
            self.refuse(("events",), f"must be a list of {{name, time_s}}, not {value!r}")
        events = []
        for index, entry in enumerate(value):
            key = ("events", index)
            self.keys(self.mapping(entry, key), key, ("name", "time_s"), ("name", "time_s"))
            name = self.text(entry["name"], (*key, "name"))
            events.append(Event(name, self.number(entry["time_s"], (*key, "time_s"))))
        return tuple(events)

    def state(self, value: Any) -> dict[str, float]:
        known = self.mapping(value, ("state",))
        return {name: self.number(entry, ("state", name)) for name, entry in known.items()}


def format_sidecar(recording: Recording) -> str:
    """The sidecar of a recording as YAML text."""
    content: dict[str, Any] = {
        "format": FORMAT,
        "run": recording.run,
        "rig": recording.rig,
        "kind": recording.kind,
        "sensors": {channel: _plain_spec(spec) for channel, spec in recording.sensors.items()},
        "conditions": dict(recording.conditions),
        "events": [{"name": event.name, "time_s": event.time_s} for event in recording.events],
        "state": dict(recording.state),
        "notes": recording.notes,
    }
    kept = {key: value for key, value in content.items() if key in _REQUIRED or value}
    return to_yaml(kept)


def _plain_spec(spec: SensorSpec) -> dict[str, Any]:
    limits = list(spec.range) if spec.range is not None else None
    content = {"noise_std": spec.noise_std, "resolution": spec.resolution, "range": limits}
    return {key: value for key, value in content.items() if value is not None}
