"""The ground's end of the link: sends signed commands, takes telemetry and acknowledgements."""

from __future__ import annotations

import json
from typing import Any

from hal.link.framing import Deframer, framed
from hal.link.keys import Key
from hal.link.messages import Command, Telemetry, decode_telemetry, encode_command
from hal.link.packets import BadPacket
from hal.link.streams import ByteStream


class GroundStation:
    """Talks to one robot. It can command once it has heard the robot's session."""

    def __init__(self, stream: ByteStream, key: Key, longest_packet_bytes: int) -> None:
        self._stream, self._key = stream, key
        self._deframer = Deframer(longest_packet_bytes)
        self._sequence = 0
        self.session: bytes | None = None

    def poll(self) -> list[Telemetry]:
        """The telemetry that has arrived; what is not signed is left out."""
        messages = []
        while data := self._stream.read(65536):
            for packet in self._deframer.feed(data):
                try:
                    session, message = decode_telemetry(packet, self._key)
                except BadPacket:
                    continue
                if session != self.session:
                    self.session, self._sequence = session, 0
                messages.append(message)
        return messages

    def command(self, name: str, arguments: tuple[tuple[str, float], ...] = ()) -> bytes:
        """Send a command; returns its frame. Raises `BadPacket` while no session is known."""
        if self.session is None:
            raise BadPacket("the robot has not been heard yet")
        self._sequence += 1
        frame = framed(encode_command(Command(self._sequence, name, arguments), self.session, self._key))
        self._stream.write(frame)
        return frame


def acknowledgements(messages: list[Telemetry]) -> list[dict[str, Any]]:
    """The acknowledgements among messages, as data."""
    return [json.loads(message.text) for message in messages if message.topic == "acknowledgement"]
