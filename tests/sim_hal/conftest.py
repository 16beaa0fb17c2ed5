"""A simulated board to be opened with changed settings."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from sim_helpers import Opener, settings

from sim_hal.board import SimBoard, open_sim


@pytest.fixture
def open_board() -> Iterator[Opener]:
    """Opens simulated boards; closes them at the end."""
    opened: list[SimBoard] = []

    def opener(**changes: Any) -> SimBoard:
        opened.append(open_sim(settings(**changes)))
        return opened[-1]

    yield opener
    for board in opened:
        board.close()


@pytest.fixture
def loaded() -> dict[str, Any]:
    """Initial state of a robot found with its spring loaded: 0.038 m of nut travel, lock closed."""
    return {"nut_position_m": 0.038, "latch_closed": True}
