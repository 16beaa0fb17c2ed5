"""The robot's end of the link: a `GroundLink` that lets nothing pass but fresh, signed commands in order."""

from __future__ import annotations

import json
from collections import deque
from dataclasses import dataclass
from typing import Annotated

from hal.config import Limits
from hal.devices import Clock
from hal.errors import DeviceClosed, DeviceError
from hal.link.framing import Deframer, framed
from hal.link.keys import Key
from hal.link.messages import BadSignature, Command, Telemetry, decode_command, encode_telemetry
from hal.link.packets import BadPacket
from hal.link.streams import ByteStream
from hal.readings import GroundCommand


@dataclass(frozen=True)
class LinkSettings:
    """Bounds of the link (`config/link.yaml`)."""

    baud: Annotated[int, Limits(300, 4_000_000)]
    longest_packet_bytes: Annotated[int, Limits(64, 65_000)]
    read_bytes_per_tick: Annotated[int, Limits(64, 1_000_000)]
    waiting_bytes: Annotated[int, Limits(1024, 100_000_000)]
    commands_per_s: Annotated[float, Limits(0.1, 1000.0)]
    burst: Annotated[int, Limits(1, 1000)]


class RobotLink:
    """Commands in, telemetry out, over a stream. `session` is drawn anew at each start."""

    def __init__(
        self, stream: ByteStream, key: Key, session: bytes, clock: Clock, settings: LinkSettings
    ) -> None:
        self._stream, self._key, self._session, self._clock = stream, key, session, clock
        self._settings = settings
        self._deframer = Deframer(settings.longest_packet_bytes)
        self._last_sequence = 0
        self._waiting: deque[bytes] = deque()
        self._waiting_bytes = 0
        self._count = 0
        self._tokens = float(settings.burst)
        self._token_s: float | None = None
        self._closed = False
        self.refused = 0
        self.dropped = 0
        """Telemetry frames dropped because the line is too slow, the oldest first."""

    @property
    def held_bytes(self) -> int:
        """Bytes that wait: of an unfinished frame, and of telemetry."""
        return self._deframer.held_bytes + self._waiting_bytes

    def receive(self) -> tuple[GroundCommand, ...]:
        """The commands that arrived since the last call, oldest first; each is acknowledged, or refused with why."""
        self._require_open()
        now_s = self._clock.now_s()
        self._flush()
        try:
            data = self._stream.read(self._settings.read_bytes_per_tick)
        except DeviceError:
            return ()  # a line that is gone is a ground that is silent
        commands = []
        for packet in self._deframer.feed(data):
            command, why = self._judge(packet, now_s)
            if command is not None and not why:
                commands.append(GroundCommand(now_s, command.name, command.arguments, True, command.sequence))
            if why:
                self.refused += 1
            if command is not None:
                self._acknowledge(command, why)
        return tuple(commands)

    def send(self, topic: str, payload: str) -> None:
        """Hand one telemetry message to the ground; when the line is too slow, the oldest are dropped."""
        self._require_open()
        self._count += 1
        frame = framed(encode_telemetry(Telemetry(topic, payload), self._count, self._session, self._key))
        self._waiting.append(frame)
        self._waiting_bytes += len(frame)
        while self._waiting_bytes > self._settings.waiting_bytes:
            self._waiting_bytes -= len(self._waiting.popleft())
            self.dropped += 1
        self._flush()

    def close(self) -> None:
        """Give the line back. May be called again."""
        if not self._closed:
            self._stream.close()
        self._closed = True

    def _judge(self, packet: bytes, now_s: float) -> tuple[Command | None, str]:
        """The command in a packet, if it is signed, and why it is refused, if it is.

        What is not signed gets no answer: nobody shall make the robot talk without the key.
        """
        try:
            command = decode_command(packet, self._session, self._key)
        except BadSignature:
            return None, "signature"
        except BadPacket as error:
            return None, str(error)
        if command.sequence <= self._last_sequence:
            return command, f"sequence {command.sequence} is not after {self._last_sequence}"
        self._last_sequence = command.sequence
        return command, "" if self._allowed(now_s) else "too many commands"

    def _allowed(self, now_s: float) -> bool:
        """Whether the rate of commands leaves room for one more (token bucket)."""
        elapsed_s = 0.0 if self._token_s is None else max(0.0, now_s - self._token_s)
        self._token_s = now_s
        most = float(self._settings.burst)
        self._tokens = min(most, self._tokens + elapsed_s * self._settings.commands_per_s)
        if self._tokens < 1.0:
            return False
        self._tokens -= 1.0
        return True

    def _acknowledge(self, command: Command, why: str) -> None:
        taken = {"name": "link", "command": command.name, "sequence": command.sequence, "why": why}
        self.send("acknowledgement", json.dumps(taken))

    def _flush(self) -> None:
        try:
            while self._waiting:
                frame = self._waiting[0]
                sent = self._stream.write(frame)
                self._waiting_bytes -= sent
                if sent < len(frame):
                    self._waiting[0] = frame[sent:]
                    return
                self._waiting.popleft()
        except DeviceError:
            return

    def _require_open(self) -> None:
        if self._closed:
            raise DeviceClosed("ground_link: used after it was closed")
