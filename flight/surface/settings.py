"""How the robot learns about ground and what it may risk: the part `surface` of `config/flight.yaml`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from hal.config import Limits

Positive = Annotated[float, Limits(1e-9, 1e9)]
NotNegative = Annotated[float, Limits(0.0, 1e9)]
Share = Annotated[float, Limits(0.0, 1.0)]
Probability = Annotated[float, Limits(1e-6, 1.0 - 1e-6)]


@dataclass(frozen=True)
class LearningSettings:
    """Spreads of the ground's model. Losses are counted in u = -ln(1 - C3), stiffness in ln(N/m)."""

    reference_energy_j: Positive
    energy_slope_share: Annotated[float, Limits(-2.0, 2.0)]
    energy_slope_std: NotNegative
    dose_exponent: NotNegative
    hop_share: Positive
    least_hop_std: Positive
    fall_std: Positive
    unknown_fall: Share
    unknown_fall_std: Positive
    unknown_hop_std: Positive
    stiffness_place_std: Positive
    stiffness_hop_std: Positive
    loss_stiffness: Annotated[float, Limits(-0.99, 0.99)]
    tilt_factor_20deg: Positive
    carried_std: Positive
    foot_factors: dict[str, Positive]


@dataclass(frozen=True)
class ChangeSettings:
    """How often the ground changes under the robot unasked, and how."""

    hazard: Probability
    moved_hazard: Probability
    same_surface: Probability
    loosened_share: Share
    foot_share: Share
    loosening_std: Positive
    other_foot_std: Positive


@dataclass(frozen=True)
class DecisionSettings:
    """From which probability on a surface is named, called new, or a change believed."""

    named: Probability
    novel: Probability
    changed: Probability
    least_hops_to_learn: Annotated[int, Limits(1, 1000)]


@dataclass(frozen=True)
class PlannerSettings:
    """What the planner may choose from, and what a hop costs beside its tensioning."""

    least_stamp_j: Positive
    most_stamps: Annotated[int, Limits(0, 100)]
    overhead_s: NotNegative
    overhead_j: NotNegative
    success_probability: Probability
    unreached_j: Positive
    other_gravity_std: NotNegative
    most_tilt_deg: Positive
    moon_gravity_m_s2: Positive
    mars_gravity_m_s2: Positive


@dataclass(frozen=True)
class SurfaceLearning:
    """All of it."""

    learning: LearningSettings
    change: ChangeSettings
    decision: DecisionSettings
    planner: PlannerSettings
