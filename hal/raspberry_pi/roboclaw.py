"""Packet serial of the RoboClaw motor controllers (Basicmicro, RoboClaw series user manual, "Packet Serial").

A command is address, number and data, ended by CRC16 (polynomial 1021h, start 0, high byte first) over all of it;
the controller answers FFh. A question is address and number; the answer is data and the CRC over question and data.
Used here: 14 and 15 set and read the serial timeout (digits of 100 ms; the motors stop after it), 16 reads
encoder 1 (four bytes and a status byte), 21 the firmware's name (ends with a line feed and a zero), 24 the main
battery (0.1 V), 32 drives motor 1 with a signed duty (32767 is all of it), 49 reads both currents (10 mA).
"""

from __future__ import annotations

import binascii
import struct
import threading
from collections.abc import Callable

from hal.errors import BadChecksum, DeviceReset, ReadFailed, ReadTimeout, ShortRead, WrongDevice
from hal.raspberry_pi.ports import SerialPort
from hal.raspberry_pi.settings import RoboClawSettings
from hal.raspberry_pi.wire import commanded

SET_SERIAL_TIMEOUT, READ_SERIAL_TIMEOUT, READ_ENCODER_1, READ_FIRMWARE, READ_BATTERY, DRIVE_1, READ_CURRENTS = (
    14, 15, 16, 21, 24, 32, 49,
)  # fmt: skip
ACKNOWLEDGE = b"\xff"
FULL_DUTY = 32767
FIRMWARE_BYTES = 48
NAME = b"RoboClaw"


def crc16(data: bytes) -> bytes:
    """The two bytes that end a packet (CRC-16/XMODEM, which is what `binascii.crc_hqx` computes)."""
    return struct.pack(">H", binascii.crc_hqx(data, 0))


class RoboClaw:
    """One controller at the end of a serial line; used by motor and encoder alike."""

    def __init__(self, port: SerialPort, settings: RoboClawSettings) -> None:
        """Stop the motor, then have the controller stop it whenever this software is silent for too long.

        Raises `WrongDevice` or a `ReadFailed`.
        """
        self._port, self._settings = port, settings
        self._name = f"motor controller at {settings.port}"
        self._lock = threading.Lock()
        self._timeout_digits = round(settings.watchdog_s * 10.0)
        self.drive(0)
        firmware = self._firmware()
        if NAME not in firmware:
            raise WrongDevice(f"{self._name}: its firmware is {firmware!r}, no RoboClaw's")
        self._command(SET_SERIAL_TIMEOUT, bytes((self._timeout_digits,)))
        self.verify()

    def drive(self, duty: int) -> None:
        """Motor 1 at this duty, -32767 to 32767. Raises `DeviceError` when it is not acknowledged."""
        commanded(self._name, lambda: self._command(DRIVE_1, struct.pack(">h", duty)))

    def encoder_count(self) -> int:
        """Count of encoder 1, signed, and that the controller still has its settings.

        Raises `DeviceReset` after a brown-out, in which the count was lost too.
        """
        count, _ = struct.unpack(">iB", self._ask(READ_ENCODER_1, 5))
        self.verify()
        return int(count)

    def battery_v(self) -> float:
        """The motors' supply."""
        return float(struct.unpack(">H", self._ask(READ_BATTERY, 2))[0]) * 0.1

    def motor_current_a(self) -> float:
        """Current of motor 1, in steps of 10 mA."""
        return float(struct.unpack(">hh", self._ask(READ_CURRENTS, 4))[0]) * 0.01

    def verify(self) -> None:
        """Raise `DeviceReset` when the serial timeout is not the one that was set: it starts up with another."""
        found = self._ask(READ_SERIAL_TIMEOUT, 1)[0]
        if found != self._timeout_digits:
            raise DeviceReset(
                f"{self._name}: serial timeout is {found} x 0.1 s, set were {self._timeout_digits}"
            )

    def close(self) -> None:
        """Give the line back. May be called again."""
        self._port.close()

    def _firmware(self) -> bytes:
        """Name of the firmware; its length is known by its end only."""
        question = self._question(READ_FIRMWARE)
        with self._lock:
            self._send(question)
            answer = b""
            while not answer.endswith(b"\n\0") and len(answer) < FIRMWARE_BYTES:
                answer += self._receive(1)
            self._check(question + answer, self._receive(2))
        return answer

    def _question(self, number: int) -> bytes:
        return bytes((self._settings.address, number))

    def _ask(self, number: int, count: int) -> bytes:
        question = self._question(number)

        def exchange() -> bytes:
            self._send(question)
            answer = self._receive(count + 2)
            self._check(question + answer[:-2], answer[-2:])
            return answer[:-2]

        return self._repeat(exchange)

    def _command(self, number: int, data: bytes) -> None:
        packet = self._question(number) + data

        def exchange() -> bytes:
            self._send(packet + crc16(packet))
            answer = self._receive(1)
            if answer != ACKNOWLEDGE:
                raise BadChecksum(f"{self._name}: {answer.hex()} came for an acknowledgement")
            return answer

        self._repeat(exchange)

    def _repeat(self, exchange: Callable[[], bytes]) -> bytes:
        """All commands can be repeated without harm: they say what shall be, not what shall change."""
        with self._lock:
            for left in range(self._settings.retries, -1, -1):
                try:
                    return exchange()
                except ReadFailed:
                    self._port.reset_input_buffer()
                    if left == 0:
                        raise
        raise AssertionError("not reached")

    def _send(self, packet: bytes) -> None:
        try:
            self._port.write(packet)
        except OSError as error:  # a USB line that was unplugged
            raise ReadFailed(f"{self._name}: cannot be written to ({error})") from error

    def _receive(self, count: int) -> bytes:
        try:
            data = self._port.read(count)
        except OSError as error:
            raise ReadFailed(f"{self._name}: cannot be read ({error})") from error
        if not data:
            raise ReadTimeout(f"{self._name}: no answer within {self._settings.reply_timeout_s:g} s")
        if len(data) < count:
            raise ShortRead(f"{self._name}: {len(data)} of {count} bytes came")
        return data

    def _check(self, covered: bytes, crc: bytes) -> None:
        if crc16(covered) != crc:
            raise BadChecksum(f"{self._name}: CRC is {crc.hex()}, its data give {crc16(covered).hex()}")
