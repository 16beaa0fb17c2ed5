"""Whole missions through the real drivers: the same hops as on the simulated board, the same bits each time."""

from __future__ import annotations

from typing import Any

import pytest
from chip_helpers import emulated_settings

from flight import settings as flight_settings
from flight.executive import fly
from flight.mission import HopPlan, MissionPlan, MissionResult
from hal.board import Board
from hal.config import config_path, read_yaml
from hal.log import MemoryLog
from hal.tap import tap_board
from sim_hal.board import open_sim, world_of
from sim_hal.chips.board import open_emulated
from sim_hal.truth import HopTruth

SETTINGS = flight_settings.load()
SPOTS = [{"surface": "quartz_sand", "foot": 1, "tilt_deg": 0.0}]
PLAN = MissionPlan("one", (HopPlan(6.0, "quartz_sand"),))

SPRING_STEP_M = 0.03 * 2.048 / 2048
"""One digit of the ADS1015 on the spring's sensor."""


def flown(board: Board) -> tuple[MissionResult, list[HopTruth], MemoryLog]:
    log = MemoryLog()
    with board:
        result = fly(tap_board(board, log), SETTINGS, PLAN, log)
        return result, world_of(board).hops, log


def emulated(**changes: Any) -> Board:
    return open_emulated({**emulated_settings(**changes), "spots": SPOTS})


def test_the_drivers_make_the_same_hop_as_the_simulated_board() -> None:
    simulated, (true_sim,), _ = flown(
        open_sim({**read_yaml(config_path("boards", "sim.yaml")), "spots": SPOTS})
    )
    driven, (true_pi,), _ = flown(emulated())
    assert driven.completed
    assert simulated.completed
    rig = SETTINGS.rig
    step_j = (
        rig.spring_stiffness_n_m
        * (2.0 * true_sim.energy_used_j / rig.spring_stiffness_n_m) ** 0.5
        * SPRING_STEP_M
    )
    assert true_pi.energy_used_j == pytest.approx(true_sim.energy_used_j, abs=step_j)
    by_sim, by_pi = simulated.hops[0], driven.hops[0]
    assert by_pi.verdict == by_sim.verdict == "valid"
    for name in ("used_j", "time_of_flight_s", "height_m", "potential_j"):
        one, other = getattr(by_pi.energies, name), getattr(by_sim.energies, name)
        assert one is not None
        assert other is not None
        assert one.value == pytest.approx(other.value, abs=2.0 * max(one.sigma, other.sigma)), name
    assert by_pi.energies.height_m is not None
    assert abs(by_pi.energies.height_m.value - true_pi.hop_height_m) < 3.0 * by_pi.energies.height_m.sigma


@pytest.mark.parametrize(
    ("wire", "ends_as"),
    [
        ({"device": "motor_current", "kind": "nack", "from_s": 1.5}, "motor_current_stale"),
        ({"device": "motor_current", "kind": "brown_out", "from_s": 1.5}, "motor_current_stale"),
        ({"device": "motor_controller", "kind": "crc", "from_s": 1.5}, "motor_command_failed"),
        ({"device": "accelerometer", "kind": "unplug", "from_s": 1.5}, "accelerometer_stale"),
    ],
)
def test_a_wire_that_breaks_in_flight_ends_safe_and_named(wire: dict[str, Any], ends_as: str) -> None:
    board = emulated(wire_faults=[wire])
    result, hops, _ = flown(board)
    assert result.end_reason == ends_as
    assert not hops
    assert world_of(board).voltage_v == 0.0
    assert not world_of(board).magnet_on


def test_the_same_seed_gives_the_same_bits_through_drivers_and_terminal() -> None:
    wire = {"device": "motor_controller", "kind": "timeout", "from_s": 3.0}
    logs = [flown(emulated(wire_faults=[wire], seed=seed))[2].messages for seed in (5, 5, 6)]
    assert logs[0] == logs[1]
    assert logs[0] != logs[2]
