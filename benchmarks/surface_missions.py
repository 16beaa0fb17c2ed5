"""Missions in the fast world: hops by given energies, hops by a policy, and what came of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from benchmarks.surface_exact import HopData
from benchmarks.surface_world import AVERAGE_STD, DIRECT_STD, LOSS_SIGMA, STIFFNESS_SIGMA, Spots, World
from flight.surface.goal import Demand, Goal
from flight.surface.planner import GIVE_UP, LEAP, Planner
from flight.surface.tracker import GroundModels, HopSeen, Tracker

Array = NDArray[np.float64]

C2_REF = 0.059
HEIGHTS_M = (0.05, 0.085)
MOST_STAMPS, STEADY_C3 = 8, 0.01
TRUE_DOSE = (0.35, 0.7)
"""Exponents of the energy with which hops truly compact; the belief takes one in the middle."""


@dataclass
class Robot:
    """A robot on one spot of the fast world: what it hops, the world answers."""

    spot: Spots
    world: World
    common_std: float
    common: float
    chance: np.random.Generator
    dose_exponent: float = 0.5
    dose: float = 0.0
    losses: list[float] = field(default_factory=list)

    @staticmethod
    def on(
        spot: Spots, world: World, chance: np.random.Generator, dose_exponent: float | None = None
    ) -> Robot:
        """A robot with a fresh C2_ref, measured or the average, on a fresh spot."""
        std = DIRECT_STD if chance.random() < 0.5 else AVERAGE_STD
        exponent = float(chance.uniform(*TRUE_DOSE)) if dose_exponent is None else dose_exponent
        return Robot(spot, world, std, std * float(chance.standard_normal()), chance, exponent)

    def hop(self, energy_j: float) -> HopSeen:
        """One hop; its loss as it truly counts for the height, C2_ref's error included, goes to `losses`."""
        log_energy = math.log(energy_j / self.world.settings.learning.reference_energy_j)
        middle = float(self.spot.middle_loss(np.asarray(self.dose), np.asarray(log_energy))[0])
        true = middle + self.common + float(self.spot.scatter[0]) * float(self.chance.standard_normal())
        self.losses.append(true)
        stiffness_std = math.hypot(STIFFNESS_SIGMA, self.world.settings.learning.stiffness_hop_std)
        stiffness = float(self.spot.log_stiffness[0]) + stiffness_std * float(self.chance.standard_normal())
        self.dose += (energy_j / self.world.settings.learning.reference_energy_j) ** self.dose_exponent
        seen = true + LOSS_SIGMA * float(self.chance.standard_normal())
        return HopSeen(energy_j, seen, LOSS_SIGMA, stiffness, STIFFNESS_SIGMA)


def identified(
    world: World, ground: GroundModels, name: str, energies_j: Array, chance: np.random.Generator
) -> tuple[list[Tracker], HopData, list[float]]:
    """Hops of given energies on a fresh spot: belief after each, data for the exact posterior, true losses."""
    settings = world.settings.learning
    robot = Robot.on(world.spots(name, 1, chance), world, chance, settings.dose_exponent)
    tracker, beliefs, hops, doses = Tracker.begin(ground, (0.0, robot.common_std)), [], [], []
    for energy_j in map(float, energies_j):
        doses.append(robot.dose)
        hops.append(robot.hop(energy_j))
        tracker = tracker.after(hops[-1])
        beliefs.append(tracker)
    data = HopData(
        loss=np.array([hop.loss for hop in hops]),
        log_stiffness=np.array([hop.log_stiffness for hop in hops]),
        log_energy=np.log(energies_j / settings.reference_energy_j),
        dose=np.array(doses),
        common_std=robot.common_std,
    )
    return beliefs, data, robot.losses


@dataclass(frozen=True)
class Spending:
    """What a policy made of a goal: whether it was reached, and the electrical energy spent."""

    reached: bool
    energy_j: float


@dataclass(frozen=True)
class FixedPolicy:
    """So many stamps of an energy whatever they show (`until_steady`: until C3 stops falling), then the leap.

    The leap gets the energy that makes it `bound` sure, or the most there is.
    """

    name: str
    stamps: int
    stamp_j: float
    bound: float
    until_steady: bool = False

    def stamps_on(self, made: list[float]) -> bool:
        """Whether it stamps again after so many measured C3."""
        if not self.until_steady:
            return len(made) < self.stamps
        return len(made) < 2 or (len(made) < MOST_STAMPS and made[-2] - made[-1] > STEADY_C3)


def by_policy(
    policy: FixedPolicy, robot: Robot, tracker: Tracker, demand: Demand, planner: Planner
) -> Spending:
    """The goal sought with a fixed number of stamps; the leap's energy comes from the same belief."""
    made, spent = list[float](), 0.0
    while policy.stamps_on(made):
        hop = robot.hop(policy.stamp_j)
        made.append(-math.expm1(-hop.loss))
        tracker = tracker.after(hop)
        spent += float(planner.costs.energy_j(policy.stamp_j))
    least_j = planner.least_energy_j(tracker, demand, policy.bound)
    energy_j = float(demand.energies_j[-1]) if least_j is None else least_j
    return Spending(_reaches(robot, demand, energy_j), spent + float(planner.costs.energy_j(energy_j)))


def by_planner(robot: Robot, tracker: Tracker, goal: Goal, demand: Demand, planner: Planner) -> Spending:
    """The goal sought as the robot itself would."""
    spent = 0.0
    for _ in range(MOST_STAMPS):
        decision = planner.decide(tracker, goal, C2_REF)
        if decision.action == GIVE_UP:
            break
        spent += float(planner.costs.energy_j(decision.energy_j))
        if decision.action == LEAP:
            return Spending(_reaches(robot, demand, decision.energy_j), spent)
        tracker = tracker.after(robot.hop(decision.energy_j))
    return Spending(False, spent)


def _reaches(robot: Robot, demand: Demand, energy_j: float) -> bool:
    robot.hop(energy_j)
    return robot.losses[-1] <= float(np.interp(energy_j, demand.energies_j, demand.losses))
