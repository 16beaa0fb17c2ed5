"""The cells of a CSV file or of one sheet of an XLSX file, each with its place in words."""

from __future__ import annotations

import csv
import math
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import openpyxl
from openpyxl.utils.exceptions import InvalidFileException

from hal.errors import ConfigError

MOST_ROWS = 100_000


@dataclass(frozen=True)
class Cells:
    """A table: headings, rows of cells below them, and the row numbers that a person sees."""

    where: str
    headings: tuple[str, ...]
    rows: tuple[tuple[object, ...], ...]
    numbers: tuple[int, ...]

    def text(self, index: int, column: str) -> str:
        """A cell as words; raises `ConfigError` for an empty one."""
        value = self._cell(index, column)
        if isinstance(value, float) and value.is_integer():
            value = int(value)  # spreadsheets keep the foot "1" as 1.0
        return str(value).strip()

    def number(self, index: int, column: str) -> float:
        """A cell as a finite number; raises `ConfigError` for anything else."""
        value = self._cell(index, column)
        try:
            if isinstance(value, bool):
                raise ValueError
            number = float(value)  # type: ignore[arg-type]
        except (TypeError, ValueError):
            raise self.error(index, column, f"{value!r} is no number") from None
        if not math.isfinite(number):
            raise self.error(index, column, f"{value!r} is not finite")
        return number

    def error(self, index: int, column: str, what: str) -> ConfigError:
        """An error that names the place of a cell."""
        return ConfigError(f"{self.where}: row {self.numbers[index]}, column {column!r}: {what}")

    def _cell(self, index: int, column: str) -> object:
        value = self.rows[index][self.headings.index(column)]
        if value is None or (isinstance(value, str) and not value.strip()):
            raise self.error(index, column, "the cell is empty")
        return value


def read_cells(path: Path, sheet: str | None, header_row: int) -> Cells:
    """Read a table by its suffix (`.csv`, `.xlsx`). Empty rows are left out; row numbers count from 1.

    Raises `ConfigError` naming the file, and the sheet of an XLSX file.
    """
    suffix = path.suffix.lower()
    if suffix == ".csv":
        if sheet is not None:
            raise ConfigError(f"{path}: a CSV file has no sheets, but the mapping names {sheet!r}")
        return _cells(str(path), _csv_rows(path), header_row)
    if suffix == ".xlsx":
        name, rows = _xlsx_rows(path, sheet)
        return _cells(f"{path}: sheet {name!r}", rows, header_row)
    raise ConfigError(f"{path}: a campaign table must be .csv or .xlsx, not {suffix or 'without suffix'}")


def _cells(where: str, rows: Sequence[Sequence[object]], header_row: int) -> Cells:
    if len(rows) < header_row:
        raise ConfigError(f"{where}: has {len(rows)} rows, its headings are to stand in row {header_row}")
    headings = tuple("" if cell is None else str(cell).strip() for cell in rows[header_row - 1])
    while headings and not headings[-1]:
        headings = headings[:-1]
    named = [heading for heading in headings if heading]
    for heading in named:
        if named.count(heading) > 1:
            raise ConfigError(f"{where}: row {header_row}: the heading {heading!r} stands twice")
    found, numbers = [], []
    for number, row in enumerate(rows[header_row:], start=header_row + 1):
        cells = tuple(row)
        if all(cell is None or (isinstance(cell, str) and not cell.strip()) for cell in cells):
            continue
        if len(cells) > len(headings) and any(cell not in (None, "") for cell in cells[len(headings) :]):
            raise ConfigError(f"{where}: row {number}: has more cells than there are headings")
        found.append(cells[: len(headings)] + (None,) * (len(headings) - len(cells)))
        numbers.append(number)
    if not found:
        raise ConfigError(f"{where}: has no rows below its headings")
    return Cells(where, headings, tuple(found), tuple(numbers))


def _csv_rows(path: Path) -> list[list[object]]:
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            rows: list[list[object]] = []
            for row in csv.reader(stream, strict=True):
                rows.append(list(row))
                if len(rows) > MOST_ROWS:
                    raise ConfigError(f"{path}: more than {MOST_ROWS} rows")
            return rows
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: not UTF-8 text (byte {error.start})") from None
    except csv.Error as error:
        raise ConfigError(f"{path}: not readable as CSV ({error})") from None


def _xlsx_rows(path: Path, sheet: str | None) -> tuple[str, Sequence[Sequence[object]]]:
    if not path.is_file():
        raise ConfigError(f"{path}: no such file")
    try:
        book = openpyxl.load_workbook(path, read_only=True, data_only=True)
    except (InvalidFileException, zipfile.BadZipFile, KeyError, ValueError, OSError) as error:
        raise ConfigError(f"{path}: not readable as XLSX ({error})") from None
    try:
        names = book.sheetnames
        name = names[0] if sheet is None else sheet
        if name not in names:
            raise ConfigError(f"{path}: no sheet {name!r}; sheets: {', '.join(names)}")
        rows = [tuple(row) for row in book[name].iter_rows(values_only=True, max_row=MOST_ROWS)]
    finally:
        book.close()
    return name, rows
