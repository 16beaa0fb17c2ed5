"""Commands and telemetry as signed packets.

A command's data: sequence number (8 bytes), number of the command in the dictionary (2), arguments (count; then each
name with its length, and an IEEE double), and the first 16 bytes of an HMAC-SHA-256 over session, header and data.
The session is drawn by the robot at its start and comes with each telemetry packet, so that no command of an earlier
life is good again. Telemetry: session (8), topic (2), JSON text, signature; the channels are packed (`channels.py`).
"""

from __future__ import annotations

import hashlib
import hmac
import math
import struct
from dataclasses import dataclass

from hal.dictionary import dictionary
from hal.link.channels import TOPIC, pack_channels, unpack_channels
from hal.link.keys import Key
from hal.link.packets import BadPacket, SpacePacket

APID = 0x48
SESSION_BYTES = 8
SIGNATURE_BYTES = 16
_COMMAND = struct.Struct(">QHB")
_VALUE = struct.Struct(">d")
_TOPIC = struct.Struct(">H")
TOPIC_BYTES = _TOPIC.size


class BadSignature(BadPacket):
    """Not signed with the key, for this session."""


@dataclass(frozen=True)
class Command:
    """A command on the link."""

    sequence: int
    name: str
    arguments: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True)
class Telemetry:
    """A message to the ground: topic of the dictionary and JSON text."""

    topic: str
    text: str


def encode_command(command: Command, session: bytes, key: Key) -> bytes:
    """The packet of a command. Raises `KeyError` for a name that the dictionary lacks."""
    number = dictionary().commands[command.name].id
    body = _COMMAND.pack(command.sequence, number, len(command.arguments))
    for name, value in command.arguments:
        text = name.encode()
        body += bytes([len(text)]) + text + _VALUE.pack(value)
    return _signed(True, command.sequence, body, session, key)


def decode_command(raw: bytes, session: bytes, key: Key) -> Command:
    """The command in a packet; its signature is checked before anything else. Raises `BadPacket`."""
    body = _checked(raw, True, session, key)
    if len(body) < _COMMAND.size:
        raise BadPacket("a command that is too short")
    sequence, number, count = _COMMAND.unpack_from(body)
    names = {entry.id: name for name, entry in dictionary().commands.items()}
    if number not in names:
        raise BadPacket(f"command number {number} is not in the dictionary")
    return Command(sequence, names[number], _arguments(body[_COMMAND.size :], count))


def _arguments(body: bytes, count: int) -> tuple[tuple[str, float], ...]:
    found = []
    for _ in range(count):
        length = body[0] if body else 0
        if len(body) < 1 + length + _VALUE.size:
            raise BadPacket("arguments that are cut")
        (value,) = _VALUE.unpack_from(body, 1 + length)
        if not math.isfinite(value):
            raise BadPacket("an argument that is not finite")
        try:
            found.append((body[1 : 1 + length].decode("ascii"), value))
        except UnicodeDecodeError as error:
            raise BadPacket("an argument whose name is no text") from error
        body = body[1 + length + _VALUE.size :]
    if body:
        raise BadPacket("something follows the arguments")
    return tuple(found)


def encode_telemetry(message: Telemetry, count: int, session: bytes, key: Key) -> bytes:
    """The packet of a telemetry message. Raises `KeyError` for a topic that the dictionary lacks.

    Raises `BadPacket` for channels that cannot be packed.
    """
    content = pack_channels(message.text) if message.topic == TOPIC else message.text.encode()
    body = session + _TOPIC.pack(dictionary().topics[message.topic]) + content
    return _signed(False, count, body, session, key)


def decode_telemetry(raw: bytes, key: Key) -> tuple[bytes, Telemetry]:
    """Session and message of a telemetry packet. Raises `BadPacket`."""
    session = SpacePacket.decode(raw).data[:SESSION_BYTES]
    body = _checked(raw, False, session, key)[SESSION_BYTES:]
    names = {number: name for name, number in dictionary().topics.items()}
    if len(body) < _TOPIC.size or (number := _TOPIC.unpack_from(body)[0]) not in names:
        raise BadPacket("telemetry of an unknown topic")
    content = body[_TOPIC.size :]
    if names[number] == TOPIC:
        return session, Telemetry(TOPIC, unpack_channels(content))
    return session, Telemetry(names[number], content.decode("utf-8", errors="replace"))


def _signed(telecommand: bool, count: int, body: bytes, session: bytes, key: Key) -> bytes:
    count %= 1 << 14
    unsigned = SpacePacket(telecommand, APID, count, body + bytes(SIGNATURE_BYTES)).encode()[
        :-SIGNATURE_BYTES
    ]
    return unsigned + _signature(unsigned, session, key)


def _checked(raw: bytes, telecommand: bool, session: bytes, key: Key) -> bytes:
    """The body of a packet whose signature holds."""
    packet = SpacePacket.decode(raw)
    if packet.telecommand != telecommand or packet.apid != APID:
        raise BadPacket("a packet for somebody else")
    if len(packet.data) <= SIGNATURE_BYTES:
        raise BadPacket("a packet without a signature")
    expected = _signature(raw[:-SIGNATURE_BYTES], session, key)
    if not hmac.compare_digest(expected, raw[-SIGNATURE_BYTES:]):
        raise BadSignature("not signed for this session")
    return packet.data[:-SIGNATURE_BYTES]


def _signature(unsigned: bytes, session: bytes, key: Key) -> bytes:
    return hmac.digest(key.secret, session + unsigned, hashlib.sha256)[:SIGNATURE_BYTES]
