"""Costs, trajectories, goals and decisions: closed forms, bounds that hold, and the sense of it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from flight import settings as flight_settings
from flight.plans import GoalPlan
from flight.surface.belief import belief_of
from flight.surface.costs import HopCosts
from flight.surface.forecast import LossForecast
from flight.surface.goal import Demand, Goal, goal_problem
from flight.surface.known import load_surfaces
from flight.surface.planner import (
    GIVE_UP,
    LEAP,
    MOVE_ON,
    PROBE,
    STAMP,
    Planner,
    Spent,
    equation_seven_energy_j,
)
from flight.surface.priors import loss_of
from flight.surface.seeker import GoalSeeker
from flight.surface.tracker import GroundModels, HopSeen, Tracker
from flight.surface.trajectory import Jumper, height_of_loss_m, predict_leap, range_of_height_m
from flight.tensioning import compression_for_energy_m
from flight.uncertain import Uncertain

SETTINGS = flight_settings.load()
GROUND = GroundModels.of(load_surfaces(), SETTINGS.surface, "1", 0.0)
PLANNER = Planner(SETTINGS)
C2 = 0.05
SYAR, SAND = math.log(1.146e5), math.log(9.042e4)


def begin() -> Tracker:
    return Tracker.begin(GROUND, (0.0, 0.006))


def on_sand(hops: int = 2) -> Tracker:
    tracker = begin()
    for _ in range(hops):
        tracker = tracker.after(HopSeen(12.0, loss_of(0.36), 0.005, SAND, 0.04))
    return tracker


def sure_loss(loss: float, std: float = 0.01) -> LossForecast:
    return LossForecast(np.ones(1), np.array([loss]), np.array([std**2]))


def test_a_hop_costs_what_the_drive_takes() -> None:
    """Measured on the simulated robot: 53 J to store 18 J in 14 s, 23 J and 14 s to drive home, 1.3 J beside."""
    costs = HopCosts(SETTINGS)
    assert float(costs.energy_j(18.0)) == pytest.approx(53.2 + 23.3 + 1.2, rel=0.05)
    assert float(costs.energy_j(2.0)) == pytest.approx(8.8 + 7.8 + 1.2, rel=0.07)
    assert np.all(np.diff(costs.energy_j(np.linspace(0.5, 26.0, 20))) > 0.0)
    assert np.all(np.diff(costs.time_s(np.linspace(0.5, 26.0, 20))) > 0.0)
    busy_s = float(costs.time_s(26.0) - costs.time_s(18.0))
    assert float(costs.energy_j(26.0) - costs.energy_j(18.0)) < SETTINGS.drive.power_limit_w * busy_s


def test_an_upright_leap_on_steel_is_the_loss_free_hop() -> None:
    rig = Jumper.of(SETTINGS.rig)
    s = compression_for_energy_m(18.0, SETTINGS.rig)
    leap = predict_leap(sure_loss(0.0, 1e-6), 18.0, SETTINGS, 0.0)
    assert leap.height_m.middle == pytest.approx(
        rig.analysis_j(s) / (rig.mass_kg * rig.gravity_m_s2), rel=1e-6
    )
    assert leap.range_m.middle == 0.0
    assert not leap.notes


def test_a_tilted_leap_keeps_its_energy() -> None:
    """Apex and range are those of the parabola with the speed that energy leaves at lift-off."""
    s, rig, tilt = compression_for_energy_m(18.0, SETTINGS.rig), Jumper.of(SETTINGS.rig), math.radians(15.0)
    upright = height_of_loss_m(rig, s, 0.4, C2)
    leap = predict_leap(sure_loss(0.4, 1e-6), 18.0, SETTINGS, C2, tilt_deg=15.0, measured_tilt_deg=15.0)
    g, rise = rig.gravity_m_s2, rig.rise_m(s)
    speed = math.sqrt(2.0 * g * (upright - rise * math.cos(tilt)))
    flown = (speed * math.cos(tilt)) ** 2 / (2.0 * g)
    assert leap.height_m.middle == pytest.approx(rise * math.cos(tilt) + flown, rel=1e-4)
    along = rise * math.sin(tilt) + speed**2 * math.sin(2.0 * tilt) / g
    assert leap.range_m.middle == pytest.approx(along, rel=1e-4)
    assert range_of_height_m(rig, s, upright, 15.0) == pytest.approx(along, rel=1e-9)


def test_another_gravity_is_higher_wider_and_said_to_be_carried_over() -> None:
    here = predict_leap(sure_loss(0.4), 18.0, SETTINGS, C2)
    moon = predict_leap(sure_loss(0.4), 18.0, SETTINGS, C2, gravity_m_s2=1.62)
    assert moon.height_m.middle > 4.0 * here.height_m.middle
    wide = [(r.high - r.low) / r.middle for r in (here.height_m, moon.height_m)]
    assert wide[1] > 2.0 * wide[0]
    assert "was measured at 8.87 m/s²" in moon.notes[0]
    with pytest.raises(ValueError, match="beyond the leg's"):
        predict_leap(sure_loss(0.4), 18.0, SETTINGS, C2, tilt_deg=25.0)


def test_another_tilt_than_measured_is_lossier_and_less_sure() -> None:
    level = predict_leap(sure_loss(0.4), 18.0, SETTINGS, C2)
    tilted = predict_leap(sure_loss(0.4), 18.0, SETTINGS, C2, tilt_deg=20.0)
    assert tilted.height_m.middle < 0.75 * level.height_m.middle
    assert "tilt of 0°" in tilted.notes[0]


def test_the_demand_inverts_the_prediction() -> None:
    for goal in (Goal(clear_height_m=0.1), Goal(distance_m=0.2, leaps=2, tilt_deg=12.0)):
        demand = Demand.of(goal, SETTINGS, C2)
        energy_j = float(demand.energy_j(0.4))
        leap = predict_leap(
            sure_loss(0.4, 1e-6),
            energy_j,
            SETTINGS,
            C2,
            tilt_deg=goal.tilt_deg,
            measured_tilt_deg=goal.tilt_deg,
        )
        got, wanted = (
            (leap.height_m.middle, 0.1) if goal.clear_height_m is not None else (leap.range_m.middle, 0.1)
        )
        assert got == pytest.approx(wanted, rel=2e-3)
        assert math.isinf(float(demand.energy_j(9.0)))


@pytest.mark.parametrize("height_m", [0.06, 0.1, 0.14])
@pytest.mark.parametrize("bound", [0.5, 0.9, 0.99])
def test_no_leap_is_made_below_the_bound(height_m: float, bound: float) -> None:
    goal = Goal(clear_height_m=height_m, success_probability=bound)
    demand = Demand.of(goal, SETTINGS, C2)
    for tracker in (begin(), on_sand(1), on_sand(3)):
        decision = PLANNER.decide(tracker, goal, C2)
        if decision.action == LEAP:
            assert decision.success is not None
            assert decision.success >= bound - 1e-6
            assert PLANNER.success(tracker, demand, decision.energy_j) >= bound - 1e-4


def test_unknown_ground_is_probed_and_known_ground_leapt_from() -> None:
    goal = Goal(clear_height_m=0.09)
    first = PLANNER.decide(begin(), goal, C2)
    assert first.action == PROBE
    assert first.energy_j <= 5.0
    known = PLANNER.decide(on_sand(), goal, C2)
    assert known.action == LEAP
    assert known.sentence.startswith("Leap with")
    assert "clear 0.09 m" in known.sentence


def test_compacting_soil_is_stamped_on_where_only_that_makes_the_goal_possible() -> None:
    """A height that fresh Syar does not allow, and Syar that was stamped on does."""
    tracker = begin().after(HopSeen(8.0, loss_of(0.27), 0.005, SYAR, 0.04))
    tracker = tracker.after(HopSeen(8.0, loss_of(0.22), 0.005, SYAR, 0.04))
    assert belief_of(tracker, 8.0).said == "syar"
    heights = np.linspace(0.16, 0.24, 9)
    actions = [PLANNER.decide(tracker, Goal(clear_height_m=float(h)), C2).action for h in heights]
    assert actions[0] == LEAP
    assert STAMP in actions
    assert actions[-1] == GIVE_UP


def test_budgets_end_the_attempt() -> None:
    goal = Goal(clear_height_m=0.1, energy_budget_j=50.0)
    decision = PLANNER.decide(begin(), goal, C2)
    assert decision.action == GIVE_UP
    assert "50 J are left" in decision.sentence
    late = Goal(clear_height_m=0.09, time_budget_s=60.0)
    assert PLANNER.decide(on_sand(), late, C2, Spent(0.0, 55.0)).action == GIVE_UP
    assert PLANNER.decide(on_sand(), late, C2).action == LEAP


def test_hopeless_ground_is_left_where_that_is_allowed() -> None:
    tracker = begin()
    for _ in range(2):
        tracker = tracker.after(HopSeen(8.0, loss_of(0.8), 0.005, math.log(2e4), 0.05))
    goal = Goal(clear_height_m=0.09)
    assert PLANNER.decide(tracker, goal, C2).action != LEAP
    assert PLANNER.decide(tracker, replace(goal, may_move=True), C2).action == MOVE_ON


def test_equation_seven_takes_the_last_loss_for_certain() -> None:
    demand = Demand.of(Goal(clear_height_m=0.1), SETTINGS, C2)
    s = compression_for_energy_m(equation_seven_energy_j(demand, 0.4), SETTINGS.rig)
    assert height_of_loss_m(Jumper.of(SETTINGS.rig), s, 0.4, C2) == pytest.approx(0.1, rel=2e-3)
    assert equation_seven_energy_j(demand, 9.0) == SETTINGS.tension.max_energy_j


def test_goals_that_make_no_sense_are_refused_in_words() -> None:
    assert "one of" in goal_problem(Goal(), SETTINGS)
    assert "one of" in goal_problem(Goal(clear_height_m=0.1, distance_m=0.1), SETTINGS)
    assert "tilt_deg" in goal_problem(Goal(distance_m=0.1), SETTINGS)
    assert "beyond the leg's" in goal_problem(Goal(distance_m=0.1, tilt_deg=30.0), SETTINGS)
    assert not goal_problem(Goal(distance_m=0.1, tilt_deg=10.0), SETTINGS)


def test_a_seeker_goes_through_its_goals() -> None:
    goals = (
        GoalPlan("A", Goal(clear_height_m=0.09)),
        GoalPlan("B", Goal(clear_height_m=5.0)),
        GoalPlan("C", Goal(distance_m=0.1, tilt_deg=10.0, leaps=2)),
    )
    seeker = GoalSeeker(goals, SETTINGS)
    known, c2_ref = on_sand(), Uncertain.of(C2, 0.005, "c2")
    heights = []
    for hop in range(40):
        seeker.decide(hop, lambda place, tilt_deg: known, c2_ref)
        if seeker.hop is None:
            break
        forecast = seeker.decided[-1].forecast
        assert forecast is not None
        heights.append(forecast.height_m.middle)
        seeker.after_hop(0.12)
    assert seeker.goals_left == 0
    acts = [(each.place, each.decision.action) for each in seeker.decided]
    assert ("A", LEAP) in acts
    assert ("B", GIVE_UP) in acts
    assert [place for place, action in acts if action == LEAP].count("C") >= 1
    assert [event.name for event in seeker.events] == ["decision"] * len(seeker.decided)
