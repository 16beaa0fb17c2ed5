"""Hops flown by the whole flight code on the simulated robot: whether the fast world's errors are right."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flight import settings as flight_settings
from flight.executive import fly
from flight.mission import HopPlan, MissionPlan
from flight.surface.priors import loss_of
from hal.board import open_board
from hal.config import config_path, read_yaml
from hal.log import NullLog
from sim_hal.board import world_of
from sim_hal.soils import ground_of, load_soils
from sim_hal.truth import REFERENCE

Array = NDArray[np.float64]

HOPS = 3
SOILS = ("syar", "quartz_sand", "expanded_clay", "quartz_aggregate")


def flown(hops: int, seed: int) -> dict[str, tuple[float, str]]:
    """Errors of u and of ln stiffness, in the fast world's sense, over about so many hops in missions of three."""
    losses: list[float] = []
    stiffnesses: list[float] = []
    named = forecasts = inside = 0
    missions = max(1, hops // HOPS)
    for number in range(missions):
        surface = SOILS[number % len(SOILS)]
        result, truths, stiffness_n_m = _mission(surface, np.random.default_rng([seed, 17, number]))
        last = None
        for report, truth in zip(result.hops[1:], truths[1:], strict=True):
            if report.c3 is None or report.belief is None or report.stance is None:
                continue
            losses.append(loss_of(report.c3.value) - loss_of(truth.c3))
            stiffnesses.append(report.stance.log_stiffness - math.log(stiffness_n_m))
            if last is not None:
                forecasts += 1
                inside += last.next_c3_low <= report.c3.value <= last.next_c3_high
            last = report.belief
        named += last is not None and last.most_probable == surface
    return {
        "flown_loss_error_rms": (float(np.sqrt(np.mean(np.square(losses)))), "1"),
        "flown_log_stiffness_error_rms": (float(np.sqrt(np.mean(np.square(stiffnesses)))), "1"),
        "flown_identified_percent": (100.0 * named / missions, "%"),
        "flown_forecasts_inside_95_percent": (100.0 * inside / max(forecasts, 1), "%"),
        "flown_hops": (float(len(losses)), "1"),
    }


def _mission(surface: str, chance: np.random.Generator) -> tuple[Any, Any, float]:
    """A reference hop and three on one drawn place, which compacts if its soil does."""
    settings, soils = flight_settings.load(), load_soils()
    looseness = float(np.clip(chance.standard_normal(), -2.0, 2.0))
    plan = [HopPlan(18.0, REFERENCE, "reference", True)]
    spots: list[dict[str, Any]] = [{"surface": REFERENCE, "foot": 1, "tilt_deg": 0.0}]
    stiffness_n_m = 0.0
    for earlier in range(HOPS):
        hop_change = float(chance.standard_normal())
        ground = ground_of(
            soils, surface, "1", earlier_hops=earlier, looseness=looseness, hop_change=hop_change
        )
        stiffness_n_m = ground.stiffness_n_m
        plan.append(HopPlan(float(chance.uniform(8.0, 20.0)), surface))
        spots.append({"surface": surface, "foot": 1, "tilt_deg": 0.0, "values": ground.values(surface)})
    found = {
        **read_yaml(config_path("boards", "sim.yaml")),
        "spots": spots,
        "seed": int(chance.integers(2**31)),
    }
    with open_board("sim", found) as board:
        result = fly(board, settings, MissionPlan(surface, tuple(plan)), NullLog())
        return result, world_of(board).hops, stiffness_n_m
