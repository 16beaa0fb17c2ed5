"""The Raspberry Pi board: drivers for the robot's parts, on the kernel of the computer that runs this."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hal.board import Board
from hal.config import build_settings
from hal.errors import BoardUnavailable

NAME = "raspberry_pi"


def open_raspberry_pi(settings: Mapping[str, Any]) -> Board:
    """Open the robot. Raises `BoardUnavailable` when this computer is none, `ConfigError` for its settings."""
    # imported here, so that a computer that is no robot need not have what the drivers stand on
    from hal.raspberry_pi.board import assemble
    from hal.raspberry_pi.kernel import KernelPorts
    from hal.raspberry_pi.settings import PiSettings, check_wiring

    try:
        ports = KernelPorts()
    except OSError as error:
        raise BoardUnavailable(
            f"board {NAME!r}: this computer is not the robot ({error.strerror or error}); "
            "`hopper setup` says what is missing; to fly the simulation, name it: --board sim"
        ) from error
    try:
        checked = build_settings(settings, PiSettings, f"settings of board {NAME!r}")
        check_wiring(checked, f"settings of board {NAME!r}")
    except BaseException:
        ports.close()
        raise
    return assemble(NAME, checked, ports)
