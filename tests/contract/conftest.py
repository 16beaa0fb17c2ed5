"""The backends that must keep the device contracts. A new backend joins by one entry in `BACKENDS`.

`bench` is the robot itself: `pytest -m bench -s tests/contract`, spring unloaded, an operator at hand who unplugs
what a test asks for (docs/bring-up.md).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import pytest

from hal.board import Board, open_board
from hal.config import config_path, read_yaml
from sim_hal.board import SimBoard, open_sim
from sim_hal.chips.board import open_emulated

RATES_HZ = {"spring": 200.0, "accelerometer": 1666.0, "magnet_current": 1666.0}


@dataclass(frozen=True)
class Backend:
    """An opened board, how to make one of its devices stop answering, and the rates that its streams run at."""

    board: Board
    break_device: Callable[[str], None]
    rates_hz: Mapping[str, float] = field(default_factory=lambda: RATES_HZ)


def sim_backend() -> Backend:
    board: SimBoard = open_sim(read_yaml(config_path("boards", "sim.yaml")))
    return Backend(board, lambda device: board.faults.plant(device, "fail", board.clock.now_s()))


def emulated(wiring: dict[str, Any], rates_hz: Mapping[str, float] = RATES_HZ) -> Backend:
    """The Raspberry Pi drivers on emulated chips; without self-test, which takes time before the tests'."""
    settings = read_yaml(config_path("boards", "raspberry_pi_emulated.yaml"))
    accelerometer = {"self_test": False, **wiring.pop("accelerometer", {})}
    board = open_emulated({**settings, "wiring": {"accelerometer": accelerometer, **wiring}})
    return Backend(
        board, lambda device: board.rig.faults.plant(device, "fail", board.clock.now_s()), rates_hz
    )


def emulated_backend() -> Backend:
    """RoboClaw, LSM6DSO32, INA226, ADS1015."""
    return emulated({})


def emulated_bridge_backend() -> Backend:
    """H-bridge on PWM with LS7366R, ADXL375, ADS1115."""
    return emulated(
        {
            "motor": {"stage": "h_bridge"},
            "accelerometer": {"part": "adxl375", "address": 0x53, "range_g": 200, "rate_hz": 200.0},
            "spring": {"part": "ads1115", "rates_hz": [200.0]},
        },
        {**RATES_HZ, "accelerometer": 800.0},
    )


def bench_backend() -> Backend:
    board = open_board("raspberry_pi", read_yaml(config_path("boards", "raspberry_pi.yaml")))

    def ask(device: str) -> None:
        input(f"Unplug the part behind {device!r}, then press Enter: ")

    return Backend(board, ask)


BACKENDS: dict[str, Callable[[], Backend]] = {
    "sim": sim_backend,
    "drivers": emulated_backend,
    "drivers_h_bridge": emulated_bridge_backend,
}


@pytest.fixture(params=[*BACKENDS, pytest.param("bench", marks=pytest.mark.bench)])
def backend(request: pytest.FixtureRequest) -> Iterator[Backend]:
    if request.param == "bench" and "bench" not in request.config.getoption("-m"):
        pytest.skip("needs the robot: pytest -m bench -s")
    opened = {**BACKENDS, "bench": bench_backend}[request.param]()
    yield opened
    opened.board.close()


@pytest.fixture
def board(backend: Backend) -> Board:
    return backend.board
