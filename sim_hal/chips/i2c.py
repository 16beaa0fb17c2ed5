"""An I²C bus with chips on it, behind the calls of `smbus2.SMBus`, with the faults that a bus can have."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Iterable
from typing import Any, Protocol

from smbus2 import I2cFunc

from sim_hal.chips.faults import WireFaults

ALL_ONES = 0xFF
"""What a master reads when nobody drives the line."""

FUNCTIONS = I2cFunc.I2C | I2cFunc.SMBUS_BYTE_DATA | I2cFunc.SMBUS_WORD_DATA | I2cFunc.SMBUS_READ_I2C_BLOCK


class Chip(Protocol):
    """A part on the bus, by what passes over the wire."""

    def write(self, data: bytes) -> None:
        """The bytes after the address: register, then values."""

    def read(self, count: int) -> bytes:
        """The next bytes, from the register that was written last."""

    def reset(self) -> None:
        """All registers as at power-up."""


class EmulatedBus:
    """One bus. `chips` are by address; the name of each is its device on the board."""

    def __init__(
        self,
        chips: Iterable[tuple[int, str, Chip]],
        faults: WireFaults,
        broken: Callable[[str], bool],
        now_s: Callable[[], float],
        funcs: I2cFunc = FUNCTIONS,
    ) -> None:
        """`broken` tells of a device that it does not answer at all; `funcs` what the adapter can do."""
        self._chips = {address: (name, chip) for address, name, chip in chips}
        self._faults, self._broken, self._now_s = faults, broken, now_s
        self.funcs = funcs
        self.transactions = 0

    def write_byte_data(self, i2c_addr: int, register: int, value: int) -> None:
        self._transfer(i2c_addr, bytes((register, value)), 0)

    def read_i2c_block_data(self, i2c_addr: int, register: int, length: int) -> list[int]:
        data = self._transfer(i2c_addr, bytes((register,)), length)
        fault = self._fault(i2c_addr)
        return list(data[: length // 2] if fault == "short" else data)

    def read_word_data(self, i2c_addr: int, register: int) -> int:
        return int.from_bytes(self._transfer(i2c_addr, bytes((register,)), 2), "little")

    def write_word_data(self, i2c_addr: int, register: int, value: int) -> None:
        self._transfer(i2c_addr, bytes((register,)) + value.to_bytes(2, "little"), 0)

    def i2c_rdwr(self, *i2c_msgs: Any) -> None:
        """A write followed by a read, as one transaction."""
        question, answer = i2c_msgs
        data = self._transfer(question.addr, bytes(question), answer.len)
        for index, value in enumerate(data):
            answer.buf[index] = value.to_bytes(1, "little")

    def close(self) -> None:
        """The chips stay as they are."""

    def _fault(self, address: int) -> str | None:
        name = self._chips[address][0]
        fault = self._faults.active(name, self._now_s())
        return fault.kind if fault else None

    def _transfer(self, address: int, sent: bytes, count: int) -> bytes:
        self.transactions += 1
        now_s = self._now_s()
        for name, _ in self._chips.values():
            if (fault := self._faults.active(name, now_s)) and fault.kind == "stuck":
                raise OSError(errno.EBUSY, os.strerror(errno.EBUSY))
        name, chip = self._chips.get(address, ("", None))
        if chip is None or self._broken(name):
            raise OSError(errno.EREMOTEIO, os.strerror(errno.EREMOTEIO))
        fault = self._faults.active(name, now_s)
        if fault is None:
            return _exchange(chip, sent, count)
        return self._faulty(fault.kind, chip, sent, count, name)

    def _faulty(self, kind: str, chip: Chip, sent: bytes, count: int, name: str) -> bytes:
        fault = self._faults.active(name, self._now_s())
        assert fault is not None
        if kind == "nack" or (kind == "unplug" and fault.used):
            raise OSError(errno.EREMOTEIO, os.strerror(errno.EREMOTEIO))
        if kind == "timeout":
            raise OSError(errno.ETIMEDOUT, os.strerror(errno.ETIMEDOUT))
        if kind == "brown_out":
            fault.used += 1
            chip.reset()
        data = _exchange(chip, sent, count)
        if kind == "crc":
            data = bytes(value ^ 0x55 for value in data)
        if kind == "unplug" and count > 1:
            fault.used += 1
            data = data[: count // 2] + bytes((ALL_ONES,)) * (count - count // 2)
        return data


def _exchange(chip: Chip, sent: bytes, count: int) -> bytes:
    chip.write(sent)
    return chip.read(count) if count else b""
