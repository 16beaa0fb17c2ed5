"""What a flight log says about the rig, as series of samples, and where its hops are.

Reads the messages as `hal.tap` and the executive write them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ground.recordings.model import Floats, RecordingError, Table
from hal.log import LogMessage

POLLED = {"motor_current": ("motor_current_a", "current_a"), "nut_encoder": ("nut_position_m", "position_m")}
STREAMED = {
    "spring": ("spring_compression_m", "compression_m"),
    "accelerometer": ("body_acceleration_m_s2", "specific_force_m_s2"),
    "magnet_current": ("magnet_current_a", "current_a"),
}
VOLTAGE = "motor_voltage_v"
SAME_INSTANT_DECIMALS = 9  # times that agree to a nanosecond are one instant


@dataclass
class Series:
    """Samples in the order of the log, each instant once."""

    times_s: list[float] = field(default_factory=list)
    values: list[float] = field(default_factory=list)

    def add(self, time_s: float, value: float) -> None:
        """Append a sample, unless it is the last one read again."""
        if not self.times_s or time_s > self.times_s[-1]:
            self.times_s.append(time_s)
            self.values.append(value)

    def replace_or_add(self, time_s: float, value: float) -> None:
        """Append a command; of two at one instant the later counts."""
        if self.times_s and time_s <= self.times_s[-1]:
            self.values[-1] = value
        else:
            self.add(time_s, value)

    def between(self, start_s: float, end_s: float) -> tuple[Floats, Floats]:
        """Times and values (n,) from `start_s` to `end_s`, both included."""
        times_s = np.array(self.times_s)
        keep = (times_s >= start_s) & (times_s <= end_s)
        return times_s[keep], np.array(self.values)[keep]


@dataclass(frozen=True)
class Stretch:
    """Times at which a hop's phases began; `end_s` is when it was over, `touchdown_s` None if unknown.

    The magnet was on from `fire_s` to `magnet_off_s`.
    """

    latch_check_s: float
    tensioning_s: float
    armed_s: float
    fire_s: float
    magnet_off_s: float
    end_s: float
    touchdown_s: float | None


@dataclass(frozen=True)
class Channels:
    """All series of a log by channel, and its hops."""

    series: Mapping[str, Series]
    hops: tuple[Stretch, ...]

    def between(self, channel: str, start_s: float, end_s: float) -> tuple[Floats, Floats]:
        """Times and values of one channel. Raises `RecordingError` when there are none."""
        times_s, values = self.series[channel].between(start_s, end_s)
        if times_s.size == 0:
            raise RecordingError(f"the log has no {channel} from {start_s:.3f} s to {end_s:.3f} s")
        return times_s, values

    def held(self, channel: str, start_s: float, end_s: float) -> tuple[Floats, Floats]:
        """Like `between` for a command, beginning with the one that was in force at `start_s`."""
        before = self.between(channel, 0.0, start_s)[1]
        times_s, values = self.series[channel].between(np.nextafter(start_s, np.inf), end_s)
        return np.append(start_s, times_s), np.append(before[-1:], values)


def gather(messages: Iterable[LogMessage]) -> Channels:
    """Collect series and hops from the messages of a log."""
    names = [VOLTAGE, *(name for name, _ in (*POLLED.values(), *STREAMED.values()))]
    series = {name: Series() for name in names}
    phases: list[tuple[float, str]] = []
    magnet: list[tuple[float, bool]] = []
    touchdowns_s: dict[float, float | None] = {}
    last_s = 0.0
    for message in messages:
        payload, last_s = message.payload, message.time_s
        if message.topic == "state":
            phases.append((message.time_s, str(payload["to"])))
        elif message.topic == "hop":
            touchdowns_s[payload["fire_s"]] = payload["touchdown_s"]
        elif "error" not in payload:
            _take_call(message, series, magnet)
    return Channels(series, tuple(_hops(phases, magnet, touchdowns_s, last_s)))


def _take_call(message: LogMessage, series: Mapping[str, Series], magnet: list[tuple[float, bool]]) -> None:
    topic, payload = message.topic, message.payload
    method, result = payload.get("method"), payload.get("result")
    if topic == "motor" and method == "set_voltage_v":
        series[VOLTAGE].replace_or_add(message.time_s, payload["arguments"]["voltage_v"])
    elif topic == "magnet" and method in ("switch_on", "switch_off"):
        magnet.append((message.time_s, method == "switch_on"))
    elif method == "read" and topic in POLLED:
        channel, key = POLLED[topic]
        series[channel].add(_of(result)["time_s"], _of(result)[key])
    elif method == "read" and topic in STREAMED:
        channel, key = STREAMED[topic]
        for time_s, value in zip(_of(result)["times_s"], _of(result)[key], strict=True):
            series[channel].add(time_s, value)


def _of(result: Any) -> Mapping[str, Any]:
    if not isinstance(result, Mapping):
        raise RecordingError(f"a reading of the log is {result!r}, no mapping")
    return result


def _hops(
    phases: list[tuple[float, str]],
    magnet: list[tuple[float, bool]],
    touchdowns_s: Mapping[float, float | None],
    last_s: float,
) -> Iterable[Stretch]:
    """One stretch for each time that the robot left the ground."""
    began: dict[str, float] = {}
    for index, (time_s, phase) in enumerate(phases):
        if phase == "armed" and "armed" in began:
            continue  # armed again after the window had passed: the first time ended the tensioning
        began[phase] = time_s
        if phase == "tensioning":
            began.pop("armed", None)
        if phase != "flight" or not {"latch_check", "tensioning", "armed", "firing"} <= began.keys():
            continue
        fire_s = max(switched_s for switched_s, on in magnet if on and switched_s <= time_s)
        off_s = min(
            (switched_s for switched_s, on in magnet if not on and switched_s > fire_s), default=last_s
        )
        end_s = phases[index + 1][0] if index + 1 < len(phases) else last_s
        yield Stretch(
            began["latch_check"],
            began["tensioning"],
            began["armed"],
            fire_s,
            off_s,
            end_s,
            touchdowns_s.get(fire_s),
        )


def table_of(samples: Mapping[str, tuple[Floats, Floats]], start_s: float, held: str | None = None) -> Table:
    """The channels on the union of their instants, counted from `start_s`; `held` keeps its value between."""
    instants = {
        name: np.round(times_s - start_s, SAME_INSTANT_DECIMALS) for name, (times_s, _) in samples.items()
    }
    times_s = np.unique(np.concatenate(list(instants.values())))
    columns: dict[str, Floats] = {}
    for name, (_, values) in samples.items():
        if name == held:
            columns[name] = values[np.searchsorted(instants[name], times_s, side="right") - 1]
        else:
            columns[name] = np.full(times_s.size, np.nan)
            columns[name][np.searchsorted(times_s, instants[name])] = values
    return Table(times_s, columns)
