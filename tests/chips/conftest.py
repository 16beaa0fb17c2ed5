"""Boards of drivers on emulated chips, closed at the end."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from chip_helpers import Opener, opened

from sim_hal.chips.board import EmulatedBoard


@pytest.fixture
def open_board() -> Iterator[Opener]:
    boards: list[EmulatedBoard] = []

    def opener(**changes: Any) -> EmulatedBoard:
        boards.append(opened(**changes))
        return boards[-1]

    yield opener
    for board in boards:
        board.close()


@pytest.fixture
def board(open_board: Opener) -> EmulatedBoard:
    return open_board()
