"""A recording: what one run of a rig measured, and what is known about the run.

Whatever container a recording comes from, it is checked here: a `Recording` that exists is sound.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim_hal.plant.units import UnitError, channel_unit

Floats = NDArray[np.float64]

TIME_CHANNEL = "time_s"
_NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")


class RecordingError(ValueError):
    """A recording was refused. The message names file, line and column, or the key, and what is wrong."""


@dataclass(frozen=True, slots=True)
class SensorSpec:
    """What is known of a channel's sensor, in the channel's unit; None is unknown."""

    noise_std: float | None = None
    resolution: float | None = None
    range: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class Event:
    """Something the robot knows to have happened, on the recording's clock."""

    name: str
    time_s: float


@dataclass(frozen=True, eq=False)
class Table:
    """Channels that share sample times: `times_s` (n,) increasing; each channel (n,), NaN where missing."""

    times_s: Floats
    channels: Mapping[str, Floats]

    def __post_init__(self) -> None:
        """Own the arrays, and raise `RecordingError` unless they are sound."""
        object.__setattr__(self, "times_s", _owned(self.times_s))
        channels = {check_channel_name(name): _owned(values) for name, values in self.channels.items()}
        object.__setattr__(self, "channels", channels)
        if self.times_s.ndim != 1 or self.times_s.size == 0:
            raise RecordingError(f"{TIME_CHANNEL} must be a row of at least one time")
        if not channels:
            raise RecordingError("there is no channel beside the time")
        index = first_bad_time(self.times_s)
        if index is not None:
            raise RecordingError(f"sample {index}: {describe_bad_time(self.times_s, index)}")
        for name, values in channels.items():
            if values.shape != self.times_s.shape:
                raise RecordingError(f"channel {name!r} has {values.size} samples, not {self.times_s.size}")
            if np.isinf(values).any():
                raise RecordingError(f"channel {name!r}: sample {int(np.isinf(values).argmax())} is infinite")


@dataclass(frozen=True, eq=False)
class Recording(Table):
    """One run. Beside the main table, `extra_tables` hold what was sampled at other rates, by label.

    `conditions` and `state` are named as in the sidecar (SI, the unit in the name). `source` is the file
    that the recording was read from. `origin_s` is when the recording began that this one is a part of (None: it
    is a whole one): what grows since the start goes on growing in its parts. No file says it.
    """

    run: str = field(kw_only=True)
    rig: str = field(kw_only=True)
    kind: str = field(kw_only=True)
    sensors: Mapping[str, SensorSpec] = field(default_factory=dict, kw_only=True)
    conditions: Mapping[str, float | str] = field(default_factory=dict, kw_only=True)
    events: tuple[Event, ...] = field(default=(), kw_only=True)
    state: Mapping[str, float] = field(default_factory=dict, kw_only=True)
    notes: str = field(default="", kw_only=True)
    extra_tables: Mapping[str, Table] = field(default_factory=dict, kw_only=True)
    source: Path | None = field(default=None, kw_only=True)
    origin_s: float | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Check names and figures; see `Table`."""
        super().__post_init__()
        for key, text in (("run", self.run), ("rig", self.rig)):
            if not text.strip():
                raise RecordingError(f"{key} is empty")
        for name in (self.kind, *self.extra_tables):
            if not is_name(name):
                raise RecordingError(f"{name!r} is no name (lower-case letters, digits, underscores)")

    @property
    def began_s(self) -> float:
        """When the whole recording began, on its clock."""
        return float(self.times_s[0]) if self.origin_s is None else self.origin_s

    def event_time_s(self, name: str) -> float | None:
        """Time of the first event of this name, or None."""
        return min((event.time_s for event in self.events if event.name == name), default=None)

    def same_content(self, other: Recording) -> bool:
        """Whether both say the same, to the bit; where they were read from does not count."""
        keys = ("run", "rig", "kind", "sensors", "conditions", "events", "state", "notes")
        tables = dict(self.extra_tables), dict(other.extra_tables)
        return (
            all(repr(getattr(self, key)) == repr(getattr(other, key)) for key in keys)
            and same_table(self, other)
            and tables[0].keys() == tables[1].keys()
            and all(same_table(tables[0][label], tables[1][label]) for label in tables[0])
        )


def same_table(one: Table, other: Table) -> bool:
    """Whether two tables hold the same channels, in the same order, with the same bits."""
    return (
        list(one.channels) == list(other.channels)
        and _same_bits(one.times_s, other.times_s)
        and all(_same_bits(values, other.channels[name]) for name, values in one.channels.items())
    )


def _same_bits(one: Floats, other: Floats) -> bool:
    return (
        np.array_equal(one, other, equal_nan=True)
        and np.signbit(one[one == 0]).tolist() == np.signbit(other[other == 0]).tolist()
    )


def _owned(values: Floats) -> Floats:
    """A read-only copy, so that no one's recording changes under another's hands."""
    copy = np.array(values, dtype=np.float64)
    copy.setflags(write=False)
    return copy


def is_name(text: str) -> bool:
    """Whether `text` can name a kind, a table or a channel."""
    return _NAME.fullmatch(text) is not None


def check_channel_name(name: str) -> str:
    """Return `name`, or raise `RecordingError` unless its last part is a known unit."""
    if not is_name(name):
        raise RecordingError(f"channel {name!r}: a name is lower-case letters, digits and underscores")
    if name == TIME_CHANNEL:
        raise RecordingError(f"channel {name!r} stands twice: the first column is the time already")
    try:
        channel_unit(name)
    except UnitError as error:
        raise RecordingError(str(error)) from error
    return name


def first_bad_time(times_s: Floats) -> int | None:
    """Index of the first time that is not finite or not after the one before it; None if there is none."""
    bad = ~np.isfinite(times_s)
    bad[1:] |= ~(np.diff(times_s) > 0.0)
    return int(bad.argmax()) if bad.any() else None


def describe_bad_time(times_s: Floats, index: int) -> str:
    """What is wrong with the time at `index`."""
    time_s = float(times_s[index])
    if not math.isfinite(time_s):
        return f"the time is {'missing' if math.isnan(time_s) else 'infinite'}"
    before_s = float(times_s[index - 1])
    verb = "stands still at" if time_s == before_s else f"goes back from {before_s!r} s to"
    return f"time {verb} {time_s!r} s"
