"""The campaign's judge, its drawing, and that it goes on where it was stopped. Planted hazards must be seen."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from ground.fault_campaign import campaign, flying
from ground.fault_campaign.campaign import FaultStudy
from ground.fault_campaign.drawing import CampaignSettings, FaultCase, PlantedFault, draw_case, load_campaign
from ground.fault_campaign.flying import CaseResult, fly_case
from ground.fault_campaign.hazards import Release, Witness, judge_releases, judge_reports
from hal.board import open_board
from hal.config import config_path, read_yaml
from hal.errors import ConfigError
from sim_hal.board import SimBoard

SETTINGS = load_campaign()
FOLDER = Path(__file__).resolve().parents[2] / "ground" / "fault_campaign"


def witness(**initial: Any) -> Witness:
    found = read_yaml(config_path("boards", "sim.yaml"))
    found["initial"] = {"nut_position_m": 0.0, "latch_closed": False, **initial}
    board = open_board("sim", found)
    assert isinstance(board, SimBoard)
    seen = Witness(board, SETTINGS.limits, 30600.0, 47.9, board.rig.stop_high_m)
    board.rig.witnesses.append(seen)
    return seen


def test_the_judge_shares_no_code_with_the_flight_software() -> None:
    assert "flight" not in (FOLDER / "hazards.py").read_text(encoding="utf-8").replace("flight software", "")


def test_a_release_that_nobody_commanded_is_seen() -> None:
    seen = witness(nut_position_m=0.01, latch_closed=True)
    seen.board.magnet.switch_on()
    while seen.board.world.latch_closed:
        seen.board.rig.advance(seen.board.world.now_s + 0.005)
    (release,) = seen.releases
    judge_releases(seen, (), [release.energy_j])
    assert seen.hazards == {"release_without_fire"}


def test_releases_are_held_to_commands_and_energy() -> None:
    seen = witness()
    commands = [(9.0, "arm"), (9.9, "fire")]
    seen.releases = [Release(10.0, 5.0)]
    judge_releases(seen, commands, [5.1])
    assert not seen.hazards
    for bad in ([(9.8, "arm"), (9.9, "fire")], [(9.9, "fire")], [(9.0, "arm"), (8.0, "fire")]):
        seen.hazards.clear()
        judge_releases(seen, bad, [5.1])
        assert seen.hazards == {"release_without_fire"}
    seen.hazards.clear()
    judge_releases(seen, commands, [6.0])
    assert seen.hazards == {"wrong_energy_fired"}


def test_force_travel_and_power_are_seen() -> None:
    seen = witness(nut_position_m=0.0597, latch_closed=True)
    seen.board.motor.set_voltage_v(12.0)
    seen.board.rig.advance(0.05)
    assert {"force_above_limit", "travel_past_stop"} <= seen.hazards
    seen.after_the_end()
    assert "power_left_on" in seen.hazards


def test_a_wrong_c3_is_seen_only_when_it_was_called_valid() -> None:
    seen = witness(nut_position_m=0.01, latch_closed=True)
    seen.board.magnet.switch_on()
    while not seen.board.world.hops:
        seen.board.rig.stroke()
        seen.board.rig.advance(seen.board.world.now_s + 0.005)
    (truth,) = seen.board.world.hops
    report = {"fire_s": truth.fire_s, "verdict": "valid", "c3": {"value": truth.c3, "sigma": 0.01}}
    wrong = {**report, "c3": {"value": truth.c3 + 0.2, "sigma": 0.01}}
    judge_reports(seen, [report, {**wrong, "verdict": "rejected"}, {**report, "c3": None}])
    assert not seen.hazards
    judge_reports(seen, [wrong])
    assert seen.hazards == {"wrong_c3_reported_valid"}


def test_cases_are_drawn_alike_each_time_and_differ() -> None:
    cases = [draw_case(SETTINGS, index, 1) for index in range(50)]
    assert cases == [draw_case(SETTINGS, index, 1) for index in range(50)]
    assert len({case.faults for case in cases}) == 50
    most = SETTINGS.groups * SETTINGS.faults_at_once
    assert {len(case.faults) for case in cases} >= {1, 2, 3}
    assert max(len(case.faults) for case in cases) <= most
    assert all(len({fault.device for fault in case.faults}) == len(case.faults) for case in cases)
    assert draw_case(SETTINGS, 0, 2) != cases[0]


def test_a_fault_counts_only_if_it_made_a_difference_and_what_does_not_is_told() -> None:
    felt = PlantedFault("spring", "offset", 0.5, 0.52, 0.0001)
    idle = (
        PlantedFault("magnet", "fail", 0.5, 0.6, 0.0),
        PlantedFault("accelerometer", "fail", 1e4, None, 0.0),
    )
    case = replace(
        draw_case(SETTINGS, 0, 1), faults=(idle[0], felt, idle[1]), energy_j=0.8, loaded=False, nut_m=0.0
    )
    result = fly_case(SETTINGS, case)
    assert (result.end_reason, result.releases, result.hazards) == ("stowed", 1, ())
    assert (result.case.faults, result.came_to_nothing) == ((felt,), 2)
    (effect_s,) = result.effects_s
    assert 0.5 <= effect_s < 0.52
    without = fly_case(SETTINGS, replace(case, faults=(felt,)))
    assert without == replace(result, came_to_nothing=0)


def test_a_lock_that_does_not_close_is_found_before_anything_is_stored() -> None:
    fault = PlantedFault("lock", "fail", 0.0, None, 0.0)
    case = replace(draw_case(SETTINGS, 0, 1), faults=(fault,), energy_j=0.8, loaded=False, nut_m=0.001)
    result = fly_case(SETTINGS, case)
    assert (result.end_reason, result.releases, result.hazards) == ("latch_did_not_close", 0, ())
    assert result.case.faults == (fault,)


def test_a_campaign_goes_on_where_it_was_stopped_and_counts_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flown: list[int] = []

    def fly(settings: CampaignSettings, case: FaultCase) -> CaseResult:
        flown.append(case.index)
        fault = PlantedFault("spring", "fail", 1.0, None, 0.0)
        hazards = ("log_lost",) if case.index == 3 else ()
        felt = replace(case, faults=(fault, fault))
        return CaseResult(felt, (1.0, 1.0), 1, "stowed", 0, hazards, 9.5)

    monkeypatch.setattr(campaign, "fly_case", fly)
    shown: list[float] = []
    study = FaultStudy(SETTINGS, 1)
    first, _ = campaign.run_campaign(study, 4, tmp_path, lambda text, done: shown.append(done))
    assert first.faults == 4
    result, ran = campaign.run_campaign(study, 10, tmp_path, lambda text, done: shown.append(done))
    assert flown == [0, 1, 2, 3, 4]
    assert (result.faults, ran.throughput.cases) == (10, 3)
    assert result.hazards["log_lost"] == 1
    assert [study.suspicious(row) for row in result.rows] == [False, False, False, True, False]
    assert shown == [2.0, 4.0, 6.0, 8.0, 10.0]
    for other, key in (
        (FaultStudy(SETTINGS, 2), "seed"),
        (FaultStudy(replace(SETTINGS, horizon_s=1.0), 1), "settings"),
    ):
        with pytest.raises(ConfigError, match=f"of other {key}"):
            campaign.run_campaign(other, 10, tmp_path, lambda text, done: None)


def test_a_row_of_a_flown_case_is_kept_as_it_is(tmp_path: Path) -> None:
    study = FaultStudy(SETTINGS, 1)
    result, _ = campaign.run_campaign(study, 1, tmp_path, lambda text, done: None)
    again, ran = campaign.run_campaign(study, 1, tmp_path, lambda text, done: None)
    assert ran.throughput.cases == 0
    assert again == result
    index = result.rows[-1]["index"]
    assert json.loads(json.dumps(study.run(index))) == {
        key: value for key, value in result.rows[-1].items() if key not in ("index", "failed")
    }


def test_the_figures_are_those_of_the_rows() -> None:
    from ground.campaign_cli import figures

    row = {"case": {"faults": [1, 2]}, "hazards": ["log_lost"], "effects_s": [0.1], "end_reason": "x"}
    rows = [{**row, "came_to_nothing": 3}]
    found = figures(campaign.CampaignResult(tuple(rows)))
    values = {name: entry["value"] for name, entry in found.items()}
    assert (values["faults"], values["hazards"], values["without_effect"]) == (2, 1, 1)
    assert values["came_to_nothing"] == 3
    json.dumps(found)


def test_a_robot_without_its_protection_is_seen_to_be_dangerous(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same fault, with the flight software as it is and with the monitors taken away that answer it."""
    fault = PlantedFault("spring", "scale", 0.0, None, 0.75)
    case = replace(draw_case(SETTINGS, 0, 1), faults=(fault,), energy_j=0.8, loaded=False, nut_m=0.0)
    guarded = fly_case(SETTINGS, case)
    assert (guarded.releases, guarded.hazards) == (0, ())
    flight, surfaces, found = flying._given()
    taken = ("spring_disagrees_with_encoder", "string_broken", "stored_energy_uncertain")
    blind = {
        name: replace(rule, above=1e4) if name in taken else rule for name, rule in flight.monitors.items()
    }
    trusting = replace(flight.safety, latch_check_slope_tolerance=0.9)
    bare = replace(flight, monitors=blind, safety=trusting)
    monkeypatch.setattr(flying, "_given", lambda: (bare, surfaces, found))
    unguarded = fly_case(SETTINGS, case)
    assert unguarded.releases == 1
    assert "wrong_energy_fired" in unguarded.hazards


@pytest.mark.parametrize(
    ("size", "releases", "reason"), [(0.907, 0, "stored_energy_uncertain"), (0.99, 1, "stowed")]
)
def test_a_spring_sensor_that_reads_a_little_less_cannot_make_it_fire_more(
    size: float, releases: int, reason: str
) -> None:
    """At small energies: 9 % of the compression are 18 % of the energy, and half a millimetre."""
    fault = PlantedFault("spring", "scale", 4.5, None, size)
    case = replace(draw_case(SETTINGS, 0, 1), faults=(fault,), energy_j=0.62, loaded=False, nut_m=0.0)
    result = fly_case(SETTINGS, case)
    assert (result.releases, result.end_reason, result.hazards) == (releases, reason, ())
