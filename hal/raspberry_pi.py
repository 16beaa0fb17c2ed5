"""The Raspberry Pi board.

The name exists so that a mission can only ever be flown on what was asked for. This release carries no
driver for the robot's parts, so opening it always refuses; it never hands out what only looks like a board.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hal.board import Board
from hal.errors import BoardUnavailable


def open_raspberry_pi(settings: Mapping[str, Any]) -> Board:
    """Refuse, and say what is lacking."""
    raise BoardUnavailable(
        "board 'raspberry_pi': the drivers for the motor controller, magnet, encoder, current sensors, "
        "spring sensor and accelerometer are not part of this release; to fly the simulation, name it: "
        "--board sim"
    )
