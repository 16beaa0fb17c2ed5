"""Several recordings in one foreign file: by the values of columns, by cells, or by stretches of rows."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from ground.recordings.model import Floats, RecordingError
from hal.config import Limits
from hal.errors import ConfigError


@dataclass(frozen=True)
class Rows:
    """The samples to keep, counted from 1, both included; None is the file's last."""

    first: Annotated[int, Limits(1)] = 1
    last: Annotated[int | None, Limits(1)] = None


@dataclass(frozen=True)
class Split:
    """How one file holds several recordings; one of the three, or none for a file that is one recording.

    by: columns of a table, a recording for each combination of their values, which become conditions.
    cells: a MATLAB cell array, a recording for each cell; every cell array of as many cells is taken cell by cell,
    and `index` then counts within the cell. rows: stretches of samples by name.
    """

    by: tuple[str, ...] = ()
    cells: str | None = None
    rows: dict[str, Rows] = field(default_factory=dict)


@dataclass(frozen=True)
class Keep:
    """The stretch of a recording to keep: the longest in which the channel's size stays below a limit.

    `lead_s` of what came before it is kept too, `trim_s` at its end is not.
    """

    channel: str
    below: float
    shortest_s: Annotated[float, Limits(0.0)] = 0.0
    lead_s: float = 0.0
    trim_s: Annotated[float, Limits(0.0)] = 0.0


@dataclass(frozen=True)
class Part:
    """The variables of one recording, what to append to its name, and what its columns say of its conditions."""

    suffix: str
    variables: Mapping[str, Any]
    rows: Rows
    conditions: Mapping[str, float | str]


def parts_of(
    path: Path, mapping: Path, variables: Mapping[str, Any], split: Split, rows: Rows
) -> Iterator[Part]:
    """The recordings that a file holds. Raises `ConfigError` or `RecordingError` naming file and key."""
    if sum([bool(split.by), split.cells is not None, bool(split.rows)]) > 1:
        raise ConfigError(f"{mapping}: split takes one of by, cells, rows")
    if split.by:
        yield from _by_columns(path, mapping, variables, split.by, rows)
    elif split.cells is not None:
        yield from _by_cells(path, mapping, variables, split.cells, rows)
    elif split.rows:
        for name, stretch in split.rows.items():
            yield Part(f"_{name}", variables, stretch, {})
    else:
        yield Part("", variables, rows, {})


def _by_columns(
    path: Path, mapping: Path, variables: Mapping[str, Any], names: tuple[str, ...], rows: Rows
) -> Iterator[Part]:
    for name in names:
        if name not in variables:
            raise RecordingError(
                f"{path}: split.by (in {mapping}): no column {name!r}; it has {', '.join(variables)}"
            )
    keys = list(zip(*(np.ravel(variables[name]).tolist() for name in names), strict=True))
    for values in dict.fromkeys(keys):
        use = np.array([key == values for key in keys])
        chosen = {name: np.asarray(column)[use] for name, column in variables.items()}
        conditions = {_identifier(name): value for name, value in zip(names, values, strict=True)}
        yield Part("".join(f"_{_label(value)}" for value in values), chosen, rows, conditions)


def _by_cells(
    path: Path, mapping: Path, variables: Mapping[str, Any], name: str, rows: Rows
) -> Iterator[Part]:
    cells = np.asarray(variables.get(name))
    if name not in variables or cells.dtype != object:
        raise RecordingError(f"{path}: split.cells (in {mapping}): {name!r} is no cell array of the file")
    digits = len(str(cells.size))
    for number in range(cells.size):
        chosen = {
            key: np.asarray(value).ravel()[number] if _is_cells(value, cells.size) else value
            for key, value in variables.items()
        }
        yield Part(f"_{number + 1:0{digits}d}", chosen, rows, {})


def _is_cells(value: Any, count: int) -> bool:
    array = np.asarray(value)
    return array.dtype == object and array.size == count


def _identifier(name: str) -> str:
    return re.sub(r"\W+", "_", name).strip("_").lower()


def _label(value: float | str) -> str:
    text = f"{value:g}" if isinstance(value, float) else value
    return re.sub(r"\W+", "_", text).strip("_").lower()


def kept(times_s: Floats, values: Floats, keep: Keep, where: str) -> NDArray[np.bool_]:
    """Which samples (n,) a `Keep` leaves. Raises `RecordingError` when no stretch is long enough."""
    inside = np.concatenate([[False], np.abs(values) < keep.below, [False]]).astype(np.int8)
    edges = np.diff(inside)
    starts, stops = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    lengths = times_s[stops] - times_s[starts]
    if lengths.size == 0 or lengths.max() < keep.shortest_s:
        longest = f"the longest lasts {lengths.max():.3g} s" if lengths.size else "there is none"
        raise RecordingError(
            f"{where}: no stretch of {keep.shortest_s:g} s in which {keep.channel} stays below {keep.below:g}; "
            f"{longest}"
        )
    at = int(np.argmax(lengths))
    first, last = times_s[starts[at]] - keep.lead_s, times_s[stops[at]] - keep.trim_s
    return np.asarray((times_s >= first) & (times_s <= last))
