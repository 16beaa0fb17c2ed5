"""Quadrature counter LS7366R (LSI Computer Systems, data sheet 7366R-102907) on SPI.

First byte of a transfer: what to do in bits 7-6 (00 clear, 01 read, 10 write), with which register in bits 5-3 (001
MDR0, 010 MDR1, 100 CNTR, 110 STR). MDR0 = 03h: four counts a cycle, free-running, no index. MDR1 = 00h: four
bytes, counting. STR: power-loss latch PLS bit 2, set at power-up until STR is cleared.

It sits on SPI because the kernel's spidev needs no further package (`hal.raspberry_pi.kernel`) and that bus is
free. The kernel's own counting of pins by interrupts loses edges at this encoder's 200 000 a second.
"""

from __future__ import annotations

import struct

from hal.errors import DeviceError, DeviceReset
from hal.raspberry_pi.ports import SpiPort
from hal.raspberry_pi.wire import named_fault

CLEAR_STATUS, WRITE_MDR0, WRITE_MDR1, READ_MDR0, READ_MDR1, READ_COUNT, READ_STATUS = (
    0x30, 0x88, 0x90, 0x48, 0x50, 0x60, 0x70,
)  # fmt: skip
FOUR_FOLD, FOUR_BYTES = 0x03, 0x00
POWER_LOSS = 0x04


class Ls7366r:
    """The counter; a count that was lost with the power is an error, not a position."""

    def __init__(self, name: str, spi: SpiPort) -> None:
        """Set up the part. Raises `DeviceError` when it does not take its settings."""
        self._name, self._spi = name, spi
        self._transfer(bytes((WRITE_MDR0, FOUR_FOLD)))
        self._transfer(bytes((WRITE_MDR1, FOUR_BYTES)))
        self._transfer(bytes((CLEAR_STATUS,)))
        found = (self._register(READ_MDR0), self._register(READ_MDR1))
        if found != (FOUR_FOLD, FOUR_BYTES):
            raise DeviceError(
                f"{name}: MDR0 and MDR1 read {found[0]:#04x} and {found[1]:#04x} after being set"
            )

    def encoder_count(self) -> int:
        """The count, signed. Raises `DeviceReset` after a loss of power, `ReadFailed` when the bus fails."""
        # no acknowledgement on SPI: an absent part shows in its mode register
        if self._register(READ_STATUS) & POWER_LOSS or self._register(READ_MDR0) != FOUR_FOLD:
            raise DeviceReset(f"{self._name}: the counter lost its power, and the count with it")
        return int(struct.unpack(">i", self._transfer(bytes((READ_COUNT, 0, 0, 0, 0)))[1:])[0])

    def close(self) -> None:
        """Give the bus back. May be called again."""
        self._spi.close()

    def _register(self, code: int) -> int:
        return self._transfer(bytes((code, 0)))[1]

    def _transfer(self, data: bytes) -> bytes:
        try:
            return self._spi.transfer(data)
        except OSError as error:
            raise named_fault(error, f"{self._name}: SPI") from error
