"""What the calibration starts from and aims at (`config/paper/calibration.yaml`)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from statistics import NormalDist
from typing import Annotated

from ground.reproduce.paper import NotNegative, Paper, PaperSurface, Positive, Share
from hal.config import Limits, config_path, load_settings


@dataclass(frozen=True)
class Start:
    """Where a soil's fit starts, and how far its parameters may be moved (1 sigma of a prior)."""

    stiffness_n_m: Positive
    lost_share: Share
    spot_std: NotNegative
    spot_std_fitted: bool = True
    compacts: bool = False


@dataclass(frozen=True)
class CalibrationSettings:
    """Priors, fixed numbers and weights of the calibration.

    `hop_share` is hop_std as a share of spot_std; `mean_tolerance`, `range_tolerance`, `fold_tolerance` are 1
    sigma of a row's mean and range of C3, and of ln(fold).
    """

    energy_j: Positive
    damping_n_s_m: NotNegative
    stiffness_log_std: Positive
    lost_share_std: Positive
    stiffness_spot_std: NotNegative
    hop_share: Share
    mean_tolerance: Positive
    range_tolerance: Positive
    fold_tolerance: Positive
    exponent_start: Positive
    stiffness_exponent_start: Positive
    stiffness_exponent_std: Positive
    flat_factor_start: Positive
    friction_angle_deg_start: Annotated[float, Limits(25.0, 90.0)]
    reference_foot: str
    soils: dict[str, Start]


def load_calibration(path: Path | None = None) -> CalibrationSettings:
    """Read and check the calibration's settings. Raises `ConfigError` naming file, key, value and limit."""
    return load_settings(path or config_path("paper", "calibration.yaml"), CalibrationSettings)


def rows_of(paper: Paper, surface: str) -> list[PaperSurface]:
    """Table 5's rows of one surface."""
    return [row for row in paper.surfaces if row.surface == surface]


def middles(count: int) -> list[float]:
    """Standard normal values in the middle of `count` equally probable strata, smallest first.

    A campaign of a few runs draws its places so: one from each stratum, in random order. Its mean is then the soil's
    and not chance's, which for three runs of the published spread would be 4 points of C3.
    """
    return [NormalDist().inv_cdf((index + 0.5) / count) for index in range(count)]
