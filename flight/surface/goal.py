"""What a leap is for, and how much of a push it needs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from flight.settings import FlightSettings
from flight.surface.trajectory import Jumper, upright_for_height_m, upright_for_range_m
from flight.tensioning import compression_for_energy_m
from hal.config import Limits

Array = NDArray[np.float64]

_POINTS = 60


@dataclass(frozen=True)
class Goal:
    """Clear a height, `leaps` times from one spot, or cover a distance with so many; within budgets, if any.

    `success_probability` is the least with which a leap is made; 0 stands for the flight settings' own.
    """

    clear_height_m: Annotated[float | None, Limits(1e-3, 100.0)] = None
    distance_m: Annotated[float | None, Limits(1e-3, 1000.0)] = None
    leaps: Annotated[int, Limits(1, 1000)] = 1
    tilt_deg: Annotated[float, Limits(-45.0, 45.0)] = 0.0
    energy_budget_j: Annotated[float | None, Limits(1.0, 1e7)] = None
    time_budget_s: Annotated[float | None, Limits(1.0, 1e7)] = None
    success_probability: Annotated[float, Limits(0.0, 0.9999)] = 0.0
    may_move: bool = False

    def after_leap(self, covered_m: float | None) -> Goal:
        """What is left once a leap has been made, which covered so much; unknown counts as its share."""
        if self.distance_m is None:
            return replace(self, leaps=self.leaps - 1)
        covered_m = self.distance_m / self.leaps if covered_m is None else covered_m
        return replace(self, leaps=self.leaps - 1, distance_m=max(self.distance_m - covered_m, 1e-3))

    @property
    def words(self) -> str:
        """The goal in words."""
        if self.clear_height_m is not None:
            return f"clear {self.clear_height_m:.3g} m" + (f" {self.leaps} times" if self.leaps > 1 else "")
        return f"cover {self.distance_m:.3g} m in {self.leaps} leap{'s' if self.leaps > 1 else ''}"


def goal_problem(goal: Goal, settings: FlightSettings) -> str:
    """What is wrong with a goal, in words; empty for nothing."""
    if (goal.clear_height_m is None) == (goal.distance_m is None):
        return "needs one of clear_height_m and distance_m"
    if goal.distance_m is not None and goal.tilt_deg == 0.0:
        return "tilt_deg must not be 0 where a distance is to be covered"
    if abs(goal.tilt_deg) > settings.surface.planner.most_tilt_deg:
        return f"tilt_deg = {goal.tilt_deg:g} is beyond the leg's {settings.surface.planner.most_tilt_deg:g}"
    return ""


@dataclass(frozen=True)
class Demand:
    """For each usable energy (n,), increasing: the largest loss u with which a leap of it reaches the goal (n,)."""

    energies_j: Array
    losses: Array

    @staticmethod
    def of(goal: Goal, settings: FlightSettings, c2_ref: float) -> Demand:
        """The demand of the next leap towards a goal, where the rig stands."""
        tension, jumper = settings.tension, Jumper.of(settings.rig)
        energies = np.linspace(tension.min_energy_j, tension.max_energy_j, _POINTS)
        losses = []
        for energy_j in energies:
            s = compression_for_energy_m(float(energy_j), settings.rig)
            if goal.clear_height_m is not None:
                wanted_m = upright_for_height_m(jumper, s, goal.clear_height_m, goal.tilt_deg)
            else:
                assert goal.distance_m is not None
                wanted_m = upright_for_range_m(jumper, s, goal.distance_m / goal.leaps, goal.tilt_deg)
            able_m = (1.0 - c2_ref) * jumper.analysis_j(s) / (jumper.mass_kg * jumper.gravity_m_s2)
            losses.append(np.log(able_m / wanted_m))
        return Demand(energies, np.maximum.accumulate(np.array(losses)))

    def energy_j(self, loss: Array | float) -> Array:
        """Least usable energy with which a leap reaches the goal at a loss; infinite where none does."""
        found = np.interp(loss, self.losses, self.energies_j)
        return np.where(np.asarray(loss) > self.losses[-1], np.inf, found)
