"""The other way to drive the motor: PWM channels, pins, and the counter LS7366R; and the magnet's PWM."""

from __future__ import annotations

import errno
import os
import struct
from collections.abc import Callable
from pathlib import Path

from sim_hal.chips.rig import Signal


class PwmTree:
    """The kernel's PWM files in a folder, answering as the kernel does (drivers/pwm/sysfs.c)."""

    def __init__(self, root: Path, chip: int, channels: int) -> None:
        self._root = root
        self._chip = f"class/pwm/pwmchip{chip}"
        self._channels = channels
        self._listeners: dict[int, Callable[[float], None]] = {}
        (root / self._chip).mkdir(parents=True)
        self._store(f"{self._chip}/npwm", str(channels))
        for name in ("export", "unexport"):
            self._store(f"{self._chip}/{name}", "")

    def listen(self, channel: int, listener: Callable[[float], None]) -> None:
        """Tell `listener` the share of time that the channel is high, whenever that may have changed."""
        self._listeners[channel] = listener

    def duty(self, channel: int) -> float:
        """Share of time that a channel is high."""
        folder = f"{self._chip}/pwm{channel}"
        if not self.exists(folder) or self.read(f"{folder}/enable") == "0":
            return 0.0
        return int(self.read(f"{folder}/duty_cycle")) / int(self.read(f"{folder}/period"))

    def exists(self, path: str) -> bool:
        """Whether there is such a file or folder."""
        return (self._root / path).exists()

    def read(self, path: str) -> str:
        """Content without the newline at its end."""
        return (self._root / path).read_text(encoding="ascii").rstrip("\n")

    def write(self, path: str, text: str) -> None:
        """Raises `OSError` as the kernel answers."""
        if not self.exists(path):
            raise OSError(errno.ENOENT, os.strerror(errno.ENOENT), path)
        value = int(text)
        if path == f"{self._chip}/export":
            self._export(value)
            return
        folder, name = path.rsplit("/", 1)
        self._check(folder, name, value)
        self._store(path, str(value))
        channel = int(folder.rsplit("pwm", 1)[1])
        if channel in self._listeners:
            self._listeners[channel](self.duty(channel))

    def _export(self, channel: int) -> None:
        folder = f"{self._chip}/pwm{channel}"
        if not 0 <= channel < self._channels:
            raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))
        if self.exists(folder):
            raise OSError(errno.EBUSY, os.strerror(errno.EBUSY))
        (self._root / folder).mkdir()
        for name, start in (("period", "0"), ("duty_cycle", "0"), ("enable", "0"), ("polarity", "normal")):
            self._store(f"{folder}/{name}", start)

    def _check(self, folder: str, name: str, value: int) -> None:
        now = {key: int(self.read(f"{folder}/{key}")) for key in ("period", "duty_cycle", "enable")}
        now[name] = value
        if value < 0 or now["duty_cycle"] > now["period"] or (now["enable"] and not now["period"]):
            raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))

    def _store(self, path: str, text: str) -> None:
        (self._root / path).write_text(text + "\n", encoding="ascii")


class MockPins:
    """Pins without a computer: inputs ask the rig, outputs tell who listens."""

    def __init__(self) -> None:
        self.levels: dict[int, bool] = {}
        self._sources: dict[int, Callable[[], bool]] = {}
        self._listeners: dict[int, Callable[[bool], None]] = {}
        self._inputs: set[int] = set()
        self.broken: Callable[[int], bool] = lambda pin: False

    def connect_input(self, pin: int, source: Callable[[], bool]) -> None:
        """What the pin reads."""
        self._sources[pin] = source

    def connect_output(self, pin: int, listener: Callable[[bool], None]) -> None:
        """Whom to tell each level that is written."""
        self._listeners[pin] = listener

    def claim_output(self, pin: int, level: bool) -> None:
        """Drive the pin from now on, first with `level`."""
        self._refuse_if_taken(pin)
        self.levels[pin] = level

    def claim_input(self, pin: int) -> None:
        """Listen at the pin; one that nothing is connected to is pulled up."""
        self._refuse_if_taken(pin)
        self._inputs.add(pin)

    def write(self, pin: int, level: bool) -> None:
        """Drive an output."""
        if pin not in self.levels or self.broken(pin):
            raise OSError(
                errno.EPERM if pin not in self.levels else errno.EIO, f"pin {pin} cannot be written"
            )
        self.levels[pin] = level
        if pin in self._listeners:
            self._listeners[pin](level)

    def read(self, pin: int) -> bool:
        """Level of a pin."""
        if pin not in self._inputs or self.broken(pin):
            raise OSError(errno.EIO, f"pin {pin} cannot be read")
        return self._sources[pin]() if pin in self._sources else True

    def close(self) -> None:
        """Give all pins back, as inputs."""
        self.levels.clear()
        self._inputs.clear()

    def _refuse_if_taken(self, pin: int) -> None:
        if pin in self.levels or pin in self._inputs:
            raise OSError(errno.EBUSY, f"pin {pin} is in use")


class Ls7366rChip:
    """The quadrature counter by its instructions; counts the nut's travel."""

    def __init__(self, nut: Signal, broken: Callable[[], bool], m_per_count: float, sign: int) -> None:
        self._nut, self._broken = nut, broken
        self._counts_per_m = sign / m_per_count
        self.reset()

    def reset(self) -> None:
        """As at power-up: one count a cycle is not configured, and the power-loss latch is set."""
        self._registers = {0b001: 0, 0b010: 0, 0b110: 0x04}
        self._zero_m = self._nut.newest()

    def transfer(self, data: bytes) -> bytes:
        """One selection of the chip; an absent chip leaves the line high."""
        if self._broken():
            return bytes((0xFF,)) * len(data)
        action, register = data[0] >> 6, data[0] >> 3 & 0b111
        if action == 0b10 and len(data) == 2:
            self._registers[register] = data[1]
        elif action == 0b00 and register in self._registers:
            self._registers[register] = 0
        elif action == 0b01:
            return (bytes(1) + self._value(register) + bytes(len(data)))[: len(data)]
        return bytes(len(data))

    def close(self) -> None:
        """The chip stays as it is."""

    def _value(self, register: int) -> bytes:
        if register == 0b100:
            counting = self._registers[0b001] & 0b11 == 0b11
            count = round((self._nut.newest() - self._zero_m) * self._counts_per_m) if counting else 0
            return struct.pack(">i", count)
        return bytes((self._registers.get(register, 0),))
