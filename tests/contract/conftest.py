"""The backends that must keep the device contracts. A new backend joins by one entry in `BACKENDS`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import pytest

from hal.board import Board
from hal.config import config_path, read_yaml
from sim_hal.board import SimBoard, open_sim


@dataclass(frozen=True)
class Backend:
    """An opened board, and how to make one of its devices stop answering."""

    board: Board
    break_device: Callable[[str], None]


def sim_backend() -> Backend:
    board: SimBoard = open_sim(read_yaml(config_path("boards", "sim.yaml")))
    return Backend(board, lambda device: board.faults.plant(device, "fail", board.clock.now_s()))


BACKENDS: dict[str, Callable[[], Backend]] = {"sim": sim_backend}


@pytest.fixture(params=sorted(BACKENDS))
def backend(request: pytest.FixtureRequest) -> Iterator[Backend]:
    opened = BACKENDS[request.param]()
    yield opened
    opened.board.close()


@pytest.fixture
def board(backend: Backend) -> Board:
    return backend.board
