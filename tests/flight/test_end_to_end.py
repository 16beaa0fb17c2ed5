"""Missions on the simulated board, against its truth, and the entry on the robot."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from flight_fakes import ListLog

from flight import settings as flight_settings
from flight.__main__ import main
from flight.executive import fly
from flight.mission import HopPlan, MissionPlan
from hal.board import open_board
from hal.config import config_path, read_yaml
from sim_hal.board import world_of

SETTINGS = flight_settings.load()


def sim_settings(*surfaces: str, **changes: Any) -> dict[str, Any]:
    found: dict[str, Any] = read_yaml(config_path("boards", "sim.yaml"))
    found["spots"] = [{"surface": name, "foot": 1, "tilt_deg": 0.0} for name in surfaces]
    return {**found, **changes}


def test_a_mission_on_the_simulated_board_agrees_with_its_truth() -> None:
    plan = MissionPlan(
        "steel and sand",
        (HopPlan(8.0, "steel", place="plate", reference=True), HopPlan(8.0, "quartz_sand")),
    )
    with open_board("sim", sim_settings("steel", "quartz_sand")) as board:
        result = fly(board, SETTINGS, plan, ListLog())
        truths = world_of(board).hops
    assert result.completed
    assert len(truths) == 2
    for report, truth in zip(result.hops, truths, strict=True):
        seen = report.energies
        assert report.verdict == "valid", report.reasons
        pairs = (
            (seen.used_j, truth.energy_used_j),
            (seen.time_of_flight_s, truth.time_of_flight_s),
            (seen.height_m, truth.hop_height_m),
            (seen.potential_j, truth.energy_potential_j),
        )
        for said, true in pairs:
            assert said is not None
            assert true is not None
            assert abs(said.value - true) < 3.0 * said.sigma
    hop = result.hops[1]
    assert hop.c3 is not None
    assert abs(hop.c3.value - truths[1].c3) < 3.0 * hop.c3.sigma


def test_a_spring_found_loaded_in_the_simulation_is_relaxed_and_nothing_fires() -> None:
    found = sim_settings("quartz_sand", initial={"nut_position_m": 0.02, "latch_closed": True})
    log = ListLog()
    with open_board("sim", found) as board:
        result = fly(board, SETTINGS, MissionPlan("one", (HopPlan(1.0, "quartz_sand"),)), log)
        fired = [hop.fire_s for hop in world_of(board).hops]
    assert log.events("loaded_at_power_up")
    assert log.phases()[:2] == ["self_test", "de_tension"]
    assert len(fired) == len(result.hops) == 1


def test_a_sensor_that_fails_in_the_simulation_ends_in_a_named_safe_state() -> None:
    found = sim_settings("quartz_sand", faults=[{"device": "spring", "kind": "fail", "from_s": 9.0}])
    with open_board("sim", found) as board:
        result = fly(board, SETTINGS, MissionPlan("one", (HopPlan(14.0, "quartz_sand"),)), ListLog())
        assert not world_of(board).hops
    assert result.end_reason == "spring_stale"


def test_the_entry_flies_by_name_and_refuses_in_words(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mission, log = tmp_path / "mission.yaml", tmp_path / "flight.mcap"
    mission.write_text("name: short\nhops:\n  - {energy_j: 1.0, surface: steel}\n", encoding="utf-8")
    common = ["--mission", str(mission), "--log", str(log)]
    assert main(["--board", "nonesuch", *common]) == 2
    assert "no board is called 'nonesuch'" in capsys.readouterr().err
    assert not log.exists()
    assert main(["--board", "sim", *common]) == 0
    assert "ended in 'stowed'" in capsys.readouterr().out
    assert main(["--board", "sim", *common]) == 2  # a log is never overwritten
    assert "never overwritten" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(common)  # no default board
    assert "--board" in capsys.readouterr().err
