"""The Linux kernel's interfaces, opened for the drivers: I²C, serial lines, SPI, pins, PWM files, watchdog."""

from __future__ import annotations

import ctypes
import errno
import fcntl
import os
import struct
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import serial
import smbus2

from hal.raspberry_pi.clock import MonotonicClock, ThreadSampler
from hal.raspberry_pi.ports import SerialPort, SmBus
from hal.raspberry_pi.service_manager import ServiceManager

T = TypeVar("T")

PIN_CHIPS = ("pinctrl-bcm2835", "pinctrl-bcm2711", "pinctrl-rp1")
"""Labels of the pin header's controller: Raspberry Pi up to 3, 4, 5 (its number differs from kernel to kernel)."""

SPI_WRITE_MODE, SPI_WRITE_SPEED, SPI_MESSAGE_1 = 0x40016B01, 0x40046B04, 0x40206B00
"""linux/spi/spidev.h: SPI_IOC_WR_MODE, SPI_IOC_WR_MAX_SPEED_HZ, SPI_IOC_MESSAGE(1)."""

WATCHDOG_KEEP_ALIVE, WATCHDOG_SET_TIMEOUT = 0x80045705, 0xC0045706
"""linux/watchdog.h: WDIOC_KEEPALIVE, WDIOC_SETTIMEOUT."""

MAGIC_CLOSE = b"V"
"""Written before closing it stops the watchdog (Documentation/watchdog/watchdog-api.rst)."""


class SysfsFiles:
    """The kernel's files below `root`."""

    def __init__(self, root: Path = Path("/sys")) -> None:
        self._root = root

    def write(self, path: str, text: str) -> None:
        """Raises `OSError` as the kernel answers."""
        (self._root / path).write_text(text, encoding="ascii")

    def read(self, path: str) -> str:
        """Content without the newline at its end."""
        return (self._root / path).read_text(encoding="ascii").rstrip("\n")

    def exists(self, path: str) -> bool:
        """Whether there is such a file or folder."""
        return (self._root / path).exists()


class SpidevPort:
    """One device of the kernel's spidev, mode 0."""

    def __init__(self, device: str, speed_hz: int) -> None:
        self._file = os.open(device, os.O_RDWR | os.O_CLOEXEC)
        self._speed_hz = speed_hz
        fcntl.ioctl(self._file, SPI_WRITE_MODE, bytes(1))
        fcntl.ioctl(self._file, SPI_WRITE_SPEED, struct.pack("I", speed_hz))

    def transfer(self, data: bytes) -> bytes:
        """Clock `data` out and the same number of bytes in, with the device selected."""
        sent = ctypes.create_string_buffer(data, len(data))
        received = ctypes.create_string_buffer(len(data))
        # struct spi_ioc_transfer: buffers, length, speed, delay, bits a word, five fields left at their defaults
        message = struct.pack(
            "QQIIHBBBBBx",
            *(ctypes.addressof(sent), ctypes.addressof(received), len(data), self._speed_hz),
            *(0, 8, 0, 0, 0, 0),
        )
        fcntl.ioctl(self._file, SPI_MESSAGE_1, message)
        return received.raw

    def close(self) -> None:
        """Give the device back. May be called again."""
        if self._file >= 0:
            os.close(self._file)
        self._file = -1


class KernelWatchdog:
    """/dev/watchdog, armed by being opened, and the service manager's watchdog beside it."""

    def __init__(self, device: str, timeout_s: int) -> None:
        self._manager = ServiceManager()
        self._file = os.open(device, os.O_WRONLY | os.O_CLOEXEC)
        try:
            answer = fcntl.ioctl(self._file, WATCHDOG_SET_TIMEOUT, struct.pack("i", timeout_s))
            found = struct.unpack("i", answer)[0]
            if found != timeout_s:
                raise OSError(errno.EINVAL, f"took {found} s for its timeout, not {timeout_s} s", device)
        except OSError:
            self.disarm()
            raise

    def keep_alive(self) -> None:
        """Restart its time."""
        fcntl.ioctl(self._file, WATCHDOG_KEEP_ALIVE, bytes(4))
        self._manager.stroke()

    def disarm(self) -> None:
        """Stop it without a reset. May be called again."""
        self._manager.close()
        if self._file >= 0:
            os.write(self._file, MAGIC_CLOSE)
            os.close(self._file)
        self._file = -1


class LgpioPins:
    """Pins through the kernel's character device, by the library lgpio."""

    def __init__(self, labels: Sequence[str] = PIN_CHIPS) -> None:
        """Open the first chip that has one of these labels. Raises `OSError` when there is none, or no library."""
        try:
            import lgpio  # on the robot only: `pip install 'hopper-flight[rpi]'`
        except ImportError as error:
            raise OSError(
                errno.ENOPKG, "library lgpio is not installed: pip install 'hopper-flight[rpi]'"
            ) from error
        self._lgpio: Any = lgpio
        self._chip = self._open(labels)

    def _open(self, labels: Sequence[str]) -> int:
        for path in sorted(Path("/dev").glob("gpiochip*")):
            chip: int = self._asked(
                partial(self._lgpio.gpiochip_open, int(path.name.removeprefix("gpiochip")))
            )
            if self._lgpio.gpio_get_chip_info(chip)[3] in labels:
                return chip
            self._lgpio.gpiochip_close(chip)
        raise OSError(errno.ENODEV, f"no /dev/gpiochip* is one of {', '.join(labels)}")

    def claim_output(self, pin: int, level: bool) -> None:
        """Drive the pin from now on, first with `level`."""
        self._asked(lambda: self._lgpio.gpio_claim_output(self._chip, pin, int(level)))

    def claim_input(self, pin: int) -> None:
        """Listen at the pin, pulled up where the controller can do that."""
        try:
            self._asked(lambda: self._lgpio.gpio_claim_input(self._chip, pin, self._lgpio.SET_PULL_UP))
        except OSError:
            self._asked(lambda: self._lgpio.gpio_claim_input(self._chip, pin))

    def write(self, pin: int, level: bool) -> None:
        """Drive an output."""
        self._asked(lambda: self._lgpio.gpio_write(self._chip, pin, int(level)))

    def read(self, pin: int) -> bool:
        """Level of a pin."""
        return bool(self._asked(lambda: self._lgpio.gpio_read(self._chip, pin)))

    def close(self) -> None:
        """Give all pins back, as inputs. May be called again."""
        if self._chip >= 0:
            self._lgpio.gpiochip_close(self._chip)
        self._chip = -1

    def _asked(self, call: Callable[[], T]) -> T:
        try:
            return call()
        except self._lgpio.error as error:
            raise OSError(errno.EIO, f"GPIO: {error}") from error


class KernelPorts:
    """Everything opened from the kernel of this computer; closed together, last opened first."""

    def __init__(self) -> None:
        self._opened: list[Callable[[], None]] = []
        self.clock = MonotonicClock()
        self.sysfs = SysfsFiles()
        self.pins = LgpioPins()
        self._opened.append(self.pins.close)
        self.sampler = ThreadSampler(self.clock)
        self._opened.append(self.sampler.close)
        self._buses: dict[int, SmBus] = {}

    def i2c(self, bus: int) -> SmBus:
        """Bus /dev/i2c-N, the same one for all that share it."""
        if bus not in self._buses:
            self._buses[bus] = smbus2.SMBus(bus)
            self._opened.append(self._buses[bus].close)
        return self._buses[bus]

    def serial(self, port: str, baud: int, timeout_s: float) -> SerialPort:
        """A serial line, for this process alone."""
        line = serial.Serial(port, baud, timeout=timeout_s, write_timeout=timeout_s, exclusive=True)
        self._opened.append(line.close)
        return line

    def spi(self, device: str, speed_hz: int) -> SpidevPort:
        """A device /dev/spidevB.C."""
        port = SpidevPort(device, speed_hz)
        self._opened.append(port.close)
        return port

    def watchdog(self, device: str, timeout_s: int) -> KernelWatchdog:
        """The computer's watchdog."""
        watchdog = KernelWatchdog(device, timeout_s)
        self._opened.append(watchdog.disarm)
        return watchdog

    def close(self) -> None:
        """Close whatever was opened. May be called again."""
        while self._opened:
            self._opened.pop()()
