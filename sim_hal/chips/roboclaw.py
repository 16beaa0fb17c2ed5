"""A RoboClaw motor controller on a pseudo-terminal (`hal.raspberry_pi.roboclaw` cites the manual).

The line is a real terminal of this computer's kernel and pyserial runs on it; but whenever the driver has written,
the controller is served at once in the same thread, so that no answer depends on when a thread is scheduled.
"""

from __future__ import annotations

import binascii
import math
import os
import select
import struct
import tty
from collections.abc import Callable
from typing import Any

import serial

from sim_hal.chips.faults import WireFaults
from sim_hal.chips.rig import ChipRig, Signal

PLACE = "motor_controller"
PATIENCE_S = 2.0
"""Longest wait for the kernel to carry bytes from one end of the terminal to the other."""


class ServedLine(serial.Serial):
    """A serial line whose other end is served whenever something was written."""

    def __init__(self, path: str, serve: Callable[[int], int], **settings: Any) -> None:
        self._serve = serve
        super().__init__(path, **settings)

    def write(self, data: Any, /) -> int | None:
        """Write, and let the other end answer."""
        written = super().write(data)
        answered = self._serve(written or 0)
        if answered:
            while self.in_waiting < answered:
                select.select([self.fileno()], [], [], PATIENCE_S)
        return written


class RoboClawChip:
    """The controller: motor 1 on the rig's motor, encoder 1 on its nut."""

    FULL_DUTY = 32767
    NAME = b"USB RoboClaw 2x15a v4.2.8\n\0"
    DATA_BYTES = {14: 1, 15: 0, 16: 0, 20: 0, 21: 0, 24: 0, 32: 2, 49: 0}  # noqa: RUF012  of each command
    COMMANDS = (14, 20, 32)

    def __init__(
        self, rig: ChipRig, faults: WireFaults, nut: Signal, current: Callable[[], float], address: int,
        supply_v: float, m_per_count: float, sign: int,
    ) -> None:  # fmt: skip
        self._rig, self._faults, self._nut, self._current = rig, faults, nut, current
        self._address, self._supply_v = address, supply_v
        self._counts_per_m = sign / m_per_count
        self._sign = sign
        self._master, slave = os.openpty()
        tty.setraw(slave)
        self._slave = slave
        self.path = os.ttyname(slave)
        self._pending = b""
        self.reset()

    def reset(self) -> None:
        """As at power-up: motor off, count zero, no serial timeout."""
        self._timeout_digits = 0
        self._heard_s = self._rig.now_s
        self._zero_m = self._nut.newest()
        self._duty = 0
        self._rig.command_voltage_v(0.0)

    def open_line(self, baud: int, timeout_s: float) -> ServedLine:
        """The near end of the line. Writing has no timeout: a busy computer must not look like a fault."""
        return ServedLine(self.path, self.serve, baudrate=baud, timeout=timeout_s)

    def close(self) -> None:
        """Unplug. May be called again."""
        if self._master >= 0:
            os.close(self._master)
            os.close(self._slave)
        self._master = -1

    def deadline_s(self) -> float:
        """When the serial timeout stops the motor."""
        running = self._timeout_digits and self._duty
        return self._heard_s + 0.1 * self._timeout_digits if running else math.inf

    def act(self) -> None:
        """Nothing was heard for too long: stop the motor."""
        self._drive(0)

    def serve(self, count: int) -> int:
        """Take `count` bytes from the line and answer what they ask; returns the length of the answer."""
        received = b""
        while len(received) < count:
            if not select.select([self._master], [], [], PATIENCE_S)[0]:
                raise TimeoutError("pseudo-terminal: what was written does not arrive")
            received += os.read(self._master, count - len(received))
        answer = self._damaged(self._answer(received))
        if answer:
            os.write(self._master, answer)
        return len(answer)

    def _answer(self, packet: bytes) -> bytes:
        """A driver writes whole packets; a packet that is not in order is not answered."""
        if len(packet) < 2 or packet[0] != self._address or packet[1] not in self.DATA_BYTES:
            return b""
        number, data = packet[1], packet[2:]
        if number in self.COMMANDS:
            body, crc = packet[:-2], packet[-2:]
            if len(data) != self.DATA_BYTES[number] + 2 or _crc(body) != crc:
                return b""
            self._heard_s = self._rig.now_s
            self._obey(number, data[:-2])
            return b"\xff"
        if number == 16 and self._rig.faults.active("nut_encoder", self._rig.now_s) == "fail":
            return b""
        self._heard_s = self._rig.now_s
        answer = self._report(number)
        return answer + _crc(packet + answer)

    def _obey(self, number: int, data: bytes) -> None:
        if number == 14:
            self._timeout_digits = data[0]
        elif number == 20:
            self._zero_m = self._nut.newest()
        else:
            self._drive(struct.unpack(">h", data)[0])

    def _drive(self, duty: int) -> None:
        self._duty = duty
        self._rig.command_voltage_v(self._sign * duty / self.FULL_DUTY * self._supply_v)

    def _report(self, number: int) -> bytes:
        if number == 15:
            return bytes((self._timeout_digits,))
        if number == 16:
            count = round((self._nut.newest() - self._zero_m) * self._counts_per_m)
            return struct.pack(">iB", count, 0)
        if number == 21:
            return self.NAME
        if number == 24:
            return struct.pack(">H", round(self._supply_v * 10.0))
        return struct.pack(">hh", round(self._sign * self._current() * 100.0), 0)

    def _damaged(self, answer: bytes) -> bytes:
        fault = self._faults.active(PLACE, self._rig.now_s)
        if self._rig.faults.active("motor", self._rig.now_s) == "fail":
            return b""
        if fault is None:
            return answer
        if fault.kind == "brown_out":
            fault.used += 1
            self.reset()
            return b""
        if fault.kind == "crc":
            return bytes((answer[0] ^ 0x55,)) + answer[1:]
        if fault.kind == "short" or (fault.kind == "unplug" and not fault.used and len(answer) > 1):
            fault.used += 1
            return answer[: len(answer) // 2]
        return b""


def _crc(data: bytes) -> bytes:
    return struct.pack(">H", binascii.crc_hqx(data, 0))
