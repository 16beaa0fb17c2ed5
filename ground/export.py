"""Logs and recordings as plain tables: CSV and Parquet.

A flight log becomes one table for each device and each kind of message, each row with its time in `time_s` on the
robot's clock. A recording keeps its tables. Units stand in the columns' names; Parquet also keeps them as metadata.
"""

from __future__ import annotations

import csv
import importlib
import io
import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flight.log import parts_of
from flight.mcap_stream import TIME_FIELD, decode_json, read_mcap, unit_of
from ground.files import whole_folder, write_atomic
from ground.progress import Show, nobody, part_of
from ground.recordings.loading import load_recording
from ground.recordings.mcap_file import is_flight_log
from ground.recordings.model import Recording
from hal.errors import ConfigError

Columns = dict[str, list[Any]]
FORMATS = ("csv", "parquet")
MARKER = "export.json"
TOLD = ("outputs", "state", "event", "hop")
TIMES = ("time_s", "times_s")
READING_SHARE = 0.6
"""Of the time of an export, about; the rest is writing."""
PROGRESS_EVERY = 100_000


def export(path: Path, folder: Path, kind: str, recover: bool = False, show: Show = nobody) -> dict[str, int]:
    """Write the tables of a log or recording into `folder`; returns rows by file name.

    Raises `ConfigError` for an unknown kind or a missing library, `LogError` or `RecordingError` for the file.
    """
    if kind not in FORMATS:
        raise ConfigError(f"--to {kind!r} is no format; known: {', '.join(FORMATS)}")
    write: Callable[[Columns], bytes] = csv_bytes if kind == "csv" else parquet_writer()
    tables = tables_of(path, recover, part_of(show, 0.0, READING_SHARE))
    writing = part_of(show, READING_SHARE, 1.0)
    cells = sum(len(columns) * rows_of(columns) for columns in tables.values()) or 1
    done = 0
    with whole_folder(folder, MARKER) as work:
        for name, columns in tables.items():
            writing(f"writing {name}.{kind}", done / cells)
            done += len(columns) * rows_of(columns)
            write_atomic(work / f"{name}.{kind}", write(columns))
        units = {name: {key: unit_of(key) for key in columns} for name, columns in tables.items()}
        about = {"source": str(path), "units": units}
        write_atomic(work / MARKER, json.dumps(about, indent=1, ensure_ascii=False) + "\n")
    return {f"{name}.{kind}": rows_of(columns) for name, columns in tables.items()}


def tables_of(path: Path, recover: bool = False, show: Show = nobody) -> dict[str, Columns]:
    """The tables of a flight log, or of a recording."""
    if path.suffix == ".mcap" and is_flight_log(path):
        return log_tables(path, recover, show)
    return recording_tables(load_recording(path))


def recording_tables(recording: Recording) -> dict[str, Columns]:
    """Main table as `main`, others by their label. Samples that are missing are None."""
    tables = {"main": recording, **recording.extra_tables}
    return {
        label: {
            "time_s": table.times_s.tolist(),
            **{name: [_none(value) for value in values.tolist()] for name, values in table.channels.items()},
        }
        for label, table in tables.items()
    }


def log_tables(path: Path, recover: bool = False, show: Show = nobody) -> dict[str, Columns]:
    """One table for each device that is read or commanded, and for what the flight software says."""
    rows: dict[str, list[dict[str, Any]]] = {}
    parts = parts_of(path)
    for number, part in enumerate(parts):
        reading = part_of(show, number / len(parts), (number + 1) / len(parts))
        reading(f"reading {part}", 0.0)
        messages = read_mcap(part, recover).messages
        for index, (topic, _, _, data) in enumerate(messages):
            if index % PROGRESS_EVERY == 0:
                reading(f"reading {part}", 0.3 + 0.7 * index / len(messages))
            if topic in TOLD or b'"read"' in data or b'"set_voltage_v"' in data or b'"switch_o' in data:
                _take(rows.setdefault(topic, []), topic, decode_json(data))
    return {topic: _columns(found) for topic, found in rows.items() if found}


def _take(rows: list[dict[str, Any]], topic: str, message: dict[str, Any]) -> None:
    time_s = message.pop(TIME_FIELD)
    if topic in TOLD:
        rows.append({"time_s": time_s, **_flat(message)})
    elif message["method"] == "read" and isinstance(message.get("result"), dict):
        _take_reading(rows, message["result"])
    elif message["method"] == "set_voltage_v":
        rows.append({"time_s": time_s, **message["arguments"]})
    elif message["method"] in ("switch_on", "switch_off"):
        rows.append({"time_s": time_s, "on": message["method"] == "switch_on"})


def _take_reading(rows: list[dict[str, Any]], reading: Mapping[str, Any]) -> None:
    """A reading is one row, a batch one for each sample; a sample that was read already is not taken again."""
    times = reading.get("times_s", [reading.get("time_s")])
    values = {name: value for name, value in reading.items() if name not in TIMES}
    for index, time_s in enumerate(times):
        if not rows or time_s > rows[-1]["time_s"]:
            row = {name: value[index] if _listed(value, times) else value for name, value in values.items()}
            rows.append({"time_s": time_s, **{k: v for k, v in row.items() if not isinstance(v, list)}})


def _listed(value: Any, times: list[float]) -> bool:
    return isinstance(value, list) and len(value) == len(times)


def _flat(message: Mapping[str, Any]) -> dict[str, Any]:
    """A quantity becomes two columns, its value and its sigma; what else is nested becomes JSON."""
    row: dict[str, Any] = {}
    for name, value in message.items():
        if isinstance(value, Mapping) and {"value", "sigma"} <= value.keys():
            row |= {name: value["value"], f"{name}_sigma": value["sigma"]}
        else:
            row[name] = json.dumps(value, ensure_ascii=False) if isinstance(value, dict | list) else value
    return row


def _columns(rows: list[dict[str, Any]]) -> Columns:
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: [row.get(name) for row in rows] for name in names}


def _none(value: float) -> float | None:
    return None if math.isnan(value) else value


def rows_of(columns: Columns) -> int:
    """How many rows a table has."""
    return len(next(iter(columns.values())))


def csv_bytes(columns: Columns) -> bytes:
    """A table as CSV: a header, then rows; what is missing is empty, yes and no are 1 and 0."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(columns)
    for row in zip(*columns.values(), strict=True):
        writer.writerow([int(value) if isinstance(value, bool | np.bool_) else value for value in row])
    return stream.getvalue().encode()


def parquet_writer() -> Callable[[Columns], bytes]:
    """What writes a table as Parquet. Raises `ConfigError` when its library is not there."""
    try:
        arrow: Any = importlib.import_module("pyarrow")
        parquet: Any = importlib.import_module("pyarrow.parquet")
    except ImportError as error:
        raise ConfigError("--to parquet needs pyarrow; install it with: pip install pyarrow") from error

    def write(columns: Columns) -> bytes:
        fields = {name: arrow.array(values) for name, values in columns.items()}
        schema = arrow.schema(
            [
                arrow.field(name, array.type, metadata={"unit": unit_of(name)})
                for name, array in fields.items()
            ]
        )
        sink = io.BytesIO()
        parquet.write_table(arrow.Table.from_arrays(list(fields.values()), schema=schema), sink)
        return sink.getvalue()

    return write
