"""Draws that several studies share."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from flight.mission import HopPlan, MissionPlan
from hal.config import config_path, read_yaml
from sim_hal.plant.simulate import Plant, load_plant, save_plant
from sim_hal.truth import REFERENCE

MOST_LOST = 0.97
"""Share of a soil's energy that may be lost at most: at 1 its unloading stiffness would be infinite."""


def generator(seed: int, index: int) -> np.random.Generator:
    """A case's own random numbers."""
    return np.random.default_rng([seed, index])


def log_uniform(rng: np.random.Generator, span: tuple[float, ...]) -> float:
    """A value between two, evenly in its logarithm."""
    low, high = span
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def as_built(nominal: Plant, within_sigmas: float, rng: np.random.Generator) -> Plant:
    """A rig with every parameter drawn normally within its tolerance, none farther off than `within_sigmas`."""
    values = {}
    for name, parameter in nominal.flat().items():
        away = float(np.clip(rng.standard_normal(), -within_sigmas, within_sigmas))
        value = parameter.value + away * parameter.std
        values[name] = min(max(value, 0.0), MOST_LOST) if name.endswith(".chi") else value
    return nominal.with_values(values)


def nominal_hop_plant() -> Plant:
    """The hop of the rig as the flight software knows it."""
    return load_plant(config_path("plant", "bb0b_hop.yaml"))


def board_with(plant: Plant, folder: Path) -> dict[str, Any]:
    """Settings of the simulated board whose hops are those of `plant`, which is put into `folder`."""
    found = read_yaml(config_path("boards", "sim.yaml"))
    file = folder / "hop.yaml"
    save_plant(plant, file)
    return {**found, "plants": {**found["plants"], "hop": str(file)}}


def hops_on(name: str, surface: str, reference_energy_j: float, energies_j: tuple[float, ...]) -> MissionPlan:
    """A reference hop off steel, then hops on one place of a surface."""
    reference = HopPlan(reference_energy_j, surface=REFERENCE, place="reference", reference=True)
    leaps = (HopPlan(energy_j, surface=surface, place="A") for energy_j in energies_j)
    return MissionPlan(name, (reference, *leaps))
