"""Sensor readings: value, unit (in the field's name) and sample time, immutable.

Times are seconds on the board's clock. Batches hold every sample since the last read, oldest first, as a
FIFO delivers them; `overrun` says that older samples were lost before this batch. Named tuples, because a frozen
data class takes several times as long to make.
"""

from __future__ import annotations

from typing import NamedTuple


class MotorCurrent(NamedTuple):
    """Motor current, positive while the motor drives towards tension; supply voltage where the part measures it."""

    time_s: float
    current_a: float
    supply_v: float | None = None


class NutPosition(NamedTuple):
    """Nut travel by the motor's encoder, from its zero at power-up, positive towards tension."""

    time_s: float
    position_m: float


class Switches(NamedTuple):
    """The two end contacts: nut at its home position; string latched (the lock holds the string)."""

    time_s: float
    at_home: bool
    latch_closed: bool


class SpringCompression(NamedTuple):
    """Batch of spring compression beyond the body's own weight (the paper's f_used)."""

    times_s: tuple[float, ...]
    compression_m: tuple[float, ...]
    overrun: bool = False


class MagnetCurrent(NamedTuple):
    """Batch of the release magnet's current."""

    times_s: tuple[float, ...]
    current_a: tuple[float, ...]
    overrun: bool = False


class SpecificForce(NamedTuple):
    """Batch of specific force along the leg (what an accelerometer reads: acceleration minus gravity).

    `saturated` marks samples at the end of the sensor's range.
    """

    times_s: tuple[float, ...]
    specific_force_m_s2: tuple[float, ...]
    saturated: tuple[bool, ...] = ()
    overrun: bool = False


class GroundCommand(NamedTuple):
    """A command: a name of the dictionary and its arguments.

    `authenticated` says that its source has shown that it may command the robot: the ground by its signature on
    the link, or the mission that was loaded on board. `sequence` is the link's number of it.
    """

    time_s: float
    name: str
    arguments: tuple[tuple[str, float], ...] = ()
    authenticated: bool = False
    sequence: int = 0
