"""What is published, as checked settings (`config/paper/wisniewski2021.yaml`)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from hal.config import Limits, config_path, load_settings
from hal.errors import ConfigError

Positive = Annotated[float, Limits(1e-12, 1e12)]
NotNegative = Annotated[float, Limits(0.0, 1e12)]
Share = Annotated[float, Limits(0.0, 1.0)]
Count = Annotated[int, Limits(1, 100000)]
MaybeShare = Annotated[float | None, Limits(0.0, 1.0)]


@dataclass(frozen=True)
class Span:
    """Mean and range of several runs; the range is None where only the mean is published."""

    mean: Share
    low: MaybeShare = None
    high: MaybeShare = None
    runs: Annotated[int | None, Limits(1, 100000)] = None


@dataclass(frozen=True)
class Range:
    """Smallest and largest published value."""

    low: NotNegative
    high: NotNegative


@dataclass(frozen=True)
class Measured:
    """A value with its standard uncertainty."""

    value: Positive
    std: NotNegative


@dataclass(frozen=True)
class CampaignSize:
    """How many jumps, at which energies and forces."""

    jumps: Count
    accepted: Count
    references: Count
    spring_energy_j: Range
    spring_force_n: Range


@dataclass(frozen=True)
class PaperFoot:
    """One foot: Table 3's inertias, Table 4's C1 and C2_ref; the area is None for bare rods."""

    shape: str
    mass_kg: NotNegative
    leg_inertia_kg_m2: Positive
    total_inertia_kg_m2: Positive
    c1_expected: Share
    c1: Span
    c2_ref: Span
    area_m2: Annotated[float | None, Limits(1e-6, 1.0)] = None


@dataclass(frozen=True)
class PaperSurface:
    """One row of Table 5: C3 by the reference jump just before, and by the average of all of them."""

    surface: str
    foot: str
    tilt_deg: NotNegative
    runs: Count
    density_kg_m3: Positive
    c3_direct: Span
    c3_average: Span

    @property
    def key(self) -> tuple[str, str, float]:
        """Surface, foot and tilt: what a row is known by."""
        return self.surface, self.foot, self.tilt_deg


@dataclass(frozen=True)
class PaperPrediction:
    """One row of Table 6: mean absolute error of the predicted height, as a share."""

    surface: str
    tilt_deg: NotNegative
    runs: Count
    mae: Share


@dataclass(frozen=True)
class PredictionTotal:
    """Table 6, all runs."""

    runs: Count
    mae: Share


@dataclass(frozen=True)
class Compaction:
    """By which factor C3 fell over so many hops in one place."""

    surface: str
    fold: Annotated[float, Limits(1.0, 100.0)]
    hops: Annotated[int, Limits(2, 100)]


@dataclass(frozen=True)
class TiltEffect:
    """By which factor a tilt raised C3."""

    surface: str
    tilt_deg: Positive
    factor: Positive


@dataclass(frozen=True)
class MoonHop:
    """The projection to the Moon (Figure 23)."""

    mass_kg: Positive
    leg_mass_kg: Positive
    c1: Share
    c2: Share
    spring_energy_j: Positive
    legs: Count
    gravity_m_s2: Positive
    height_low_m: Positive
    height_high_m: Positive
    c3_low: Share
    c3_high: Share


@dataclass(frozen=True)
class Paper:
    """All published numbers."""

    citation: str
    campaign: CampaignSize
    masses_kg: dict[str, Positive]
    com_radius: Measured
    feet: dict[str, PaperFoot]
    c1_model_error: Share
    c2_ref_all: Span
    surfaces: tuple[PaperSurface, ...]
    prediction: tuple[PaperPrediction, ...]
    prediction_all: PredictionTotal
    compaction: Compaction
    tilt: TiltEffect
    moon: MoonHop

    def row(self, surface: str, foot: str, tilt_deg: float) -> PaperSurface | None:
        """The row of Table 5 for a surface, foot and tilt; None where there is none."""
        return next((row for row in self.surfaces if row.key == (surface, foot, tilt_deg)), None)


def load_paper(path: Path | None = None) -> Paper:
    """Read and check the published numbers. Raises `ConfigError` naming file, key, value and limit."""
    where = path or config_path("paper", "wisniewski2021.yaml")
    paper = load_settings(where, Paper)
    seen = set()
    for index, row in enumerate(paper.surfaces):
        if row.foot not in paper.feet:
            raise ConfigError(f"{where}: surfaces[{index}].foot = {row.foot!r} is not among feet")
        if row.key in seen:
            raise ConfigError(f"{where}: surfaces[{index}]: {row.key} stands twice")
        seen.add(row.key)
    return paper
