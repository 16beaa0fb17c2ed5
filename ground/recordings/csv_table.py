"""The table of a CSV recording: one header row, `time_s` first, channels with their unit, empty = missing.

Reading is one pass of Python's own number parser; only when something is wrong is the table gone through cell
by cell, to name line and column. Columns are counted in cells, from 1.
"""

from __future__ import annotations

import gzip
import math
import zlib
from pathlib import Path
from typing import NoReturn

import numpy as np

from ground.recordings.model import (
    TIME_CHANNEL,
    Floats,
    RecordingError,
    Table,
    check_channel_name,
    describe_bad_time,
    first_bad_time,
)

_NUMBER_BYTES = b"0123456789+-.eE,\n"


def read_table(path: Path) -> Table:
    """Read `NAME.csv` or `NAME.csv.gz`.

    Raises `RecordingError` as `file:line:column: ...` for anything that recording-format forbids.
    """
    header, _, body = _read_text(path).partition("\n")
    names = _check_header(path, header)
    body = body.removesuffix("\n")
    if not body:
        raise RecordingError(f"{path}:2: the file has a header but no samples")
    values = _fast_values(body, len(names))
    if values is None:
        _locate(path, body, names)
    index = first_bad_time(values[:, 0])
    if index is not None:
        says = describe_bad_time(values[:, 0], index)
        raise RecordingError(f"{path}:{index + 2}:1: column {TIME_CHANNEL!r}: {says}")
    return Table(values[:, 0], {name: values[:, column] for column, name in enumerate(names) if column})


def _read_text(path: Path) -> str:
    try:
        data = path.read_bytes()
        if path.suffix == ".gz":
            data = gzip.decompress(data)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise RecordingError(f"{path}: is cut or is no gzip file ({error})") from error
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror})") from error
    try:
        text = data.decode("utf-8-sig")  # spreadsheets put the mark of UTF-8 first
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        column = data.count(b",", data.rfind(b"\n", 0, error.start) + 1, error.start) + 1
        raise RecordingError(f"{path}:{line}:{column}: is not UTF-8 text (byte {error.start})") from error
    if not text.strip():
        raise RecordingError(f"{path}:1: the file is empty")
    return text.replace("\r\n", "\n")


def _check_header(path: Path, header: str) -> list[str]:
    names = header.split(",")
    for column, name in enumerate(names):
        where = f"{path}:1:{column + 1}"
        if column == 0 and name != TIME_CHANNEL:
            raise RecordingError(
                f"{where}: the first column must be {TIME_CHANNEL!r}, not {name!r}{_other_delimiter(header)}"
            )
        if name in names[:column]:
            raise RecordingError(f"{where}: column {name!r} stands twice")
        if column:
            try:
                check_channel_name(name)
            except RecordingError as error:
                raise RecordingError(f"{where}: {error}") from error
    if len(names) == 1:
        raise RecordingError(f"{path}:1:1: there is no channel beside the time")
    return names


def _other_delimiter(header: str) -> str:
    """What to say of a header whose columns seem to be told apart by something else than commas."""
    found = [words for mark, words in ((";", "semicolons"), ("\t", "tabs")) if mark in header]
    return (
        f" (columns are told apart by commas, not {found[0]}; `hopper import` reads other tables)"
        if found
        else ""
    )


def _fast_values(body: str, columns: int) -> Floats | None:
    """All values (n, columns), or None when some cell or row is not as it must be."""
    commas = columns - 1
    if body.encode().translate(None, _NUMBER_BYTES) or {row.count(",") for row in body.split("\n")} != {
        commas
    }:
        return None
    try:
        cells = [float(cell) if cell else math.nan for cell in body.replace("\n", ",").split(",")]
    except ValueError:
        return None
    values = np.array(cells).reshape(-1, columns)
    return None if np.isinf(values).any() else values


def _locate(path: Path, body: str, names: list[str]) -> NoReturn:
    """Raise the error of the first cell or row that is not as it must be."""
    for line, row in enumerate(body.split("\n"), start=2):
        cells = row.split(",")
        for column, (name, cell) in enumerate(zip(names, cells, strict=False), start=1):
            if cell:
                _check_cell(f"{path}:{line}:{column}: column {name!r}", cell)
        if len(cells) != len(names):
            where = f"{path}:{line}:{min(len(cells), len(names)) + 1}"
            says = f"the row has {len(cells)} cells, the header {len(names)}" if row else "the line is empty"
            raise RecordingError(f"{where}: {says}")
    raise AssertionError(f"{path}: the table was refused without a reason")


def _check_cell(where: str, cell: str) -> None:
    allowed = not cell.encode().translate(None, _NUMBER_BYTES)
    try:
        value = float(cell)
    except ValueError:
        value = None
    if value is not None and not math.isfinite(value):
        raise RecordingError(f"{where}: {cell!r} is not finite; leave the cell of a missing sample empty")
    if value is None or not allowed:
        raise RecordingError(f"{where}: {cell!r} is no number (digits, sign, point, exponent; nothing else)")


def format_table(table: Table) -> str:
    """The table as CSV text; each number is the shortest text that reads back as the same bits."""
    columns = [table.times_s, *table.channels.values()]
    texts = [[_number(value) for value in column.tolist()] for column in columns]
    rows = [",".join(row) for row in zip(*texts, strict=True)]
    return "\n".join([",".join([TIME_CHANNEL, *table.channels]), *rows, ""])


def _number(value: float) -> str:
    return "" if math.isnan(value) else repr(value)
