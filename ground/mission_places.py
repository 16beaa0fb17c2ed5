"""The ground that a simulation puts under a mission's goals, hop by hop, as the robot decides to stay or go.

The flight code is not told: what it decides stands in its log, and there this looks.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Annotated, Any

import numpy as np

from flight.plans import GoalPlan, MissionPlan
from hal.config import Limits, build_settings
from hal.errors import ConfigError
from hal.log import LogSink, log_problem, tick_end_of
from sim_hal.plant.plant import Plant
from sim_hal.settings import Spot
from sim_hal.soils import Soils, ground_of, load_soils
from sim_hal.world import World

RATE = "ground_contact.soil_rate_dependence.c_g"


@dataclass(frozen=True)
class SimulatedPlace:
    """One place: a soil of `config/surfaces.yaml` or a surface of the plant, and how it is here.

    `looseness` in standard deviations of the soil's places; `kept_by_hop`: loss after a hop as a share of that before
    it, where it is not the soil's own; `rate_n_s_m`: resistance per speed of sinking, as of cohesive soil;
    `loosened_before_hop`: the hop here (from 1) before which somebody loosens it.
    """

    surface: str
    looseness: Annotated[float, Limits(-3.0, 3.0)] = 0.0
    kept_by_hop: Annotated[float | None, Limits(0.1, 1.0)] = None
    rate_n_s_m: Annotated[float, Limits(0.0, 5000.0)] = 0.0
    loosened_before_hop: Annotated[int | None, Limits(1, 1000)] = None


@dataclass
class Terrain:
    """Hears the robot's decisions, as the log that it writes to, and moves the ground accordingly."""

    log: LogSink
    world: World
    plan: MissionPlan
    foot: str
    seed: int
    _soils: Soils = field(default_factory=load_soils)
    _hops: dict[str, int] = field(default_factory=dict)

    @property
    def problem(self) -> str:
        """Why the log no longer records; empty while it does."""
        return log_problem(self.log)

    def write(self, topic: str, time_s: float, payload: Mapping[str, Any]) -> None:
        """Record a message; after a decision on a hop put the robot where it is to be made."""
        self.log.write(topic, time_s, payload)
        if topic == "event" and payload["name"] == "decision" and payload["action"] != "give_up":
            self.world.stand_on(self._spot(payload["place"], payload["hop_index"]))

    def tick_done(self) -> None:
        """Tell the log that a tick is over."""
        tick_end_of(self.log)()

    def _spot(self, place: str, hop_index: int) -> Spot:
        goal = next(goal for goal in self.plan.goals if goal.place == place.rstrip("'"))
        made = self._hops.get(place, 0)
        self._hops[place] = made + 1
        return spot_of(goal, place, made, hop_index, self.foot, self.seed, self._soils, self.world.hop_plant)


def spot_of(
    goal: GoalPlan,
    place: str,
    made: int,
    hop_index: int,
    foot: str,
    seed: int,
    soils: Soils,
    plant: Plant,
) -> Spot:
    """The ground under one hop at a goal's place, where so many were made. Raises `ConfigError` for one unknown."""
    here = place_of(goal)
    since = (
        made
        if here.loosened_before_hop is None or made < here.loosened_before_hop - 1
        else (made - here.loosened_before_hop + 1)
    )
    tilt_deg = abs(goal.goal.tilt_deg)
    chance = np.random.default_rng([seed, 7, hop_index])
    hop_change = float(chance.standard_normal())
    moves = place.count("'")
    looseness = (
        here.looseness if not moves else float(np.random.default_rng([seed, 8, moves]).standard_normal())
    )
    surface = here.surface
    if surface in soils.soils:
        ground = ground_of(
            soils, surface, foot, tilt_deg, earlier_hops=since, looseness=looseness, hop_change=hop_change
        )
        values = ground.values(surface)
    elif surface in plant.surfaces:
        kept = 1.0 if here.kept_by_hop is None else here.kept_by_hop
        lost = plant.surfaces[surface]["chi"].value * kept**since
        values = {f"{surface}.chi": min(lost * (1.0 + 0.01 * hop_change), 0.99)}
    else:
        known = ", ".join(dict.fromkeys([*soils.soils, *plant.surfaces]))
        raise ConfigError(f"place {place}: simulated.surface = {surface!r} is unknown; known: {known}")
    if here.rate_n_s_m:
        values[RATE] = here.rate_n_s_m
    return Spot(surface, int(foot), tilt_deg, values)


def place_of(goal: GoalPlan) -> SimulatedPlace:
    """What a simulation is to know of a goal's place; the surface alone will do. Raises `ConfigError`."""
    where = f"goals at {goal.place}"
    if goal.simulated is not None:
        return build_settings(goal.simulated, SimulatedPlace, where, "simulated.")
    if goal.surface is None:
        raise ConfigError(f"{where}: surface or simulated is missing: a simulation must know the ground")
    return SimulatedPlace(goal.surface)


def first_spot(plan: MissionPlan, foot: str) -> dict[str, Any]:
    """Something to stand on before the first decision of a mission without planned hops."""
    spot = Spot(place_of(plan.goals[0]).surface, int(foot), abs(plan.goals[0].goal.tilt_deg))
    return asdict(spot)
