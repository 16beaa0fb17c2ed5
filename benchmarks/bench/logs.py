"""Writing the messages of a flight: our log beside lines of JSON, SQLite, and the MCAP library's own writer."""

from __future__ import annotations

import json
import sqlite3
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.bench.rows import Row, by_turns, rates
from flight.log import McapLog
from hal.log import LogMessage

BATCH = 100
"""Messages by transaction of the database: about what our log holds back before it hands a chunk on."""


@dataclass
class Sizes:
    """Bytes of the file that a writer made last."""

    value: int = 0


def log_rows(messages: Sequence[LogMessage], flight_s: float, repeats: int) -> list[Row]:
    """Throughput beside each peer, and bytes by second of flight."""
    writers = {"JSON lines": as_lines, "SQLite": as_table, "mcap.Writer": as_library}
    with tempfile.TemporaryDirectory() as made:
        folder, sizes = Path(made), {name: Sizes() for name in ("ours", *writers)}

        def job(name: str, write: Callable[[Path, Sequence[LogMessage]], None]) -> Callable[[], None]:
            def run() -> None:
                path = folder / "log"
                write(path, messages)
                sizes[name].value = path.stat().st_size
                path.unlink()

            return run

        jobs = [job("ours", as_ours), *(job(name, write) for name, write in writers.items())]
        ours, *theirs = by_turns(repeats, *jobs)
    count, rows = len(messages), list[Row]()
    notes = {
        "JSON lines": "the file alone: no index, no schemas, no check sums",
        "SQLite": "a transaction for each 100 messages, not forced to the medium",
        "mcap.Writer": "by the same library, chunks of 1 MiB: a kill costs all of a chunk",
    }
    for name, taken in zip(writers, theirs, strict=True):
        rows.append(
            Row("log: messages", "1/s", rates(count, ours), name, rates(count, taken), True, notes[name])
        )
        size = sizes["ours"].value / flight_s / 1e3, sizes[name].value / flight_s / 1e3
        rows.append(Row("log: size by time of flight", "kB/s", (size[0],), name, (size[1],)))
    return rows


def as_ours(path: Path, messages: Sequence[LogMessage]) -> None:
    """The flight software's log."""
    with McapLog(path, {}) as log:
        for message in messages:
            log.write(message.topic, message.time_s, message.payload)


def as_lines(path: Path, messages: Sequence[LogMessage]) -> None:
    """A line of JSON for each message."""
    with path.open("w", encoding="utf-8") as file:
        for message in messages:
            file.write(json.dumps([message.topic, message.time_s, message.payload]) + "\n")


def as_table(path: Path, messages: Sequence[LogMessage]) -> None:
    """A row for each message."""
    database = sqlite3.connect(path)
    database.execute("PRAGMA synchronous=OFF")
    database.execute("CREATE TABLE log (topic TEXT, time_s REAL, payload TEXT)")
    for first in range(0, len(messages), BATCH):
        rows = [(m.topic, m.time_s, json.dumps(m.payload)) for m in messages[first : first + BATCH]]
        with database:
            database.executemany("INSERT INTO log VALUES (?, ?, ?)", rows)
    database.close()


def as_library(path: Path, messages: Sequence[LogMessage]) -> None:
    """The library's writer as its documentation has it."""
    from mcap.writer import CompressionType, Writer

    with path.open("wb") as file:
        writer: Any = Writer(file, compression=CompressionType.NONE)
        writer.start()
        channels: dict[str, int] = {}
        for message in messages:
            if message.topic not in channels:
                schema = writer.register_schema(message.topic, "jsonschema", b'{"type": "object"}')
                channels[message.topic] = writer.register_channel(message.topic, "json", schema)
            stamp = round(1e9 * message.time_s)
            writer.add_message(channels[message.topic], stamp, json.dumps(message.payload).encode(), stamp)
        writer.finish()
