"""The on-board log: an MCAP file, a topic for each device and each kind of decision.

Messages are JSON objects with a JSON schema, so that the field's viewers open and plot the file as it is.
Each carries its exact time in `log_time_s` beside its payload (the container's own stamps are whole
nanoseconds), and its place in the run as the container's sequence number. What the run was flown with
(settings, mission, board, seed) stands in a metadata record named `METADATA_NAME` at the start of the file.

A chunk is handed to the operating system as soon as it is full: when the software dies, at most 8 KiB of messages
(less than 100 ms of flight) are lost. Only the end of a file forces it to the medium, because waiting for a memory
card would make the 200 Hz tick late; a loss of power may therefore cost what the system has not written back yet.

With `LogSettings` a log goes on in a new file (`flight-0001.mcap` after `flight.mcap`) when the present one is full,
and drops the oldest but the first, which holds the start, when all together are too large. `read_log` reads them as
one.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Annotated, Any, TypeVar

import yaml

from flight.mcap_stream import TIME_FIELD, McapWriter, decode_json, read_mcap
from hal.calls import to_plain
from hal.config import Limits, StrictLoader, build_settings
from hal.log import LogError, LogMessage

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T", bound="DataclassInstance")

METADATA_NAME = "hopper"


@dataclass(frozen=True)
class LogSettings:
    """What a log may take on the disc, and how many messages may wait for a slow one."""

    file_bytes: Annotated[int, Limits(16_384, 2**40)]
    total_bytes: Annotated[int, Limits(65_536, 2**44)]
    waiting_messages: Annotated[int, Limits(100, 10_000_000)]


class McapLog:
    """Writes the messages of one run to new MCAP files. Use as a context manager, or call `close`."""

    def __init__(self, path: Path, metadata: Mapping[str, str], limits: LogSettings | None = None) -> None:
        """Create the file. `metadata` is text by name: settings and mission as YAML, board, seed.

        Without `limits` it is one file of any size. Raises `LogError` when the file exists already or cannot
        be created.
        """
        self._first, self._metadata, self._limits = path, dict(metadata), limits
        self._sequence = self._part = 0
        self._sizes: dict[Path, int] = {}  # of the files that are complete
        self._open(path)

    def _open(self, path: Path) -> None:
        try:
            self._file: IO[bytes] = path.open("xb")
        except FileExistsError as error:
            raise LogError(f"{path}: exists already; a log is never overwritten") from error
        except OSError as error:
            raise LogError(f"{path}: cannot be created ({error.strerror})") from error
        self._path = path
        self._writer = McapWriter(self._file)
        self._writer.add_metadata(METADATA_NAME, self._metadata)
        self._file.flush()

    def write(self, topic: str, time_s: float, payload: Mapping[str, Any]) -> None:
        """Record one message (see `hal.log.LogSink`).

        Raises `LogError` for a value that JSON cannot keep exactly (NaN, infinity, an unknown type).
        """
        if TIME_FIELD in payload:
            raise LogError(f"message {self._sequence} ({topic}): {TIME_FIELD} is the log's own field")
        try:
            plain = {TIME_FIELD: time_s} | {name: to_plain(value) for name, value in payload.items()}
            self._writer.write(topic, time_s, plain, _encode(plain), self._sequence)
        except (TypeError, ValueError, OSError) as error:
            raise LogError(f"{self._path}: message {self._sequence} ({topic}): {error}") from error
        self._sequence += 1
        if self._limits is not None and self._file.tell() >= self._limits.file_bytes:
            self._rotate(self._limits)

    def _rotate(self, limits: LogSettings) -> None:
        """Go on in a new file; the oldest but the first are dropped while all together are too large."""
        self.close()
        self._sizes[self._path] = self._path.stat().st_size
        dropped = [path for path in self._sizes if path != self._first]
        while dropped and sum(self._sizes.values()) + limits.file_bytes > limits.total_bytes:
            oldest = dropped.pop(0)
            oldest.unlink(missing_ok=True)
            del self._sizes[oldest]
        self._part += 1
        self._open(part_path(self._first, self._part))

    def close(self) -> None:
        """Complete the file and force it to the medium. May be called again."""
        if self._file.closed:
            return
        try:
            self._writer.finish()
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise LogError(f"{self._path}: cannot be completed ({error.strerror})") from error
        finally:
            self._file.close()

    def __enter__(self) -> McapLog:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def part_path(first: Path, part: int) -> Path:
    """The file in which a log goes on: `flight-0001.mcap` after `flight.mcap`."""
    return first.with_name(f"{first.stem}-{part:04d}{first.suffix}") if part else first


def parts_of(first: Path) -> tuple[Path, ...]:
    """The files of one log that are there, in order."""
    later = sorted(first.parent.glob(f"{first.stem}-[0-9][0-9][0-9][0-9]{first.suffix}"))
    return (first, *later)


_encode_text = json.JSONEncoder(allow_nan=False, check_circular=False, separators=(",", ":")).encode


def _encode(message: Mapping[str, Any]) -> bytes:
    return _encode_text(message).encode()


@dataclass(frozen=True)
class FlightLog:
    """A log read back; `damage` says in words what is lost of it, and is empty when nothing is."""

    path: Path
    metadata: Mapping[str, str]
    messages: tuple[LogMessage, ...]
    damage: str

    def part(self, name: str, settings: type[T]) -> T:
        """One of the settings texts of the metadata, checked like the file that it was.

        Raises `LogError` when it is missing or no YAML, `ConfigError` when it does not fit `settings`.
        """
        source = f"{self.path}: metadata {name}"
        if name not in self.metadata:
            raise LogError(f"{source} is missing; it has {', '.join(self.metadata) or 'nothing'}")
        try:
            data: Any = yaml.load(self.metadata[name], Loader=StrictLoader)
        except (yaml.YAMLError, ValueError) as error:
            raise LogError(f"{source} is no valid YAML ({str(error).splitlines()[0]})") from error
        return build_settings(data, settings, source)


def read_log(path: Path, recover: bool = False) -> FlightLog:
    """Read a log; with `recover`, what is whole of a log that was cut or damaged.

    Raises `LogError` naming file and place when it is cut or damaged (without `recover`), holds no message
    readable as this log's, or was not written by `McapLog`.
    """
    metadata: Mapping[str, str] = {}
    messages: list[LogMessage] = []
    damage = ""
    for part in parts_of(path):
        content = read_mcap(part, recover)
        if METADATA_NAME not in content.metadata:
            if part != path and recover:  # cut before its first record was whole
                damage = content.damage
                break
            raise LogError(
                f"{part}: has no metadata record {METADATA_NAME!r}, so it is no log of this software"
            )
        metadata = metadata or content.metadata[METADATA_NAME]
        damage = content.damage
        try:
            for message in content.messages:
                messages.append(_decode(len(messages), *message))
        except LogError as error:
            if not recover:
                raise LogError(f"{part}: {error}") from error
            damage = str(error)
        if damage:
            break
    return FlightLog(path, metadata, tuple(messages), damage)


def _decode(index: int, topic: str, sequence: int, _time_ns: int, data: bytes) -> LogMessage:
    where = f"message {index} ({topic})"
    if sequence != index:
        raise LogError(f"{where}: its sequence number is {sequence}, so messages are missing before it")
    try:
        payload = decode_json(data)
        time_s = float(payload.pop(TIME_FIELD))
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise LogError(f"{where}: is no JSON object with {TIME_FIELD}") from error
    return LogMessage(sequence, topic, time_s, payload)
