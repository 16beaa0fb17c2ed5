"""Opening a simulated board with changed settings, and letting it run."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

from hal.config import config_path, read_yaml
from sim_hal.board import SimBoard

Opener = Callable[..., SimBoard]

TICK_S = 0.005


def settings(**changes: Any) -> dict[str, Any]:
    """The shipped settings with some top-level keys replaced, or merged where both are mappings."""
    found: dict[str, Any] = copy.deepcopy(read_yaml(config_path("boards", "sim.yaml")))
    for key, value in changes.items():
        merged = isinstance(value, dict) and isinstance(found.get(key), dict)
        found[key] = {**found[key], **value} if merged else value
    return found


def let_run(
    board: SimBoard, duration_s: float, voltage_v: float = 0.0, until: Callable[[], bool] = lambda: False
) -> None:
    """Apply a voltage and let time pass in ticks, watchdog stroked, no longer than until something is so."""
    board.motor.set_voltage_v(voltage_v)
    end_s = board.clock.now_s() + duration_s
    while board.clock.now_s() < end_s - 1e-9 and not until():
        board.watchdog.stroke()
        board.clock.sleep_until_s(board.clock.now_s() + TICK_S)


def hop(board: SimBoard) -> None:
    """Fire and wait until the robot stands again."""
    hops = len(board.world.hops)
    board.magnet.switch_on()
    let_run(board, 0.05)
    board.magnet.switch_off()
    let_run(board, 20.0, until=lambda: len(board.world.hops) > hops)
    assert len(board.world.hops) == hops + 1
