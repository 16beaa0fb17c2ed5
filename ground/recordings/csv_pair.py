"""Recordings as CSV pairs: `NAME.csv` or `NAME.csv.gz` with `NAME.yaml` beside it.

Tables of the same run at other rates are `NAME.LABEL.csv` beside it, without a sidecar of their own.
"""

from __future__ import annotations

import gzip
from pathlib import Path

from ground.files import write_atomic
from ground.recordings.csv_table import format_table, read_table
from ground.recordings.model import Recording, RecordingError, Table, is_name
from ground.recordings.sidecar import Sidecar, format_sidecar, parse_sidecar, read_sidecar

CSV_SUFFIXES = (".csv", ".csv.gz")


def stem_of(path: Path) -> str:
    """`NAME` of `NAME.csv`, `NAME.csv.gz` or `NAME.yaml`. Raises `RecordingError` for another suffix."""
    for suffix in (*CSV_SUFFIXES, ".yaml"):
        if path.name.endswith(suffix) and path.name != suffix:
            return path.name.removesuffix(suffix)
    raise RecordingError(f"{path}: a CSV recording ends in .csv, .csv.gz or .yaml")


def sidecar_of(path: Path) -> Path:
    """The sidecar that describes a CSV: `NAME.yaml`, or for `NAME.LABEL.csv` the one it shares."""
    stem = stem_of(path)
    own = path.with_name(f"{stem}.yaml")
    shared = path.with_name(f"{stem.rpartition('.')[0]}.yaml")
    if not own.is_file() and "." in stem and shared.is_file():
        return shared
    return own


def main_table_of(sidecar: Path) -> Path:
    """The CSV of a sidecar: `NAME.csv`, else the table labelled with the recording's kind, else the only one.

    Raises `RecordingError` when there is none, or more than one could be meant.
    """
    stem = stem_of(sidecar)
    named = [path for suffix in CSV_SUFFIXES if (path := sidecar.with_name(stem + suffix)).is_file()]
    tables = _labelled_tables(sidecar)
    if not named and len(tables) > 1:
        tables = {label: path for label, path in tables.items() if label == read_sidecar(sidecar).kind}
    found = named or list(tables.values())
    if not found:
        raise RecordingError(f"{sidecar}: no table {stem}.csv or {stem}.csv.gz stands beside it")
    if len(found) > 1:
        raise RecordingError(f"{sidecar}: both {found[0].name} and {found[1].name} stand beside it")
    return found[0]


def _labelled_tables(sidecar: Path) -> dict[str, Path]:
    """The tables `NAME.LABEL.csv` that share this sidecar, by label."""
    start = f"{stem_of(sidecar)}."
    tables: dict[str, Path] = {}
    for path in sorted(sidecar.parent.iterdir()):
        if not path.name.endswith(CSV_SUFFIXES) or not stem_of(path).startswith(start):
            continue
        label = stem_of(path).removeprefix(start)
        if not is_name(label) or sidecar_of(path) != sidecar:
            continue
        if label in tables:
            raise RecordingError(f"{path}: {tables[label].name} stands beside it")
        tables[label] = path
    return tables


def read_csv_pair(path: Path) -> Recording:
    """Read the recording that a CSV (or its sidecar) names, with its tables at other rates.

    Raises `RecordingError` naming file, line and column (in the CSV: cells from 1) of what is wrong.
    """
    if path.name.endswith(".yaml"):
        path = main_table_of(path)
    if not path.is_file():
        raise RecordingError(f"{path}: no such file")
    sidecar_path = sidecar_of(path)
    sidecar = read_sidecar(sidecar_path)
    labelled = {label: table for label, table in _labelled_tables(sidecar_path).items() if table != path}
    table = read_table(path)
    others = {label: read_table(other) for label, other in labelled.items()}
    return Recording(table.times_s, table.channels, **vars(sidecar), extra_tables=others, source=path)


def write_csv_pair(recording: Recording, path: Path) -> Path:
    """Write `path` (`.csv` or `.csv.gz`), its sidecar, and its tables at other rates. Returns `path`.

    No file is ever half-written; the sidecar comes last. Raises `RecordingError` when the recording has a
    value that a sidecar cannot say, `OSError` when the place cannot be written.
    """
    stem = stem_of(path)
    suffix = path.name.removeprefix(stem)
    if suffix not in CSV_SUFFIXES:
        raise RecordingError(f"{path}: a CSV recording is written to .csv or .csv.gz")
    sidecar = format_sidecar(recording)
    _check_neighbours(path, parse_sidecar(sidecar, f"{path}: its sidecar"))
    for label, table in recording.extra_tables.items():
        _write_table(table, path.with_name(f"{stem}.{label}{suffix}"))
    _write_table(recording, path)
    write_atomic(path.with_name(f"{stem}.yaml"), sidecar)
    return path


def _check_neighbours(path: Path, mine: Sidecar) -> None:
    """Refuse a name whose sidecar would replace a file of another kind, or describe a table of another recording."""
    beside = path.with_name(f"{stem_of(path)}.yaml")
    if not beside.is_file():
        return
    try:
        there = read_sidecar(beside)
    except RecordingError as error:
        says = f"its sidecar would replace {beside}, which is none; choose another name"
        raise RecordingError(f"{path}: {says}") from error
    others = [path.with_name(stem_of(path) + suffix) for suffix in CSV_SUFFIXES]
    for other in others:
        if other != path and other.is_file() and repr(there) != repr(mine):
            raise RecordingError(
                f"{path}: its sidecar would replace that of {other.name}; choose another name"
            )


def _write_table(table: Table, path: Path) -> None:
    data = format_table(table).encode()
    # no date in the gzip header: the same recording gives the same file
    write_atomic(path, gzip.compress(data, mtime=0) if path.suffix == ".gz" else data)
