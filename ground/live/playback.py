"""A flight log as the console shows it: what the ground was told, and the readings behind it."""

from __future__ import annotations

import bisect
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flight.executive import ACKNOWLEDGEMENTS
from flight.log import METADATA_NAME, FlightLog, parts_of
from flight.mcap_stream import TIME_FIELD, decode_json, read_mcap
from flight.settings import FlightSettings
from ground.live.view import Told, View
from ground.progress import Show, nobody, part_of
from ground.recordings.log_channels import Series
from ground.recordings.model import Floats
from ground.report.compact import thin_indices
from hal.log import LogError

POINTS = 2000
"""Points of a plotted line: of each bucket of samples the lowest and the highest are kept."""
READ = {
    "motor_current": ("current_a", "time_s", "current_a"),
    "spring": ("compression_m", "times_s", "compression_m"),
    "accelerometer": ("force_m_s2", "times_s", "specific_force_m_s2"),
}
"""Device: plotted line, key of the times, key of the values."""
PROGRESS_EVERY = 100_000


@dataclass(frozen=True)
class Recorded:
    """The telemetry of a log in order, and its readings by plotted line. Commands cannot be sent to it."""

    path: Path
    told: tuple[Told, ...]
    lines: Mapping[str, tuple[Floats, Floats]]
    settings: FlightSettings
    damage: str = ""

    @property
    def title(self) -> str:
        """What is played back."""
        return f"playback of {self.path}"

    @property
    def start_s(self) -> float:
        """Time of the first message."""
        return self.told[0].time_s or 0.0

    @property
    def end_s(self) -> float:
        """Time of the last message."""
        return self.told[-1].time_s or 0.0

    def at(self, time_s: float) -> View:
        """The console as it stood at a time."""
        view = View()
        count = bisect.bisect_right(self.told, time_s, key=lambda told: told.time_s or 0.0)
        for told in self.told[:count]:
            view.take(told)
        view.time_s = max(view.time_s, min(time_s, self.end_s))
        return view

    def series(self, low_s: float, high_s: float) -> dict[str, dict[str, list[float]]]:
        """The plotted lines between two times, each thinned to about `POINTS` without losing an extreme."""
        found = {}
        for name, (times_s, values) in self.lines.items():
            first, last = np.searchsorted(times_s, [low_s, high_s])
            thin_t, thin_v = thinned(times_s[first:last], values[first:last])
            found[name] = {"t": thin_t.tolist(), "v": thin_v.tolist()}
        return found


def thinned(times_s: Floats, values: Floats, points: int = POINTS) -> tuple[Floats, Floats]:
    """At most about `points` samples: the lowest and the highest of each bucket, in their order."""
    keep = thin_indices(values, points)
    return times_s[keep], values[keep]


def read_recorded(path: Path, recover: bool = False, show: Show = nobody) -> Recorded:
    """Read a flight log for playback; `show` is told how far it is. Raises `LogError` when it holds no telemetry."""
    told: list[Told] = []
    series = {line: Series() for line, _, _ in READ.values()}
    metadata: Mapping[str, str] = {}
    damage = ""
    parts = parts_of(path)
    for number, part in enumerate(parts):
        reading = part_of(show, number / len(parts), (number + 1) / len(parts))
        reading(f"reading {part}", 0.0)
        content = read_mcap(part, recover)
        metadata, damage = metadata or content.metadata.get(METADATA_NAME, {}), content.damage
        for index, (topic, _, _, data) in enumerate(content.messages):
            if index % PROGRESS_EVERY == 0:
                reading(f"reading {part}", 0.3 + 0.7 * index / len(content.messages))
            if topic in ("state", "hop", "event") or (topic == "ground_link" and b'"channels"' in data):
                told.append(_told(topic, decode_json(data)))
            elif topic in READ and b'"read"' in data:
                _take_reading(decode_json(data), *READ[topic][1:], series[READ[topic][0]])
        if damage:
            break
    if not told:
        raise LogError(f"{path}: holds no state, event or telemetry, so there is nothing to play back")
    lines = {name: (np.array(each.times_s), np.array(each.values)) for name, each in series.items()}
    settings = FlightLog(path, metadata, (), "").part("settings", FlightSettings)
    return Recorded(path, tuple(told), lines, settings, damage)


def _told(topic: str, message: dict[str, Any]) -> Told:
    """The message as the ground was sent it."""
    time_s = message.pop(TIME_FIELD)
    if topic == "ground_link":
        arguments = message["arguments"]
        return Told(time_s, arguments["topic"], json.loads(arguments["payload"]))
    return Told(time_s, "acknowledgement" if message.get("name") in ACKNOWLEDGEMENTS else topic, message)


def _take_reading(message: Mapping[str, Any], times: str, values: str, series: Series) -> None:
    result = message.get("result")
    if not isinstance(result, dict):
        return
    if isinstance(result[times], list):
        for time_s, value in zip(result[times], result[values], strict=True):
            series.add(time_s, value)
    else:
        series.add(result[times], result[values])
