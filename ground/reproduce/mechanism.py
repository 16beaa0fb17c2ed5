"""A mechanism that loses a given share of a reference jump, and the numerical model that loses next to nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from scipy.optimize import brentq

from flight import energy
from flight.energy import RigConstants
from flight.settings import RigSettings
from flight.uncertain import Uncertain
from ground.calibration.hop_model import HopModel
from ground.reproduce.plan import AnalysisModel
from hal.errors import ConfigError
from sim_hal.truth import REFERENCE

_MOST_DAMPING_N_S_M = 150.0
_STIFFEST = 1.15
_TOLERANCE = 1e-5


@dataclass
class Mechanisms:
    """Plant values by foot, energy and C2_ref; models are compiled once a foot."""

    rig: RigSettings
    least_damping_n_s_m: float
    _models: dict[str, HopModel] = field(default_factory=dict)

    def model(self, foot: str) -> HopModel:
        """The hop model of a foot."""
        if foot not in self._models:
            self._models[foot] = HopModel(self.rig, foot)
        return self._models[foot]

    def values(self, foot: str, used_j: float, c2_ref: float) -> dict[str, float]:
        """Damping, and below the least damping the stiffness, with which a reference jump loses `c2_ref`.

        What is lost less than the least damped spring loses can only be energy that was stored without being
        counted: a spring stiffer than believed. Raises `ConfigError` when neither reaches it.
        """
        model, damping = self.model(foot), self.least_damping_n_s_m
        compression_m = model.compression_m(used_j)
        stiffness_n_m = model.rig.spring_stiffness_n_m

        def miss(values: dict[str, float]) -> float:
            return model.c2_reference(compression_m, values) - c2_ref

        def by_damping(c: float) -> dict[str, float]:
            return {"c": c, "k": stiffness_n_m}

        def by_stiffness(factor: float) -> dict[str, float]:
            return {"c": damping, "k": factor * stiffness_n_m}

        if miss(by_damping(damping)) <= 0.0:
            return _root(miss, by_damping, damping, _MOST_DAMPING_N_S_M, c2_ref)
        return _root(miss, by_stiffness, 1.0, _STIFFEST, c2_ref)

    def c1_analysis(self, foot: str, compression_m: float, analysis: AnalysisModel) -> float:
        """Eq. (2) with the numerical model of the rig: C1 = 1 - E_pot/E_used, its minimal damping included."""
        model = self.model(foot)
        rig = RigConstants.of(model.rig)
        values = {"c": analysis.damping_n_s_m, f"{REFERENCE}.chi": analysis.contact_lost_share}
        weight_n = rig.total_mass_kg.value * rig.gravity_m_s2.value
        potential_j = weight_n * model.apex_m(REFERENCE, compression_m, values)
        return 1.0 - potential_j / energy.used_energy(Uncertain(compression_m), rig).value


def _root(
    miss: Callable[[dict[str, float]], float],
    build: Callable[[float], dict[str, float]],
    low: float,
    high: float,
    c2_ref: float,
) -> dict[str, float]:
    if miss(build(low)) * miss(build(high)) > 0.0:
        raise ConfigError(f"c2_ref = {c2_ref:g} is beyond what the simulated mechanism can lose")
    return build(float(brentq(lambda x: miss(build(x)), low, high, xtol=_TOLERANCE * high)))
