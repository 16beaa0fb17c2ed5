"""Missions with goals, flown by the flight code on ground that it is not told of."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from flight import settings as flight_settings
from flight.log import read_log
from flight.mission import GoalPlan, MissionPlan, load_mission
from flight.surface.goal import Goal
from ground.mission_places import Terrain, place_of, spot_of
from ground.mission_run import run_mission
from ground.mission_summary import MissionRun, verdict_sentence
from ground.replay import replay_log
from hal.config import config_path, config_root, read_yaml
from hal.errors import ConfigError
from hal.log import MemoryLog
from sim_hal.board import open_sim, world_of
from sim_hal.plant.simulate import load_plant
from sim_hal.soils import load_soils

SETTINGS = flight_settings.load()
SAND = GoalPlan("A", Goal(clear_height_m=0.06), "quartz_sand", {"surface": "quartz_sand"})


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> MissionRun:
    folder = tmp_path_factory.mktemp("goals")
    plan = MissionPlan("sand", (), (SAND,))
    return run_mission(plan, folder / "out", seed=3, ground_memory=folder / "ground")


def test_the_robot_decides_hops_until_the_goal_is_reached(flown: MissionRun) -> None:
    assert flown.result.completed
    leaps = [each for each in flown.result.decided if each.decision.action == "leap"]
    assert [each.reached for each in leaps] == [True]
    assert len(flown.hops) == len(flown.result.decided)
    assert "1 of 1 leaps reached" in verdict_sentence(flown)
    last = flown.hops[-1]
    assert last.report.belief is not None
    assert last.truth is not None
    assert last.truth.spot.surface == "quartz_sand"
    forecast = leaps[0].forecast
    assert forecast is not None
    assert forecast.height_m.low < last.truth.hop_height_m < forecast.height_m.high


def test_each_decision_is_a_sentence_of_the_log_and_the_page(flown: MissionRun) -> None:
    events = [m.payload for m in read_log(flown.folder / "flight.mcap").messages if m.topic == "event"]
    told = [event["sentence"] for event in events if event["name"] == "decision"]
    assert told == [each.decision.sentence for each in flown.result.decided]
    page = (flown.folder / "report.html").read_text(encoding="utf-8")
    assert all(sentence in page for sentence in told)
    assert "was measured at 8.87 m/s²" in page
    content = json.loads((flown.folder / "mission.json").read_text(encoding="utf-8"))
    assert [each["sentence"] for each in content["decisions"]] == told


def test_a_replay_decides_the_same(flown: MissionRun) -> None:
    result = replay_log(flown.folder / "flight.mcap")
    assert result.same, result.first_difference


def test_what_was_learned_is_there_in_the_next_mission(flown: MissionRun) -> None:
    kept = (flown.folder.parent / "ground").read_text(encoding="utf-8")
    assert '"hops": ' + str(len(flown.hops)) in kept


def test_the_shipped_missions_are_sound() -> None:
    soils = load_soils()
    paths = sorted((config_root() / "missions").glob("*.yaml"))
    assert paths
    for path in paths:
        plan = load_mission(path, SETTINGS)
        plant = load_plant(
            config_path((plan.simulated or {}).get("plants", {}).get("hop", "plant/bb0b_hop.yaml"))
        )
        for goal in plan.goals:
            assert spot_of(goal, goal.place, 1, 1, "1", 1, soils, plant).surface


def test_soil_compacts_until_it_is_loosened() -> None:
    goal = GoalPlan("B", Goal(clear_height_m=0.1), None, {"surface": "syar", "loosened_before_hop": 3})
    plant, soils = load_plant(config_path("plant", "bb0b_hop.yaml")), load_soils()
    lost = [spot_of(goal, "B", made, 0, "1", 1, soils, plant).values["syar.chi"] for made in range(4)]
    assert lost[0] > lost[1]
    assert lost[2] == lost[0]
    assert lost[3] == lost[1]


def test_the_ground_moves_when_a_decision_says_so() -> None:
    with open_sim(read_yaml(config_path("boards", "sim.yaml"))) as board:
        log, world = MemoryLog(), world_of(board)
        terrain = Terrain(log, world, MissionPlan("m", (), (SAND,)), "1", 1)
        terrain.write("event", 0.0, {"name": "decision", "action": "probe", "place": "A", "hop_index": 0})
        assert world.spot.surface == "quartz_sand"
        assert len(log.messages) == 1


def test_a_place_without_ground_is_refused_in_words() -> None:
    with pytest.raises(ConfigError, match="goals at A: surface or simulated is missing"):
        place_of(GoalPlan("A", Goal(clear_height_m=0.1)))
    unknown = GoalPlan("A", Goal(clear_height_m=0.1), "cheese")
    plant = load_plant(config_path("plant", "bb0b_hop.yaml"))
    with pytest.raises(ConfigError, match="'cheese' is unknown; known: syar"):
        spot_of(unknown, "A", 0, 0, "1", 1, load_soils(), plant)


@pytest.mark.parametrize(
    ("goal", "said"),
    [
        ("{clear_height_m: 0.1, distance_m: 1.0}", "goals[0].goal: needs one of"),
        ("{distance_m: 1.0}", "tilt_deg must not be 0"),
        ("{clear_height_m: -1}", "goals[0].goal.clear_height_m = -1"),
    ],
)
def test_goals_are_refused_in_words(tmp_path: Path, goal: str, said: str) -> None:
    path = tmp_path / "mission.yaml"
    path.write_text(f"name: m\ngoals:\n  - {{place: A, goal: {goal}}}\n", encoding="utf-8")
    with pytest.raises(ConfigError) as refused:
        load_mission(path, SETTINGS)
    assert said in str(refused.value)
