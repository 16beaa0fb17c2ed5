"""How high the simulated robot hops, as a function of the plant's values: compiled once, run many times."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from flight import energy
from flight.energy import RigConstants
from flight.settings import RigSettings
from flight.uncertain import Uncertain
from hal.config import config_path
from sim_hal.plant.hops import Hops
from sim_hal.plant.simulate import Plant, load_plant
from sim_hal.truth import REFERENCE

PLANT = "plant/bb0b_hop_arm.yaml"


def on_arm(rig: RigSettings, foot: str) -> RigSettings:
    """The rig's settings on its arm with another foot."""
    return replace(rig, geometry="arm", foot=foot)


def foot_values(rig: RigSettings, foot: str) -> dict[str, float]:
    """The hop plant's masses and gravity with a foot (Table 3's inertias at the radius of the centre of mass)."""
    same = on_arm(rig, foot).equivalent
    return {"m_b": same.body_mass_kg, "m_l": same.leg_mass_kg, "g": same.gravity_m_s2}


@dataclass
class HopModel:
    """The hop plant of one foot on the arm, for many values of its parameters."""

    rig: RigSettings
    foot: str
    plant_path: Path = field(default_factory=lambda: config_path(PLANT))
    _plant: Plant = field(init=False)
    _hops: dict[str, Hops] = field(init=False, default_factory=dict)
    _steel: dict[tuple[float, tuple[tuple[str, float], ...]], float] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        self.rig = on_arm(self.rig, self.foot)
        self._plant = load_plant(self.plant_path).with_values(foot_values(self.rig, self.foot))

    def apex_m(self, surface: str, compression_m: float, values: Mapping[str, float]) -> float:
        """Apex of the centre of mass above its start [m]."""
        if surface not in self._hops:
            self._hops[surface] = Hops(self._plant, surface)
        wanted = np.array([values.get(name, known.value) for name, known in self._plant.flat().items()])
        compression = np.array([compression_m])
        return float(self._hops[surface].heights_m(compression, wanted, foot=float(self.foot))[0])

    def c3(self, surface: str, compression_m: float, values: Mapping[str, float]) -> float:
        """Share of the jump energy that the ground takes: 1 - apex there/apex on steel, all else equal."""
        own = {name: value for name, value in values.items() if "." not in name}
        key = (compression_m, tuple(sorted(own.items())))
        if key not in self._steel:
            self._steel[key] = self.apex_m(REFERENCE, compression_m, own)
        return 1.0 - self.apex_m(surface, compression_m, values) / self._steel[key]

    def c2_reference(self, compression_m: float, values: Mapping[str, float]) -> float:
        """Eq. (3) as the flight code has it: against the loss-free hop of the rig that it believes in."""
        rig = RigConstants.of(self.rig)
        weight_n = rig.total_mass_kg.value * rig.gravity_m_s2.value
        ideal_j = energy.analysis_energy(Uncertain(compression_m), rig).value
        return 1.0 - weight_n * self.apex_m(REFERENCE, compression_m, values) / ideal_j

    def compression_m(self, used_j: float) -> float:
        """The compression that stores a usable energy, in the rig that the flight code believes in."""
        return compression_of(used_j, self.rig)


def compression_of(used_j: float, rig: RigSettings) -> float:
    """The compression s [m] with k s²/2 + m_b g s = E_used."""
    weight_n, stiffness_n_m = rig.body_mass_kg * rig.gravity_m_s2, rig.spring_stiffness_n_m
    return (math.sqrt(weight_n**2 + 2.0 * stiffness_n_m * used_j) - weight_n) / stiffness_n_m
