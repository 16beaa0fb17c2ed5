"""Recordings as MCAP: a channel a topic, the sidecar as a metadata record.

The main table's channels are the topics `/CHANNEL`, those of a table at another rate `/LABEL/CHANNEL`.
A message is `{"log_time_s": ..., "value": ...}`, `value` null where the sample is missing; the container's
own stamps are the same times in whole nanoseconds, counted from the recording's first time if it is negative.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from io import BytesIO
from itertools import islice
from pathlib import Path

import numpy as np
from mcap.records import Metadata
from mcap.stream_reader import StreamReader

from flight.log import METADATA_NAME as LOG_METADATA
from flight.mcap_stream import TIME_FIELD, McapContent, McapWriter, decode_json, read_mcap
from ground.files import write_atomic
from ground.recordings.model import Floats, Recording, RecordingError, Table
from ground.recordings.sidecar import format_sidecar, parse_sidecar
from hal.log import LogError

METADATA_NAME = "recording"
_EXAMPLE = {"value": 0.0}
Samples = list[tuple[float, float]]


def write_mcap(recording: Recording, path: Path) -> Path:
    """Write the recording to `path`, whole or not at all. Returns `path`.

    Raises `RecordingError` when a time does not fit the container (span of 1e9 s) or a sidecar cannot say a
    value, `OSError` when the place cannot be written.
    """
    sidecar = format_sidecar(recording)
    parse_sidecar(sidecar, f"{path}: its sidecar")
    stream = BytesIO()
    writer = McapWriter(stream, chunk_bytes=1 << 20)
    writer.add_metadata(METADATA_NAME, {"sidecar": sidecar})
    tables: dict[str, Table] = {"": recording, **recording.extra_tables}
    start_s = min(0.0, *(float(table.times_s[0]) for table in tables.values()))
    try:
        for label, table in tables.items():
            _write_table(writer, f"/{label}/" if label else "/", table, start_s)
    except ValueError as error:
        raise RecordingError(f"{path}: {error}") from error
    writer.finish()
    return write_atomic(path, stream.getvalue())


def _write_table(writer: McapWriter, prefix: str, table: Table, start_s: float) -> None:
    """One topic for each channel, row by row, so that a cut takes the same rows from all of them."""
    columns = {name: values.tolist() for name, values in table.channels.items()}
    for index, time_s in enumerate(table.times_s.tolist()):
        for name, values in columns.items():
            value = values[index]
            text = "null" if math.isnan(value) else repr(value)
            data = f'{{"{TIME_FIELD}":{time_s!r},"value":{text}}}'.encode()
            writer.write(prefix + name, time_s - start_s, _EXAMPLE, data)


def read_mcap_recording(path: Path, recover: bool = False) -> Recording:
    """Read a recording; with `recover`, the whole part of a file that was cut, saying so in its notes.

    Raises `RecordingError` naming the file and what is wrong.
    """
    try:
        content = read_mcap(path, recover)
    except LogError as error:
        raise RecordingError(str(error)) from error
    if "sidecar" not in content.metadata.get(METADATA_NAME, {}):
        raise RecordingError(f"{path}: has no metadata record {METADATA_NAME!r} with a sidecar")
    sidecar = parse_sidecar(content.metadata[METADATA_NAME]["sidecar"], f"{path}: its sidecar")
    tables = {label: _table(path, channels) for label, channels in _by_table(path, content).items()}
    if "" not in tables:
        raise RecordingError(f"{path}: holds no samples")
    main = tables.pop("")
    if content.damage:
        lost = f"Recovered in part: {content.damage}."
        sidecar = replace(sidecar, notes=f"{sidecar.notes}\n{lost}".strip())
    try:
        return Recording(main.times_s, main.channels, **vars(sidecar), extra_tables=tables, source=path)
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error


def is_flight_log(path: Path) -> bool:
    """Whether an MCAP file begins as a flight's own log does, which holds no recording. It may be cut or damaged."""
    try:
        with path.open("rb") as stream:
            begins = list(islice(StreamReader(stream).records, 2))
    except Exception:  # a damaged file fails in many ways; whoever reads it as a recording will say how
        return False
    return any(isinstance(record, Metadata) and record.name == LOG_METADATA for record in begins)


def _by_table(path: Path, content: McapContent) -> dict[str, dict[str, Samples]]:
    """Samples (time, value) by table label and channel, in the order of the file."""
    tables: dict[str, dict[str, Samples]] = {}
    for index, (topic, _, _, data) in enumerate(content.messages):
        label, _, channel = topic.removeprefix("/").rpartition("/")
        try:
            message = decode_json(data)
            value = message["value"]
            sample = _number(message[TIME_FIELD]), math.nan if value is None else _number(value)
        except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
            raise RecordingError(
                f"{path}: message {index} ({topic}) is no sample ({TIME_FIELD} and a number as value)"
            ) from error
        tables.setdefault(label, {}).setdefault(channel, []).append(sample)
    return tables


def _number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"{value!r} is no number")
    return float(value)


def _table(path: Path, channels: Mapping[str, Samples]) -> Table:
    """Channels on the union of their sample times; a channel without a sample at a time lacks it there."""
    columns = {name: np.array(samples) for name, samples in channels.items()}
    times = [column[:, 0] for column in columns.values()]
    shared = all(np.array_equal(each, times[0]) for each in times)
    times_s = times[0] if shared else np.unique(np.concatenate(times))
    try:
        for name, column in columns.items():
            Table(column[:, 0], {name: column[:, 1]})
        return Table(times_s, {name: _spread(column, times_s) for name, column in columns.items()})
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error


def _spread(column: Floats, times_s: Floats) -> Floats:
    values = np.full(times_s.size, np.nan)
    values[np.searchsorted(times_s, column[:, 0])] = column[:, 1]
    return values
