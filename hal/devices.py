"""The contracts of the devices, as flight sees them. Every backend honours the same ones.

Common to all devices: `close()` is idempotent and leaves actuators without power; any other use of a closed
device raises `DeviceClosed`; a read that fails raises `ReadFailed` (or `ReadTimeout`), never a made-up value.
Units stand in the names. All times are seconds on the board's `Clock`.
"""

from __future__ import annotations

from typing import Protocol

from hal.readings import (
    GroundCommand,
    MagnetCurrent,
    MotorCurrent,
    NutPosition,
    SpecificForce,
    SpringCompression,
    Switches,
)


class Device(Protocol):
    """What all devices share."""

    def close(self) -> None:
        """Leave the device safe and unusable. May be called again."""


class Clock(Protocol):
    """The board's monotonic clock, and the only way to wait."""

    def now_s(self) -> float:
        """Seconds since the board's start, never going back."""

    def sleep_until_s(self, time_s: float) -> None:
        """Return when `now_s()` has reached `time_s`; at once when it already has."""


class Motor(Device, Protocol):
    """The tensioning motor, commanded by terminal voltage."""

    @property
    def max_voltage_v(self) -> float:
        """Largest magnitude of voltage that can be commanded."""

    def set_voltage_v(self, voltage_v: float) -> None:
        """Apply the voltage until the next command; positive tensions.

        Raises `CommandRefused` for a voltage beyond `max_voltage_v` or not finite.
        """


class Magnet(Device, Protocol):
    """The electromagnet that opens the lock. Energising it with a loaded spring fires the robot."""

    def switch_on(self) -> None:
        """Apply the supply to the coil."""

    def switch_off(self) -> None:
        """Take the supply from the coil."""


class NutEncoder(Device, Protocol):
    """Nut travel by the motor's encoder."""

    def read(self) -> NutPosition:
        """The latest position."""


class MotorCurrentSensor(Device, Protocol):
    """Current of the tensioning motor."""

    def read(self) -> MotorCurrent:
        """The latest current."""


class SwitchInputs(Device, Protocol):
    """Home switch and latch sensor."""

    def read(self) -> Switches:
        """The state of both contacts now."""


class SpringSensor(Device, Protocol):
    """Spring compression, streamed into a FIFO."""

    def set_rate_hz(self, rate_hz: float) -> None:
        """Sample at this rate from now on. Raises `CommandRefused` for a rate the part does not have."""

    def read(self) -> SpringCompression:
        """All samples since the last read; may be empty."""


class MagnetCurrentSensor(Device, Protocol):
    """Magnet current, streamed into a FIFO."""

    def set_rate_hz(self, rate_hz: float) -> None:
        """Sample at this rate from now on. Raises `CommandRefused` for a rate the part does not have."""

    def read(self) -> MagnetCurrent:
        """All samples since the last read; may be empty."""


class Accelerometer(Device, Protocol):
    """Accelerometer on the body, streamed into a FIFO."""

    @property
    def range_m_s2(self) -> float:
        """Largest magnitude that can be read."""

    @property
    def resolution_m_s2(self) -> float:
        """Size of one digital step."""

    def set_rate_hz(self, rate_hz: float) -> None:
        """Sample at this rate from now on. Raises `CommandRefused` for a rate the part does not have."""

    def read(self) -> SpecificForce:
        """All samples since the last read; may be empty."""


class Watchdog(Device, Protocol):
    """Cuts all actuator power when it is not stroked in time."""

    @property
    def timeout_s(self) -> float:
        """Longest allowed time between two strokes."""

    def stroke(self) -> None:
        """Say that the flight software is alive."""


class Memory(Device, Protocol):
    """A few lines that outlive the power."""

    def read(self) -> str:
        """The newest record; empty when there never was one. Raises `ReadFailed` when it is damaged."""

    def write(self, text: str) -> None:
        """Keep this record instead; returns when it is on the medium. Raises `DeviceError` when it cannot."""


class GroundLink(Device, Protocol):
    """Commands in, telemetry out."""

    def receive(self) -> tuple[GroundCommand, ...]:
        """The commands that arrived since the last call, oldest first."""

    def send(self, topic: str, payload: str) -> None:
        """Hand one telemetry message (JSON text) to the ground. Never blocks."""
