"""The MCAP container (https://mcap.dev/spec) with JSON messages, written as a stream, read however it ended.

Reading needs no index: records are taken in the order of the file, each only when all its bytes are there
and, for chunks and for the data section, when the check sums hold.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO, Any

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Metadata
from mcap.stream_reader import get_chunk_data_stream
from mcap.writer import CompressionType, IndexType, Writer

from hal.log import LogError

TIME_FIELD = "log_time_s"
CHUNK_BYTES = 8 * 1024
"""About 40 ms of flight: what a chunk holds is what is lost when the software dies."""
LARGEST_CHUNK_BYTES = 1 << 30
MAGIC = b"\x89MCAP0\r\n"
_RECORD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")


class McapWriter:
    """An MCAP stream of JSON messages: registers a topic with its schema when its first message comes."""

    def __init__(self, stream: IO[bytes], chunk_bytes: int = CHUNK_BYTES) -> None:
        self._writer = Writer(
            _Flushing(stream),  # type: ignore[arg-type]
            chunk_size=chunk_bytes,
            compression=CompressionType.ZSTD,
            index_types=IndexType.ALL,
            enable_data_crcs=True,
        )
        self._writer.start(profile="", library="hopper")
        self._channels: dict[str, int] = {}

    def add_metadata(self, name: str, texts: Mapping[str, str]) -> None:
        """Write one metadata record."""
        self._writer.add_metadata(name, dict(texts))

    def write(
        self, topic: str, time_s: float, example: Mapping[str, Any], data: bytes, sequence: int = 0
    ) -> None:
        """Write one message, `data`, of the form of `example`. Raises `ValueError` for an unfit time."""
        if not 0.0 <= time_s < 1e9:
            raise ValueError(f"time {time_s!r} s is outside [0, 1e9) s")
        channel = self._channels.get(topic) or self._register(topic, example)
        time_ns = round(time_s * 1e9)
        self._writer.add_message(channel, time_ns, data, time_ns, sequence)

    def finish(self) -> None:
        """Write the last chunk, the summary and the end mark."""
        self._writer.finish()  # type: ignore[no-untyped-call]

    def _register(self, topic: str, example: Mapping[str, Any]) -> int:
        schema = {"title": topic, **schema_of({TIME_FIELD: 0.0, **example})}
        schema_id = self._writer.register_schema(topic, "jsonschema", json.dumps(schema).encode())
        self._channels[topic] = self._writer.register_channel(topic, "json", schema_id)
        return self._channels[topic]


class _Flushing:
    """A stream that hands each write on at once."""

    def __init__(self, stream: IO[bytes]) -> None:
        self._stream = stream

    def write(self, data: bytes) -> int:
        written = self._stream.write(data)
        self._stream.flush()
        return written

    def tell(self) -> int:
        return self._stream.tell()


_SCHEMA_TYPES: tuple[tuple[type, str], ...] = (
    (bool, "boolean"),
    (int, "integer"),
    (float, "number"),
    (str, "string"),
)


def schema_of(value: Any) -> dict[str, Any]:
    """The JSON schema that describes values like this one: what a viewer needs to offer its fields."""
    if isinstance(value, Mapping):
        return {"type": "object", "properties": {key: _field(key, item) for key, item in value.items()}}
    if isinstance(value, list | tuple):
        return {"type": "array", "items": schema_of(value[0]) if value else {}}
    return next(({"type": name} for kind, name in _SCHEMA_TYPES if isinstance(value, kind)), {})


_UNITS = (  # by the end of a name, longest first
    *(
        ("_m_s2", "m/s²"),
        ("_m_s", "m/s"),
        ("_n_m", "N/m"),
        ("_hz", "Hz"),
        ("_deg", "°"),
        ("_s", "s"),
        ("_m", "m"),
    ),
    *(("_a", "A"), ("_v", "V"), ("_n", "N"), ("_j", "J"), ("_k", "K"), ("_w", "W"), ("_kg", "kg")),
)


def unit_of(name: str) -> str:
    """The unit that a name ends in; empty when it has none."""
    return next((unit for ending, unit in _UNITS if name.removesuffix("_sigma").endswith(ending)), "")


def _field(name: str, value: Any) -> dict[str, Any]:
    """The schema of a field, described by its unit where its name tells one."""
    unit = unit_of(name)
    return {**schema_of(value), "description": unit} if unit else schema_of(value)


@dataclass
class McapContent:
    """What a file holds: metadata records by name, messages as (topic, sequence, time in ns, data).

    `damage` says in words where and why reading ended early; it is empty for a whole file.
    """

    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    messages: list[tuple[str, int, int, bytes]] = field(default_factory=list)
    damage: str = ""


def read_mcap(path: Path, recover: bool = False) -> McapContent:
    """Read a whole file, or with `recover` what is whole of it.

    Raises `LogError` naming file and byte when the file is cut or damaged (without `recover`), is no MCAP
    file, or cannot be read.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise LogError(f"{path}: cannot be read ({error.strerror})") from error
    if not data.startswith(MAGIC):
        raise LogError(f"{path}: is no MCAP file (its first bytes are {data[:8]!r})")
    content = McapContent()
    try:
        _take_records(data, content)
    except _Damage as damage:
        if not recover:
            raise LogError(f"{path}: {damage} (reading with recover gives what is whole)") from damage
        content.damage = str(damage)
    return content


class _Damage(Exception):
    """The file is not whole from here on."""


def _records(data: bytes, start: int, what: str) -> Iterator[tuple[int, int, int, int]]:
    """(opcode, first byte, first and last byte of the content) of each record from `start`."""
    while start < len(data):
        if start + _RECORD.size > len(data):
            raise _Damage(f"{what} is cut at byte {len(data)}, within a record that starts at byte {start}")
        opcode, length = _RECORD.unpack_from(data, start)
        first = start + _RECORD.size
        if first + length > len(data):
            raise _Damage(f"{what} is cut at byte {len(data)}, within a record that starts at byte {start}")
        yield opcode, start, first, first + length
        start = first + length


def _take_records(data: bytes, content: McapContent) -> None:
    topics: dict[int, str] = {}
    for opcode, start, first, end in _records(data, len(MAGIC), "the file"):
        if opcode == Opcode.METADATA:
            record = _parse(Metadata.read, data[first:end], start)
            content.metadata[record.name] = record.metadata
        elif opcode == Opcode.CHUNK:
            _take_chunk(data[first:end], start, topics, content)
        elif opcode == Opcode.CHANNEL:
            _take_channel(data[first:end], start, topics)
        elif opcode == Opcode.MESSAGE:
            _take_message(data[first:end], start, topics, content)
        elif opcode == Opcode.DATA_END:
            expected = struct.unpack_from("<I", data, first)[0] if end - first >= 4 else 0
            if expected and expected != zlib.crc32(memoryview(data)[:start]):
                raise _Damage(f"the check sum of the data section (bytes 0 to {start}) is wrong")
        elif opcode == Opcode.FOOTER:
            if data[end:] != MAGIC:
                raise _Damage(f"the end mark at byte {end} is missing or wrong")
            return
    raise _Damage(f"the file ends at byte {len(data)} without its end mark")


def _take_chunk(record: bytes, start: int, topics: dict[int, str], content: McapContent) -> None:
    chunk = _parse(Chunk.read, record, start)
    if chunk.uncompressed_size > LARGEST_CHUNK_BYTES:
        raise _Damage(f"the chunk at byte {start} claims {chunk.uncompressed_size} bytes")
    inner = _parse(lambda stream: get_chunk_data_stream(chunk, validate_crc=True), b"", start)[0]
    data = inner.read(chunk.uncompressed_size)
    for opcode, _, first, end in _records(data, 0, f"the chunk at byte {start}"):
        if opcode == Opcode.CHANNEL:
            _take_channel(data[first:end], start, topics)
        elif opcode == Opcode.MESSAGE:
            _take_message(data[first:end], start, topics, content)


def _take_channel(record: bytes, start: int, topics: dict[int, str]) -> None:
    channel = _parse(Channel.read, record, start)
    if channel.message_encoding != "json":
        raise _Damage(
            f"the channel {channel.topic!r} at byte {start} holds {channel.message_encoding!r}, not json"
        )
    topics[channel.id] = channel.topic


def _take_message(record: bytes, start: int, topics: dict[int, str], content: McapContent) -> None:
    if len(record) < _MESSAGE.size:
        raise _Damage(f"the record at byte {start} is damaged (short message)")
    channel, sequence, time_ns, _ = _MESSAGE.unpack_from(record)
    if channel not in topics:
        raise _Damage(f"the record at byte {start} is damaged (message of the unknown channel {channel})")
    content.messages.append((topics[channel], sequence, time_ns, record[_MESSAGE.size :]))


def _parse(read: Callable[[ReadDataStream], Any], record: bytes, start: int) -> Any:
    """A record by the library's parser, whose many ways to fail on damaged bytes become one."""
    try:
        return read(ReadDataStream(BytesIO(record)))
    except Exception as error:
        raise _Damage(f"the record at byte {start} is damaged ({error or type(error).__name__})") from error


def _refuse_constant(name: str) -> float:
    raise ValueError(f"{name} is no number of JSON")


_decoder = json.JSONDecoder(parse_constant=_refuse_constant)


def decode_json(data: bytes) -> Any:
    """The value of a message. Raises `ValueError` (or `RecursionError`) when it is no JSON, or NaN or infinite."""
    text = data.decode()
    value, end = _decoder.raw_decode(text)
    if end != len(text):
        raise ValueError(f"something follows the value at character {end}")
    return value
