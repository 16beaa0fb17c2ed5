"""Drawn cases of hops: rigs, gravities, feet, surfaces, tilts, energies, sensors, and physics that is not told.

A `nominal` hop is the configured rig on the vertical line within its tolerances, sensors as on their data sheets.
A `broad` hop is drawn over all of these, often with physics that the estimator is not told of.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sim_hal.plant.simulate import catalogue

SURFACES = ("steel", "syar", "quartz_sand", "expanded_clay", "quartz_aggregate")
GRAVITIES = {"moon": 1.62, "mars": 3.71, "earth": 9.81}

#: Physics the estimator does not know: median and largest strength of each, by parameter; drawn log-uniformly
#: from a fifth of the median to the largest.
#: Effects that the catalogue does not have are left out.
HIDDEN: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "sleeve_friction": {"F_f": (3.0, 10.0)},
    "soil_rate_dependence": {"c_g": (30.0, 200.0)},
    "soil_hardening": {"n": (0.1, 0.4)},
    "latch_drag": {"F_d": (10.0, 60.0), "t_f": (0.005, 0.015)},
    "release_delay": {"delay": (0.001, 0.004)},
    "aerodynamic_drag_quadratic": {"cd_a": (0.05, 0.2)},
    "aerodynamic_drag_linear": {"d": (0.1, 0.5)},
    "buoyancy": {"B": (0.1, 0.6)},
}

_OF_AIR = ("aerodynamic_drag_quadratic", "aerodynamic_drag_linear", "buoyancy")
_OF_SOIL = ("soil_rate_dependence", "soil_hardening")


@dataclass(frozen=True)
class HopCase:
    """What was drawn. `hidden`: names of effects switched on. `cell` names what a case is grouped by."""

    rig: str
    body: str
    surface: str
    foot: str
    tilt_deg: float
    compression_m: float
    rate_hz: float
    noise_factor: float
    missing_share: float
    clock_skew: float
    range_g: float
    hidden: tuple[str, ...]

    def cells(self) -> dict[str, str]:
        """The groups in which worst cells are looked for."""
        bounds = (400.0, 800.0, 1600.0, 3201.0)
        low = max(b for b in bounds[:-1] if b <= self.rate_hz)
        return {
            "rig": self.rig,
            "gravity": self.body,
            "surface": self.surface,
            "foot": self.foot,
            "tilt": f"{self.tilt_deg:g} deg",
            "rate": f"{low:g}-{bounds[bounds.index(low) + 1]:g} Hz",
            "noise": "x0.5-1" if self.noise_factor < 1.0 else "x1-2" if self.noise_factor < 2.0 else "x2-4",
            "range": f"{self.range_g:g} g",
            "hidden": "+".join(self.hidden) or "nothing",
        }


def draw_case(rng: np.random.Generator, nominal: bool) -> HopCase:
    """One case; the nominal ones differ in surface and energy alone."""
    surface = str(rng.choice(SURFACES))
    compression_m = float(rng.uniform(0.022, 0.038))
    if nominal:
        return HopCase("bb0b", "earth_arm", surface, "1", 0.0, compression_m, 1666.0, 1.0, 0.0, 0.0, 32.0, ())
    rig = str(rng.choice(("bb0b", "bb0b_arm", "hopter"), p=(0.5, 0.25, 0.25)))
    body = "earth_arm" if rig == "bb0b_arm" else str(rng.choice(list(GRAVITIES)))
    return HopCase(
        rig,
        body,
        surface,
        "3x1" if rig == "hopter" else str(rng.choice(("0", "1", "2", "3", "4"))),
        float(rng.choice((0.0, 10.0, 20.0))),
        compression_m,
        float(math.exp(rng.uniform(math.log(400.0), math.log(3200.0)))),
        float(math.exp(rng.uniform(math.log(0.5), math.log(4.0)))),
        0.02,
        float(rng.uniform(-0.03, 0.03)),
        float(rng.choice((16.0, 32.0))),
        _hidden(rng, body, surface),
    )


def _hidden(rng: np.random.Generator, body: str, surface: str) -> tuple[str, ...]:
    """Effects that are there; those of the air and of soil only where there is some."""
    absent = (() if "earth" in body else _OF_AIR) + (_OF_SOIL if surface == "steel" else ())
    known = sorted(name for name in HIDDEN if name in catalogue() and name not in absent)
    count = int(rng.choice((0, 1, 2), p=(0.4, 0.4, 0.2)))
    return tuple(sorted(str(name) for name in rng.choice(known, count, replace=False)))
