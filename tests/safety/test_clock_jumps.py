"""A clock that jumps, forward or back, ends the mission in SAFE at once: nothing waits for times that are past."""

from __future__ import annotations

import pytest

from flight import settings as flight_settings
from flight.executive import fly
from flight.mission import HopPlan, MissionPlan
from hal.config import config_path, read_yaml
from hal.log import NullLog
from sim_hal.board import open_sim

JUMP_AT_S = 3.0


@pytest.mark.parametrize("size_s", [-1e3, -1.0, -0.3, 0.3, 1.0, 1e3])
def test_a_jump_of_the_clock_ends_in_safe_within_a_few_ticks(size_s: float) -> None:
    settings = flight_settings.load()
    with open_sim(read_yaml(config_path("boards", "sim.yaml"))) as board:
        board.faults.plant("clock", "jump", JUMP_AT_S, size=size_s)
        result = fly(board, settings, MissionPlan("one hop", (HopPlan(3.0, "steel"),)), NullLog())
        assert result.end_reason == "clock_jump"
        assert board.rig.now_s - JUMP_AT_S < 5.0 * settings.tick.period_s
        assert (board.world.voltage_v, board.world.magnet_on) == (0.0, False)
