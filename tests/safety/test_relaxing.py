"""What is answered by relaxing the spring, and stays, does not end the relaxing half way."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest

from flight import settings as flight_settings
from flight.executive import fly
from flight.mission import HopPlan, MissionPlan
from flight.monitor_settings import Response
from flight.states import Phase
from hal.board import open_board
from hal.config import config_path, read_yaml
from hal.log import MemoryLog
from sim_hal.board import SimBoard

SETTINGS = flight_settings.load()
ONSET_S = 4.9


class FullFrom(MemoryLog):
    """A log whose disc is full for good from some time on."""

    def __init__(self, full_s: float) -> None:
        super().__init__()
        self._full_s, self.problem = full_s, ""

    def write(self, topic: str, time_s: float, payload: Mapping[str, Any]) -> None:
        super().write(topic, time_s, payload)
        if time_s >= self._full_s:
            self.problem = "no space left on the disc"


@pytest.mark.parametrize(
    ("reason", "faults"),
    [
        ("log_unwritable", []),
        ("supply_sag", [{"device": "supply", "kind": "sag", "from_s": ONSET_S, "size": 3.0}]),
        ("tick_overrun", [{"device": "clock", "kind": "late", "from_s": ONSET_S, "size": 0.003}]),
    ],
)
def test_a_lasting_fault_of_a_robot_that_holds_energy_ends_with_the_spring_relaxed(
    reason: str, faults: list[dict[str, Any]]
) -> None:
    found = read_yaml(config_path("boards", "sim.yaml"))
    with open_board("sim", {**found, "faults": faults}) as board:
        assert isinstance(board, SimBoard)
        stored_m: list[float] = []
        board.rig.witnesses.append(lambda _: stored_m.append(board.world.spring_compression_m))
        log = FullFrom(ONSET_S if reason == "log_unwritable" else float("inf"))
        result = fly(board, SETTINGS, MissionPlan("one", (HopPlan(0.8, "steel"),)), log)
        left_m = board.world.spring_compression_m
    assert result.end_reason == reason
    assert max(stored_m) > 0.002
    assert abs(left_m) < SETTINGS.safety.unloaded_compression_m
    assert not result.spring_loaded


def test_no_monitor_that_asks_for_relaxing_watches_it() -> None:
    """A row with that response would trip again at the next tick, and stop the robot with its spring loaded."""
    asking = (Response.DE_TENSION, Response.SAFE_HOLD, Response.RETRY)
    rules = SETTINGS.monitors
    watching = [
        name for name, rule in rules.items() if rule.response in asking and Phase.DE_TENSION in rule.phases
    ]
    assert watching == []
