"""A campaign's results on disc: Parquet in parts, and a journal of what is not yet in one.

`campaign.json` says what the campaign is. Each row is appended to `journal.jsonl` as it comes; when enough stand
there they become the next `part-NNNNN.parquet`, which appears whole, and only then the journal is emptied. A kill
between these two leaves rows in both: reading takes them once.
"""

from __future__ import annotations

import fcntl
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ground.campaign.study import FAILED, INDEX, Row, require_same
from ground.files import write_atomic
from hal.errors import ConfigError

STAMP_NAME, JOURNAL_NAME, LOCK_NAME = "campaign.json", "journal.jsonl", ".lock"
PART_ROWS = 200


class Store:
    """Rows by index, those kept in `folder` already among them. Close it, or use `opened`."""

    def __init__(self, folder: Path, stamp: dict[str, Any], schema: Any, part_rows: int = PART_ROWS) -> None:
        self._folder, self._part_rows = folder, part_rows
        self._schema = full_schema(schema)
        found = kept_stamp(folder)
        if found is None:
            write_atomic(folder / STAMP_NAME, json.dumps(stamp, indent=1) + "\n")
        else:
            require_same(found, stamp, folder / STAMP_NAME)
        self.rows: dict[int, Row] = {row[INDEX]: row for row in part_rows_of(folder)}
        self._open: dict[int, Row] = {}
        for row in journal_rows(folder):
            if row[INDEX] not in self.rows:
                self._open[row[INDEX]] = self.rows[row[INDEX]] = row
        text = "".join(json.dumps(row) + "\n" for row in self._open.values())
        write_atomic(
            folder / JOURNAL_NAME, text
        )  # without a last line that was cut, and what a part has by now
        self._journal = (folder / JOURNAL_NAME).open("a", encoding="utf-8")

    def add(self, row: Row) -> None:
        """Keep a row; the index must be new."""
        if row[INDEX] in self.rows:
            raise ValueError(f"case {row[INDEX]} is kept already")
        self.rows[row[INDEX]] = self._open[row[INDEX]] = row
        self._journal.write(json.dumps(row) + "\n")
        self._journal.flush()
        if len(self._open) >= self._part_rows:
            self._write_part()

    def close(self) -> None:
        """Put what is in the journal into a last part."""
        if self._open:
            self._write_part()
        self._journal.close()

    def _write_part(self) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        rows = [self._open[index] for index in sorted(self._open)]
        buffer = pa.BufferOutputStream()
        pq.write_table(pa.Table.from_pylist(rows, schema=self._schema), buffer, compression="zstd")
        number = len(parts_of(self._folder))
        write_atomic(self._folder / f"part-{number:05d}.parquet", buffer.getvalue().to_pybytes())
        self._open.clear()
        self._journal.truncate(0)


@contextmanager
def opened(folder: Path, stamp: dict[str, Any], schema: Any, part_rows: int = PART_ROWS) -> Iterator[Store]:
    """A store that no other process has open. Raises `ConfigError` when one has, or it is of another campaign."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / LOCK_NAME).open("a") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise ConfigError(f"{folder}: another campaign is writing here") from error
        store = Store(folder, stamp, schema, part_rows)
        try:
            yield store
        finally:
            store.close()


def full_schema(schema: Any) -> Any:
    """A study's columns behind the index and the reason of a failure."""
    import pyarrow as pa

    return pa.schema([pa.field(INDEX, pa.int64(), nullable=False), pa.field(FAILED, pa.string()), *schema])


def kept_stamp(folder: Path) -> dict[str, Any] | None:
    """What campaign a folder is of; None for none. Raises `ConfigError` for a file that is not one."""
    path = folder / STAMP_NAME
    if not path.exists():
        return None
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ConfigError(f"{path}: is not the file of a campaign ({error})") from error
    if not isinstance(found, dict) or not {"study", "seed"} <= found.keys():
        raise ConfigError(f"{path}: is not the file of a campaign (study and seed are missing)")
    return found


def parts_of(folder: Path) -> list[Path]:
    """The Parquet files, in the order in which they were written."""
    return sorted(folder.glob("part-*.parquet"))


def part_rows_of(folder: Path) -> Iterator[Row]:
    """Rows of all parts."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    for path in parts_of(folder):
        try:
            rows = pq.read_table(path).to_pylist()
        except pa.ArrowException as error:
            raise ConfigError(f"{path}: cannot be read as Parquet ({error})") from error
        yield from (_slim(row) for row in rows)


def journal_rows(folder: Path) -> Iterator[Row]:
    """Rows of the journal; a last line that was cut off is left out."""
    path = folder / JOURNAL_NAME
    if path.exists():
        for line in path.read_text(encoding="utf-8").splitlines(keepends=True):
            if line.endswith("\n"):
                yield json.loads(line)


def read_rows(folder: Path) -> dict[int, Row]:
    """All rows of a campaign by index, in order."""
    rows = {row[INDEX]: row for row in (*journal_rows(folder), *part_rows_of(folder))}
    return dict(sorted(rows.items()))


def _slim(row: Row) -> Row:
    """A failed case has no columns but two; Parquet gives it all of them, empty."""
    return row if row[FAILED] is None else {INDEX: row[INDEX], FAILED: row[FAILED]}
