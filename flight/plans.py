"""What a mission is to do: hops as planned by people, then goals towards which the robot chooses its own hops."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from flight.settings import FlightSettings
from flight.surface.goal import Goal, goal_problem
from hal.config import Limits, load_settings
from hal.errors import ConfigError


@dataclass(frozen=True)
class HopPlan:
    """One hop to be made: usable energy, and what is known of the ground there.

    `reference` marks a hop off a rigid surface, which measures C2_ref for the hops after it.
    """

    energy_j: Annotated[float, Limits(1e-3, 1e3)]
    surface: str | None = None
    place: str = "A"
    reference: bool = False
    tilt_deg: Annotated[float, Limits(0.0, 45.0)] = 0.0


@dataclass(frozen=True)
class GoalPlan:
    """A goal at a place. `surface` is what people call the ground there: the belief never sees it."""

    place: str
    goal: Goal
    surface: str | None = None
    simulated: Any = None  # what a simulation puts under the feet there, no business of flight's


@dataclass(frozen=True)
class MissionPlan:
    """The hops of a mission, in order, and after them its goals."""

    name: str
    hops: tuple[HopPlan, ...] = ()
    goals: tuple[GoalPlan, ...] = ()
    simulated: Any = None  # settings of a simulated board for this mission, no business of flight's


def load_mission(path: Path, settings: FlightSettings) -> MissionPlan:
    """Read and check a mission file. Raises `ConfigError` naming file, key, value and limit."""
    plan = load_settings(path, MissionPlan)
    if not plan.hops and not plan.goals:
        raise ConfigError(f"{path}: hops: a mission needs at least one hop or one goal")
    limits = settings.tension
    for index, hop in enumerate(plan.hops):
        if not limits.min_energy_j <= hop.energy_j <= limits.max_energy_j:
            raise ConfigError(
                f"{path}: hops[{index}].energy_j = {hop.energy_j:g} is outside the rig's limits "
                f"[{limits.min_energy_j:g}, {limits.max_energy_j:g}]"
            )
    for index, each in enumerate(plan.goals):
        if problem := goal_problem(each.goal, settings):
            raise ConfigError(f"{path}: goals[{index}].goal: {problem}")
    return plan
