"""Sensors of the simulated board that stick at a value are named; healthy ones never are."""

from __future__ import annotations

from typing import Any

import pytest
from flight_fakes import ListLog

from flight import settings as flight_settings
from flight.executive import fly
from flight.mission import HopPlan, MissionPlan, MissionResult
from hal.board import open_board
from hal.config import config_path, read_yaml

SETTINGS = flight_settings.load()


def flown(energy_j: float, **changes: Any) -> tuple[MissionResult, ListLog]:
    log = ListLog()
    plan = MissionPlan("m", (HopPlan(energy_j, "steel"),))
    with open_board("sim", {**read_yaml(config_path("boards", "sim.yaml")), **changes}) as board:
        return fly(board, SETTINGS, plan, log), log


@pytest.mark.parametrize(
    ("device", "from_s", "phase", "relaxed"),
    [
        ("motor_current", 0.3, "homing", False),
        ("motor_current", 6.0, "tensioning", False),
        ("accelerometer", 0.3, "homing", True),
        ("accelerometer", 6.0, "tensioning", True),
    ],
)
def test_a_sensor_that_sticks_is_named_before_anything_fires(
    device: str, from_s: float, phase: str, relaxed: bool
) -> None:
    result, log = flown(14.0, faults=[{"device": device, "kind": "stick", "from_s": from_s}])
    assert result.end_reason == f"{device}_stuck"
    assert not result.hops
    (fault,) = log.events("fault")
    assert fault["phase"] == phase
    assert ("de_tension" in log.phases()) is relaxed
    assert result.spring_loaded is not relaxed
    seen_s = next(t for topic, t, p in log.entries if topic == "event" and p["name"] == "fault")
    assert seen_s - from_s <= (SETTINGS.monitors[f"{device}_stuck"].above + 3) * SETTINGS.tick.period_s


@pytest.mark.parametrize(("seed", "energy_j"), [(2, 1.0), (3, 2.5)])
def test_healthy_missions_trip_no_monitor(seed: int, energy_j: float) -> None:
    result, log = flown(energy_j, seed=seed)
    assert result.completed
    assert not log.events("fault")
