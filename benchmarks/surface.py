"""What the surface belief and the planner are worth, in simulated missions on places that they have never seen.

    python -m benchmarks.surface [--json FILE] [--missions N] [--planned N] [--flown N] [--seed S]

The fast world (benchmarks/surface_world.py) draws places from the published means and ranges and adds the estimator's
own errors; `--flown` hops of the real flight code on the simulated robot show beside it that it is right.
Identification is compared with the exact posterior of that world. The planner's goal is to clear a height with one
leap, drawn whatever the ground; its rivals stamp with the least energy there is and get the best of several margins
on these very missions; compared is what each spends at the planner's success.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.figures import write_figures
from benchmarks.surface_exact import ExactPosterior
from benchmarks.surface_flown import flown
from benchmarks.surface_missions import (
    C2_REF,
    HEIGHTS_M,
    FixedPolicy,
    Robot,
    Spending,
    by_planner,
    by_policy,
    identified,
)
from benchmarks.surface_world import FOOT, TILT_DEG, World
from flight import settings as flight_settings
from flight.surface.forecast import forecast_loss
from flight.surface.goal import Demand, Goal
from flight.surface.known import UNKNOWN, load_surfaces
from flight.surface.planner import Planner
from flight.surface.tracker import GroundModels, Tracker

Array = NDArray[np.float64]
Figures = dict[str, tuple[float, str]]
Show = Callable[[str], None]

HOPS = 4
BINS = 15
BEFORE, AFTER_CHANGE = 3, 2


@dataclass(frozen=True)
class Bench:
    """The world, and the belief's own models of it."""

    world: World
    ground: GroundModels
    planner: Planner
    chance: np.random.Generator

    @staticmethod
    def of(seed: int) -> Bench:
        """The shipped configuration."""
        surfaces, settings = load_surfaces(), flight_settings.load()
        ground = GroundModels.of(surfaces, settings.surface, FOOT, TILT_DEG)
        return Bench(
            World(surfaces, settings.surface), ground, Planner(settings), np.random.default_rng([seed, 11])
        )

    def drawn(self) -> tuple[int, str]:
        """A surface by chance, as often as each occurs."""
        index = int(self.chance.choice(len(self.world.names), p=self.world.prior))
        return index, self.world.names[index]


def identification(bench: Bench, missions: int, seed: int) -> Figures:
    """Surface posterior: calibration, distance to the exact one, novelty; and the height of the next leap."""
    exact = ExactPosterior(bench.world, seed)
    counted = (1, 2, HOPS)
    confidence, right, ours, best = [], [], np.zeros(3), np.zeros(3)
    every, truth_of = [], []
    novel, errors, by_last = [], [], []
    inside = 0
    for _ in range(missions):
        truth, name = bench.drawn()
        energies = bench.chance.uniform(5.0, 20.0, HOPS + 1)
        beliefs, data, losses = identified(bench.world, bench.ground, name, energies, bench.chance)
        for number, tracker in enumerate(beliefs[:HOPS]):
            shares = tracker.probabilities_array()
            confidence.append(float(shares.max()))
            right.append(int(shares.argmax()) == truth)
            every.append(shares)
            truth_of.append(truth)
            following = forecast_loss(tracker, float(energies[number + 1]))
            low, middle, high = following.quantiles((0.025, 0.5, 0.975))
            errors.append(abs(math.exp(-middle + losses[number + 1]) - 1.0))
            by_last.append(abs(math.exp(-data.loss[number] + losses[number + 1]) - 1.0))
            inside += low <= losses[number + 1] <= high
        posteriors = exact.after(data, counted)
        ours += [int(beliefs[n - 1].probabilities_array().argmax()) == truth for n in counted]
        best += [int(posterior.argmax()) == truth for posterior in posteriors]
        flagged = float(beliefs[2].probabilities_array()[-1]) >= bench.ground.settings.decision.novel
        novel.append((name == UNKNOWN, flagged))
    gaps = (best - ours) / missions
    is_new, flags = np.array(novel).T
    figures: Figures = {"calibration_error": (calibration_error(np.array(confidence), np.array(right)), "1")}
    figures["calibration_error_all_surfaces"] = (classwise_error(np.array(every), np.array(truth_of)), "1")
    for index, hop in enumerate(counted):
        figures[f"identification_hop{hop}"] = (float(ours[index] / missions), "1")
        figures[f"identification_exact_hop{hop}"] = (float(best[index] / missions), "1")
        figures[f"identification_gap_hop{hop}"] = (float(gaps[index]), "1")
    figures["novelty_detected_percent"] = (100.0 * float(flags[is_new].mean()), "%")
    figures["novelty_false_percent"] = (100.0 * float(flags[~is_new].mean()), "%")
    figures["height_mae_percent"] = (100.0 * float(np.mean(errors)), "%")
    figures["height_mae_by_equation_seven_percent"] = (100.0 * float(np.mean(by_last)), "%")
    figures["height_interval_coverage_percent"] = (100.0 * inside / len(errors), "%")
    return figures


def calibration_error(confidence: Array, right: NDArray[np.bool_]) -> float:
    """Expected calibration error of the most probable surface, in bins of equal width."""
    which = np.clip((confidence * BINS).astype(int), 0, BINS - 1)
    gaps = [
        abs(float(confidence[which == b].mean()) - float(right[which == b].mean()))
        * float((which == b).mean())
        for b in range(BINS)
        if (which == b).any()
    ]
    return float(sum(gaps))


def classwise_error(shares: Array, truths: NDArray[np.int64]) -> float:
    """The same for every surface's probability, averaged over surfaces."""
    return float(np.mean([calibration_error(shares[:, k], truths == k) for k in range(shares.shape[1])]))


def changes(bench: Bench, missions: int) -> Figures:
    """Changes of the ground that nobody announces: found within two hops, and imagined where there was none."""
    found: dict[str, list[bool]] = {"place": [], "same_surface_place": [], "loosened": [], "foot": []}
    imagined: list[bool] = []
    kinds = ("place", "place", "loosened", "foot")
    for number in range(missions):
        _, name = bench.drawn()
        robot = Robot.on(bench.world.spots(name, 1, bench.chance), bench.world, bench.chance)
        tracker = Tracker.begin(bench.ground, (0.0, robot.common_std))
        for energy_j in map(float, bench.chance.uniform(8.0, 20.0, BEFORE)):
            tracker = tracker.after(robot.hop(energy_j))
            imagined.append(tracker.changed_within(1) >= bench.ground.settings.decision.changed)
        kind = _change(bench, robot, name, kinds[number % len(kinds)])
        for energy_j in map(float, bench.chance.uniform(8.0, 20.0, AFTER_CHANGE)):
            tracker = tracker.after(robot.hop(energy_j))
        found[kind].append(tracker.changed_within(AFTER_CHANGE) >= bench.ground.settings.decision.changed)
    places = found["place"] + found["same_surface_place"]
    figures: Figures = {"change_within_two_percent": (100.0 * float(np.mean(places)), "%")}
    for kind, name in (
        ("place", "change_to_another_surface_percent"),
        ("same_surface_place", "change_on_the_same_surface_percent"),
        ("loosened", "change_loosened_percent"),
        ("foot", "change_of_foot_percent"),
    ):
        figures[name] = (100.0 * float(np.mean(found[kind])), "%")
    figures["change_imagined_percent_of_hops"] = (100.0 * float(np.mean(imagined)), "%")
    return figures


def _change(bench: Bench, robot: Robot, name: str, kind: str) -> str:
    """Change the ground under a robot; says which way it was."""
    if kind == "place":
        _, other = bench.drawn()
        robot.spot = bench.world.spots(other, 1, bench.chance)
        kind = "same_surface_place" if other == name != UNKNOWN else "place"
    elif kind == "foot":
        factors = bench.ground.settings.learning.foot_factors
        factor = float(bench.chance.choice([f for f in factors.values() if f != 1.0]))
        robot.spot = replace(robot.spot, loss=robot.spot.loss * factor)
    robot.dose = 0.0
    return kind


@dataclass(frozen=True)
class Tally:
    """What a policy spent on a mission, and how often it reached the goal."""

    energy_j: float
    success: float

    @staticmethod
    def of(spendings: Sequence[Spending]) -> Tally:
        """Means over missions."""
        return Tally(
            float(np.mean([each.energy_j for each in spendings])),
            float(np.mean([each.reached for each in spendings])),
        )


Job = Callable[[Robot, Tracker, Goal, Demand], Spending]


@dataclass(frozen=True)
class GoalMissions:
    """Missions with a height to clear, drawn whatever the ground: the same ones for every policy."""

    bench: Bench
    missions: int
    seed: int

    def flown(self, job: Job) -> Tally:
        """What comes of them by one policy."""
        world, ground = self.bench.world, self.bench.ground
        found = []
        for number in range(self.missions):
            chance = np.random.default_rng([self.seed, 13, number])
            name = world.names[int(chance.choice(len(world.names), p=world.prior))]
            robot = Robot.on(world.spots(name, 1, chance), world, chance)
            goal = Goal(clear_height_m=float(chance.uniform(*HEIGHTS_M)))
            demand = Demand.of(goal, self.bench.planner.settings, C2_REF)
            found.append(job(robot, Tracker.begin(ground, (0.0, robot.common_std)), goal, demand))
        return Tally.of(found)


RIVALS = (("never", 0), ("always_three", 3), ("until_steady", 0))
BOUNDS = (0.93, 0.945, 0.96, 0.975)
"""Probabilities of success that a rival may ask for, on all of which it is tried."""


def savings(bench: Bench, missions: int, seed: int, show: Show) -> Figures:
    """The planner beside fixed policies on the same spots and goals: energy at no less success."""
    sought, planner = GoalMissions(bench, missions, seed), bench.planner
    own = sought.flown(lambda robot, tracker, goal, demand: by_planner(robot, tracker, goal, demand, planner))
    show(f"planner: {own.energy_j:.1f} J a mission, {100 * own.success:.1f} % reach the goal")
    figures: Figures = {
        "planner_energy_j": (own.energy_j, "J"),
        "planner_success_percent": (100 * own.success, "%"),
    }
    best = math.inf
    stamp_j = planner.settings.surface.planner.least_stamp_j
    for kind, stamps in RIVALS:
        policies = [FixedPolicy(kind, stamps, stamp_j, bound, kind == "until_steady") for bound in BOUNDS]
        tally = _at_equal_success(policies, sought, own.success, show)
        figures[f"{kind}_energy_j"] = (tally.energy_j, "J")
        figures[f"{kind}_success_percent"] = (100 * tally.success, "%")
        figures[f"saving_against_{kind}_percent"] = (100 * (1 - own.energy_j / tally.energy_j), "%")
        best = min(best, tally.energy_j)
    figures["energy_saving_percent"] = (100.0 * (1.0 - own.energy_j / best), "%")
    return figures


def _at_equal_success(
    policies: Sequence[FixedPolicy], sought: GoalMissions, success: float, show: Show
) -> Tally:
    """What a policy spends at a success, interpolated over its margins; that of its highest where none gets there."""
    planner, tallies = sought.bench.planner, []
    for policy in policies:
        job: Job = partial(_by_policy, policy, planner)
        tallies.append(sought.flown(job))
        show(
            f"{policy.name}, {policy.stamp_j:g} J, {policy.bound}: {tallies[-1].energy_j:.1f} J, "
            f"{100 * tallies[-1].success:.1f} %"
        )
    tallies.sort(key=lambda tally: (tally.success, tally.energy_j))
    shares = [tally.success for tally in tallies]
    at = min(max(success, shares[0]), shares[-1])
    return Tally(float(np.interp(at, shares, [tally.energy_j for tally in tallies])), at)


def _by_policy(
    policy: FixedPolicy, planner: Planner, robot: Robot, tracker: Tracker, goal: Goal, demand: Demand
) -> Spending:
    return by_policy(policy, robot, tracker, demand, planner)


def main() -> None:
    """Measure, print, and write the figures where asked."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", type=Path, help="write the figures here")
    parser.add_argument("--missions", type=int, default=2000, help="for identification, and for changes")
    parser.add_argument("--planned", type=int, default=2000, help="for the planner")
    parser.add_argument("--flown", type=int, default=24, help="hops flown by the whole flight code")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    bench = Bench.of(arguments.seed)
    figures: Figures = {}
    jobs: tuple[tuple[str, Callable[[], Figures]], ...] = (
        ("identification", lambda: identification(bench, arguments.missions, arguments.seed)),
        ("changes", lambda: changes(bench, arguments.missions)),
        ("planner", lambda: savings(bench, arguments.planned, arguments.seed, print)),
        ("flown", lambda: flown(arguments.flown, arguments.seed)),
    )
    for title, job in jobs:
        print(f"-- {title}", flush=True)
        found = job()
        for name, (value, unit) in found.items():
            print(f"{name:42s} {value:9.4g} {unit}", flush=True)
        figures |= found
    if arguments.json:
        write_figures(arguments.json, figures)


if __name__ == "__main__":
    main()
