"""What can go wrong at the hardware, as exceptions that a caller can tell apart.

A failed read is always an exception, never a plausible value. Each error also inherits the builtin that fits,
so that code which knows nothing of hopper can still catch it.
"""

from __future__ import annotations


class HalError(Exception):
    """Any fault reported by the hardware abstraction layer."""


class ConfigError(HalError, ValueError):
    """A configuration was refused. The message names file, key, value and limit."""


class BoardUnavailable(HalError, RuntimeError):
    """The board asked for by name cannot be opened here. There is no fallback."""


class DeviceError(HalError, OSError):
    """A device did not do what was asked."""


class ReadFailed(DeviceError):
    """A sensor gave no reading."""


class ReadTimeout(ReadFailed, TimeoutError):
    """A sensor gave no reading in time."""


class DeviceClosed(HalError, RuntimeError):
    """A device was used after it was closed."""


class CommandRefused(HalError, ValueError):
    """An actuator was commanded beyond its limits. Nothing was changed."""


class NoAcknowledge(ReadFailed):
    """A part on a bus did not acknowledge: unplugged, without supply, or at another address."""


class BusStuck(ReadFailed):
    """A bus cannot be used at all: one of its lines is held."""


class ShortRead(ReadFailed):
    """Fewer bytes came than were asked for."""


class BadChecksum(ReadFailed):
    """What came is damaged: its checksum, or the sequence of its parts, is wrong."""


class DeviceReset(ReadFailed):
    """A part has lost its settings (a brown-out), so what it delivers means something else."""


class WrongDevice(DeviceError):
    """Another part answers than the one that is configured."""


class SelfTestFailed(DeviceError):
    """A part's own test says that it is broken."""
