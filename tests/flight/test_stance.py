"""What the push shows of the ground, on exact hops off ground of known stiffness."""

from __future__ import annotations

import math

import pytest
from flight_fakes import FakeRobot, ListLog, fake_board
from two_mass import Ground

from flight import settings as flight_settings
from flight.executive import fly
from flight.mission import HopPlan, HopReport, MissionPlan

SETTINGS = flight_settings.load()


def report(ground: Ground, energy_j: float) -> HopReport:
    robot = FakeRobot(SETTINGS, nut_m=0.002)
    robot.grounds = [ground]
    (found,) = fly(fake_board(robot), SETTINGS, MissionPlan("one", (HopPlan(energy_j),)), ListLog()).hops
    return found


@pytest.mark.parametrize(("stiffness_n_m", "energy_j"), [(9.5e4, 12.0), (1.9e5, 6.0)])
def test_the_stiffness_is_found(stiffness_n_m: float, energy_j: float) -> None:
    stance = report(Ground(stiffness_n_m, 0.8), energy_j).stance
    assert stance is not None
    error = stance.log_stiffness - math.log(stiffness_n_m)
    assert abs(error) < 3.0 * stance.log_stiffness_sigma
    assert stance.log_stiffness_sigma < 0.07
    assert 0.01 < stance.contact_time_s < 0.03
    assert 0.002 < stance.sinkage_m < 0.03


def test_hard_ground_is_hard_and_nobody_knows_how_hard() -> None:
    stance = report(Ground(5e7, 0.0), 6.0).stance
    assert stance is not None
    assert stance.sinkage_m < 0.0006
    assert stance.log_stiffness > math.log(1e6)
    assert stance.log_stiffness_sigma > 0.3
