"""A board is a set of devices, opened by name.

Backends register under the entry point group `hopper.boards`. A name that is not there, or a board that
cannot be had on this machine, is an error: nothing is ever fallen back to, so that nobody flies a simulation
believing it is the robot, or the other way round.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import entry_points
from typing import Any

from hal.devices import (
    Accelerometer,
    Clock,
    GroundLink,
    Magnet,
    MagnetCurrentSensor,
    Memory,
    Motor,
    MotorCurrentSensor,
    NutEncoder,
    SpringSensor,
    SwitchInputs,
    Watchdog,
)
from hal.errors import BoardUnavailable
from hal.memory import VolatileMemory

ENTRY_POINT_GROUP = "hopper.boards"


@dataclass(frozen=True, kw_only=True)
class Board:
    """All devices of one robot. Use as a context manager: leaving it closes every device, actuators first."""

    name: str
    clock: Clock
    motor: Motor
    magnet: Magnet
    nut_encoder: NutEncoder
    motor_current: MotorCurrentSensor
    magnet_current: MagnetCurrentSensor
    spring: SpringSensor
    accelerometer: Accelerometer
    switches: SwitchInputs
    watchdog: Watchdog
    ground_link: GroundLink
    memory: Memory = field(default_factory=VolatileMemory)
    ground_memory: Memory = field(default_factory=VolatileMemory)
    simulated_time: bool = False
    """Whether time passes only while somebody waits for it: then a slow disc may hold the flight up, unnoticed."""

    def close(self) -> None:
        """Close all devices, actuators first; every one is tried even if another fails."""
        first_error: Exception | None = None
        for device in (
            self.magnet,
            self.motor,
            self.nut_encoder,
            self.motor_current,
            self.magnet_current,
            self.spring,
            self.accelerometer,
            self.switches,
            self.ground_link,
            self.memory,
            self.ground_memory,
            self.watchdog,
        ):
            try:
                device.close()
            except Exception as error:  # one broken device must not keep another powered
                first_error = first_error or error
        if first_error is not None:
            raise first_error

    def __enter__(self) -> Board:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def board_names() -> tuple[str, ...]:
    """Names of the boards that this installation knows."""
    return tuple(sorted(point.name for point in entry_points(group=ENTRY_POINT_GROUP)))


def open_board(name: str, settings: Mapping[str, Any]) -> Board:
    """Open the board called `name` with its settings (the content of `config/boards/NAME.yaml`).

    Raises `BoardUnavailable` when no such board is known or it cannot be had on this machine.
    """
    for point in entry_points(group=ENTRY_POINT_GROUP):
        if point.name == name:
            board = point.load()(settings)
            if not isinstance(board, Board):
                raise BoardUnavailable(
                    f"board {name!r}: its entry point returned {type(board).__name__}, no Board"
                )
            return board
    known = ", ".join(board_names()) or "none"
    raise BoardUnavailable(f"no board is called {name!r}; known here: {known}")
