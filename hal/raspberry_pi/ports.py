"""What the drivers stand on: the kernel's interfaces, as protocols.

On the robot they are opened by `hal.raspberry_pi.kernel`; the emulated board puts chip models behind the same
ones, so that the drivers cannot tell the difference.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from hal.devices import Clock

Task = Callable[[float], None]
"""What is run at an instant; it is told the time [s]."""


class SmBus(Protocol):
    """The part of `smbus2.SMBus` that the drivers use. All calls raise `OSError` when the bus fails."""

    funcs: Any

    def write_byte_data(self, i2c_addr: int, register: int, value: int) -> None: ...

    def read_i2c_block_data(self, i2c_addr: int, register: int, length: int) -> list[int]: ...

    def read_word_data(self, i2c_addr: int, register: int) -> int: ...

    def write_word_data(self, i2c_addr: int, register: int, value: int) -> None: ...

    def i2c_rdwr(self, *i2c_msgs: Any) -> None: ...

    def close(self) -> None: ...


class SerialPort(Protocol):
    """The part of `serial.Serial` that the drivers use; `read` ends at its timeout with what came."""

    def write(self, data: bytes, /) -> int | None: ...

    def read(self, size: int = 1, /) -> bytes: ...

    def reset_input_buffer(self) -> None: ...

    def close(self) -> None: ...


class SpiPort(Protocol):
    """One device on an SPI bus."""

    def transfer(self, data: bytes) -> bytes:
        """Clock `data` out and the same number of bytes in, with the device selected."""

    def close(self) -> None: ...


class Sysfs(Protocol):
    """Files of the kernel below /sys. Paths are relative to its root."""

    def write(self, path: str, text: str) -> None:
        """Raises `OSError` as the kernel answers."""

    def read(self, path: str) -> str:
        """Content without the newline at its end."""

    def exists(self, path: str) -> bool: ...


class Pins(Protocol):
    """General-purpose pins. All calls raise `OSError` when the kernel refuses."""

    def claim_output(self, pin: int, level: bool) -> None:
        """Drive the pin from now on, first with `level`."""

    def claim_input(self, pin: int) -> None:
        """Listen at the pin, pulled up."""

    def write(self, pin: int, level: bool) -> None: ...

    def read(self, pin: int) -> bool: ...

    def close(self) -> None:
        """Give all pins back, as inputs."""


class WatchdogDevice(Protocol):
    """The kernel's watchdog: resets the computer when it is not kept alive."""

    def keep_alive(self) -> None: ...

    def disarm(self) -> None:
        """Stop it without a reset. May be called again."""


class Sampler(Protocol):
    """Runs short tasks at given instants of the board's clock, one at a time."""

    def every(self, rate_hz: float, task: Task) -> Callable[[], None]:
        """Run `task` at whole multiples of the period; returns what ends it."""

    def once(self, at_s: float, task: Task) -> Callable[[], None]:
        """Run `task` at one instant; returns what calls it off."""

    def close(self) -> None:
        """Run nothing any more. May be called again."""


class Ports(Protocol):
    """Opens the interfaces that a board is wired to; each raises `OSError` when it is not there."""

    @property
    def clock(self) -> Clock: ...

    @property
    def sampler(self) -> Sampler: ...

    @property
    def pins(self) -> Pins: ...

    @property
    def sysfs(self) -> Sysfs: ...

    def i2c(self, bus: int) -> SmBus: ...

    def serial(self, port: str, baud: int, timeout_s: float) -> SerialPort: ...

    def spi(self, device: str, speed_hz: int) -> SpiPort: ...

    def watchdog(self, device: str, timeout_s: int) -> WatchdogDevice: ...

    def close(self) -> None:
        """Close whatever was opened. May be called again."""
