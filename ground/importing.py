"""Recordings from foreign files: MATLAB files, tables of text and MCAP, by a mapping in YAML.

A mapping (examples in `config/imports/`) says where each channel comes from:

    format: 1
    time: {variable: t}                 # or {rate_hz: 1000.0, start_s: 0.0}
    channels:
      position_m: {variable: qm}
      force_n: {variable: vir, scale: 35.15065}        # value = scale · variable + offset
      gap_m: {variable: gap, unit: mm}                 # the value's unit, if it is not the channel's own
    sidecar: {rig: emps, kind: axis}    # as in recording-format; `run` is the file's name unless given

`variable` is a MATLAB variable, a column's header (its number, from 1, where `table.header` is false)
or a number of an MCAP's messages (`/TOPIC.FIELD`, their times `log_time`);
`index` picks, from 0, a cell and then a row of a MATLAB variable; `rows` keeps a stretch of the samples, `keep` the
longest stretch in which a channel stays small; `split` says how a file holds several recordings.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from ground.foreign_files import TableFormat, describe_text, read_variables
from ground.import_parts import Keep, Part, Rows, Split, kept, parts_of
from ground.recordings.model import Floats, Recording, RecordingError, describe_bad_time, first_bad_time
from ground.recordings.sidecar import FORMAT, check_sidecar
from hal.config import Limits, load_settings
from hal.errors import ConfigError
from sim_hal.plant.units import UnitError, channel_unit


@dataclass(frozen=True)
class ChannelSource:
    """Where a channel comes from: scale · variable + offset, in `unit` (None: the channel's own)."""

    variable: str
    scale: float = 1.0
    offset: float = 0.0
    unit: str | None = None
    index: tuple[Annotated[int, Limits(0)], ...] = ()
    nan_is_missing: bool = False


@dataclass(frozen=True)
class TimeSource:
    """Where the sample times come from: a variable (in seconds after scale and offset), or an even rate."""

    variable: str | None = None
    scale: float = 1.0
    offset: float = 0.0
    index: tuple[Annotated[int, Limits(0)], ...] = ()
    rate_hz: Annotated[float | None, Limits(1e-6, 1e9)] = None
    start_s: float = 0.0


@dataclass(frozen=True)
class ImportMapping:
    """How a foreign file becomes a recording."""

    format: Annotated[int, Limits(FORMAT, FORMAT)]
    time: TimeSource
    channels: dict[str, ChannelSource]
    sidecar: dict[str, Any]
    rows: Rows = field(default_factory=Rows)
    table: TableFormat = field(default_factory=TableFormat)
    split: Split = field(default_factory=Split)
    keep: Keep | None = None

    @property
    def variables(self) -> frozenset[str]:
        """The file's variables that are asked for."""
        named = {source.variable for source in self.channels.values()}
        return frozenset(named | ({self.time.variable} if self.time.variable else set()))


def import_recording(path: Path, mapping: Path) -> Recording:
    """Read the foreign file `path` (.mat; .mcap; .csv, .txt, .tsv, also with .gz) that holds one recording.

    Raises as `import_recordings`, and `RecordingError` where the mapping finds several.
    """
    found = import_recordings(path, mapping)
    if len(found) > 1:
        raise RecordingError(f"{path} by {mapping}: holds {len(found)} recordings; one is needed here")
    return found[0]


def import_recordings(path: Path, mapping: Path) -> tuple[Recording, ...]:
    """Read the recordings of the foreign file `path` as the file `mapping` says.

    Raises `RecordingError` for what the file or the sidecar lacks, `ConfigError` for a fault of the mapping;
    both name file and key.
    """
    plan = load_settings(mapping, ImportMapping)
    if not plan.channels:
        raise ConfigError(f"{mapping}: channels is empty")
    if (plan.time.variable is None) == (plan.time.rate_hz is None):
        raise ConfigError(f"{mapping}: time must have either variable or rate_hz")
    if plan.keep is not None and plan.keep.channel not in plan.channels:
        raise ConfigError(f"{mapping}: keep.channel = {plan.keep.channel!r} is none of the channels")
    check_sidecar({"format": FORMAT, "run": "checked", **plan.sidecar}, f"{mapping}: sidecar")
    parts = parts_of(path, mapping, read_variables(path, plan.table, plan.variables), plan.split, plan.rows)
    return tuple(_recording(path, mapping, plan, part) for part in parts)


def _recording(path: Path, mapping: Path, plan: ImportMapping, part: Part) -> Recording:
    """One recording of a file."""
    stem = path.name.partition(".")[0]
    content: dict[str, Any] = {"format": FORMAT, "run": stem, **plan.sidecar}
    content["run"] = f"{content['run']}{part.suffix}"
    content["conditions"] = {**content.get("conditions", {}), **part.conditions}
    sidecar = check_sidecar(content, f"{mapping}: sidecar")
    reader = _Reader(path, mapping, part.variables, part.rows)
    channels = {name: reader.channel(name, source) for name, source in plan.channels.items()}
    first = next(iter(channels))
    times_s = reader.times_s(plan.time, channels[first].size)
    for name, values in channels.items():
        if values.size != times_s.size:
            key = f"channels.{name}" if plan.time.variable else f"channels.{name} or channels.{first}"
            raise RecordingError(f"{path}: {key}: has {values.size} samples, the time {times_s.size}")
    if plan.keep is not None:
        use = kept(times_s, channels[plan.keep.channel], plan.keep, f"{path}: keep (in {mapping})")
        times_s, channels = times_s[use], {name: values[use] for name, values in channels.items()}
    try:
        return Recording(times_s, channels, **vars(sidecar), source=path)
    except RecordingError as error:
        raise RecordingError(f"{path} by {mapping}: {error}") from error


@dataclass(frozen=True)
class _Reader:
    """Takes variables of one file, as one mapping asks."""

    path: Path
    mapping: Path
    variables: Mapping[str, Any]
    rows: Rows

    def channel(self, name: str, source: ChannelSource) -> Floats:
        key = f"channels.{name}"
        values = source.scale * self._variable(key, source.variable, source.index) + source.offset
        if np.isnan(values).any() and not source.nan_is_missing:
            sample = int(np.isnan(values).argmax())
            says = "(nan_is_missing: true takes such samples as missing)"
            self._refuse(key, f"sample {sample} of {source.variable!r} is not a number {says}")
        return self._converted(key, name, values, source.unit)

    def times_s(self, source: TimeSource, samples: int) -> Floats:
        if source.variable is None:
            assert source.rate_hz is not None
            return source.start_s + np.arange(samples, dtype=np.float64) / source.rate_hz
        times_s = source.scale * self._variable("time", source.variable, source.index) + source.offset
        bad = first_bad_time(times_s)
        if bad is not None:
            self._refuse("time", f"sample {bad} of {source.variable!r}: {describe_bad_time(times_s, bad)}")
        return times_s

    def _variable(self, key: str, variable: str, index: tuple[int, ...]) -> Floats:
        if variable not in self.variables:
            has = ", ".join(f"{name} {_shape(value)}" for name, value in self.variables.items()) or "nothing"
            self._refuse(key, f"no {variable!r} is in the file; it has {has}")
        value = np.asarray(self.variables[variable])
        for depth, position in enumerate(index):
            value = value.ravel() if value.dtype == object else value  # a row or column of cells
            if value.ndim == 0 or position >= len(value):
                self._refuse(key, f"{variable!r} {_shape(value)} has no index {position} (index[{depth}])")
            value = np.asarray(value[position])
        if value.dtype.kind == "U":
            self._refuse(key, f"{variable!r}: {describe_text(value)}")
        if value.dtype.kind not in "fiu" or value.size != max(value.shape, default=1):
            has = f"{_shape(value)} of {value.dtype}"
            self._refuse(key, f"{variable!r} is {has}; one row or column of real numbers is needed")
        flat = value.astype(np.float64).ravel()[self.rows.first - 1 : self.rows.last]
        if flat.size == 0:
            self._refuse(
                key, f"{variable!r} has no sample in rows {self.rows.first} to {self.rows.last or 'the end'}"
            )
        return flat

    def _converted(self, key: str, name: str, values: Floats, unit: str | None) -> Floats:
        try:
            own = channel_unit(name)
        except UnitError as error:
            raise ConfigError(f"{self.mapping}: {key}: {error}") from error
        return values if unit is None else _convert(values, unit, own, f"{self.mapping}: {key}.unit")

    def _refuse(self, key: str, says: str) -> None:
        raise RecordingError(f"{self.path}: {key} (in {self.mapping}): {says}")


@lru_cache(maxsize=1)
def _registry() -> Any:
    import pint  # half a second, and only files in other units need it

    return pint.UnitRegistry()


def _convert(values: Floats, unit: str, own: str, where: str) -> Floats:
    """The values, given in `unit`, in the unit `own`."""
    import pint

    try:
        quantity = _registry().Quantity(values, unit)
        return np.asarray(quantity.to(own).magnitude, dtype=np.float64)
    except (pint.PintError, AttributeError, TypeError, ValueError) as error:
        raise ConfigError(f"{where} = {unit!r} is no unit that becomes {own} ({error})") from error


def _shape(value: Any) -> str:
    return "×".join(str(size) for size in np.shape(value)) or "(a single value)"


__all__ = ["ImportMapping", "import_recording", "import_recordings"]
