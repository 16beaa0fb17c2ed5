"""Variables of foreign files: MATLAB files and tables of text."""

from __future__ import annotations

import csv
import gzip
import math
import zlib
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ground.matlab_files import read_mat
from ground.recordings.model import RecordingError

TABLE_SUFFIXES = (".csv", ".txt", ".tsv")


@dataclass(frozen=True)
class TableFormat:
    """How a table of text is written. Without a header, columns are named by their number, from 1."""

    delimiter: str = ","
    header: bool = True
    skip_lines: int = 0
    trailing_delimiter: bool = False


def read_variables(path: Path, table: TableFormat, wanted: Collection[str]) -> Mapping[str, Any]:
    """Variables of a file by name: arrays of a MATLAB file, columns (n,) of a table (NaN = empty), numbers of MCAP.

    Of an MCAP file they are on the times of those that are `wanted`; of other files all are read.
    Raises `RecordingError` naming the file, and line and column where there are such.
    """
    name = path.name.removesuffix(".gz")
    if path.name.endswith(".mat"):
        return read_mat(path)
    if path.name.endswith(".mcap"):
        from ground.foreign_mcap import read_mcap_variables  # brings the decoders along

        return read_mcap_variables(path, wanted)
    if name.endswith(TABLE_SUFFIXES):
        return _read_table(path, table)
    raise RecordingError(
        f"{path}: a file to import ends in .mat, .mcap, {', '.join(TABLE_SUFFIXES)} (or .gz of these)"
    )


def _read_table(path: Path, table: TableFormat) -> Mapping[str, Any]:
    try:
        data = path.read_bytes()
        text = (gzip.decompress(data) if path.suffix == ".gz" else data).decode("utf-8-sig")
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise RecordingError(f"{path}: is cut or is no gzip file ({error})") from error
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise RecordingError(f"{path}: is not UTF-8 text (byte {error.start})") from error
    try:
        lines = text.splitlines()[table.skip_lines :]
        rows = list(csv.reader(lines, delimiter=table.delimiter, strict=True))
        while rows and not any(cell.strip() for cell in rows[-1]):  # empty lines at the end
            rows.pop()
        if table.trailing_delimiter:
            rows = [row[:-1] if row and not row[-1] else row for row in rows]
    except (csv.Error, TypeError) as error:
        raise RecordingError(
            f"{path}: is no table with {table.delimiter!r} between cells ({error})"
        ) from error
    start = table.skip_lines + 1
    if not rows:
        raise RecordingError(f"{path}:{start}: the file is empty")
    names = rows.pop(0) if table.header else [str(number + 1) for number in range(len(rows[0]))]
    return _columns(path, names, rows, start + table.header)


def _columns(path: Path, names: list[str], rows: list[list[str]], start: int) -> Mapping[str, Any]:
    """Columns by name; one with a cell that is no number stays text, and is refused where it is asked for."""
    for line, row in enumerate(rows, start=start):
        if len(row) != len(names):
            raise RecordingError(f"{path}:{line}: the row has {len(row)} cells, not {len(names)}")
    columns: dict[str, Any] = {}
    for column, name in enumerate(names):
        if name.strip() in columns:
            raise RecordingError(f"{path}:{start - 1}:{column + 1}: column {name!r} stands twice")
        cells = [row[column].strip() for row in rows]
        try:
            columns[name.strip()] = np.array([_number(cell) for cell in cells])
        except ValueError:
            columns[name.strip()] = np.array(cells)
    return columns


def _number(cell: str) -> float:
    if "_" in cell:  # Python would read 1_000 as a number
        raise ValueError(cell)
    return float(cell) if cell else math.nan


def describe_text(cells: Any) -> str:
    """Which of the cells of a column of text keeps it from being numbers."""
    for sample, cell in enumerate(np.ravel(cells).tolist()):
        try:
            _number(cell)
        except ValueError:
            return f"sample {sample} is {cell!r}, no number"
    return "is text"
