"""I²C as the drivers use it: registers of one part, and the bus's faults by their names.

What Linux answers (Documentation/i2c/fault-codes.rst): EREMOTEIO, ENXIO, EIO or ENODEV (its drivers differ) for a
byte that nobody acknowledged, ETIMEDOUT when a transfer took too long, EAGAIN and EBUSY when a line is held by
somebody else.
"""

from __future__ import annotations

import errno
import threading
from collections.abc import Callable
from typing import TypeVar

from smbus2 import I2cFunc, i2c_msg

from hal.errors import BusStuck, DeviceError, NoAcknowledge, ReadFailed, ReadTimeout, ShortRead
from hal.raspberry_pi.ports import SmBus

T = TypeVar("T")

BLOCK_BYTES = 32
"""Longest block of an SMBus transaction (SMBus 2.0, 5.5.7)."""

_FAULTS: dict[int, type[ReadFailed]] = {
    errno.EREMOTEIO: NoAcknowledge,
    errno.ENXIO: NoAcknowledge,
    errno.EIO: NoAcknowledge,
    errno.ENODEV: NoAcknowledge,
    errno.ETIMEDOUT: ReadTimeout,
    errno.EAGAIN: BusStuck,
    errno.EBUSY: BusStuck,
}


def named_fault(error: OSError, where: str) -> ReadFailed:
    """The error that says what a failed transfer was."""
    kind = _FAULTS.get(error.errno or 0, ReadFailed)
    return kind(f"{where}: {error.strerror or error}")


def commanded(name: str, act: Callable[[], T]) -> T:
    """Do what an actuator was told; a failure on the wire is a `DeviceError`, no failed read."""
    try:
        return act()
    except (ReadFailed, OSError) as error:
        raise DeviceError(f"{name}: command not carried out ({error})") from error


class I2cBus:
    """One bus, shared by parts and threads: one transaction at a time."""

    def __init__(self, smbus: SmBus) -> None:
        self._smbus = smbus
        self._lock = threading.Lock()
        self.long_transfers = bool(smbus.funcs & I2cFunc.I2C)

    def run(self, where: str, transaction: Callable[[SmBus], T]) -> T:
        """Do one transaction. Raises a `ReadFailed` that names the fault."""
        try:
            with self._lock:
                return transaction(self._smbus)
        except OSError as error:
            raise named_fault(error, where) from error


class I2cPart:
    """Registers of the part at one address. Errors carry the name of the device that it serves."""

    def __init__(self, bus: I2cBus, address: int, name: str) -> None:
        self._bus = bus
        self._address = address
        self.name = name
        self._where = f"{name}: I2C {address:#04x}"

    def read(self, register: int, count: int) -> bytes:
        """Up to 32 bytes from successive registers."""
        data = self._bus.run(self._where, lambda bus: bus.read_i2c_block_data(self._address, register, count))
        return self._complete(bytes(data), count)

    def read_long(self, register: int, count: int, unit: int) -> bytes:
        """`count` bytes from a register that hands out units of `unit` bytes, in as few transactions as can be."""
        if self._bus.long_transfers:
            return self._complete(
                self._bus.run(self._where, lambda bus: self._combined(bus, register, count)), count
            )
        step = BLOCK_BYTES // unit * unit
        return b"".join(self.read(register, min(step, count - start)) for start in range(0, count, step))

    def _combined(self, bus: SmBus, register: int, count: int) -> bytes:
        question, answer = i2c_msg.write(self._address, [register]), i2c_msg.read(self._address, count)
        bus.i2c_rdwr(question, answer)
        return bytes(answer)

    def _complete(self, data: bytes, count: int) -> bytes:
        if len(data) != count:
            raise ShortRead(f"{self._where}: {len(data)} of {count} bytes came")
        return data

    def write(self, register: int, value: int) -> None:
        """One byte to one register."""
        self._bus.run(self._where, lambda bus: bus.write_byte_data(self._address, register, value))

    def set(self, register: int, value: int) -> None:
        """Write a register and read it back. Raises `DeviceError` when it did not take the value."""
        self.write(register, value)
        self._taken(register, value, self.read(register, 1)[0])

    def read_word(self, register: int) -> int:
        """A register of 16 bits, high byte first on the wire; unsigned."""
        return _swapped(self._bus.run(self._where, lambda bus: bus.read_word_data(self._address, register)))

    def write_word(self, register: int, value: int) -> None:
        """16 bits to a register, high byte first on the wire."""
        self._bus.run(self._where, lambda bus: bus.write_word_data(self._address, register, _swapped(value)))

    def set_word(self, register: int, value: int) -> None:
        """Like `set`, for 16 bits."""
        self.write_word(register, value)
        self._taken(register, value, self.read_word(register))

    def _taken(self, register: int, value: int, found: int) -> None:
        if found != value:
            raise DeviceError(
                f"{self._where}: register {register:#04x} holds {found:#x} where {value:#x} was written"
            )


def _swapped(word: int) -> int:
    """SMBus words travel low byte first, these parts' words high byte first."""
    return (word & 0xFF) << 8 | word >> 8 & 0xFF


def signed(word: int) -> int:
    """16 bits as two's complement."""
    return word - 0x10000 if word & 0x8000 else word
