"""What the hops say about the ground: C3 of the spot, and which of the known surfaces it may be."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from hal.config import Limits, config_path, load_settings
from hal.errors import ConfigError

UNKNOWN = "none_of_the_known"
C3 = Annotated[float, Limits(-0.5, 1.0)]
Std = Annotated[float, Limits(1e-6, 1.0)]

# A range of a few values reaches about two standard deviations to either side of their mean.
_SIGMAS_IN_RANGE = 4.0


@dataclass(frozen=True)
class KnownSurface:
    """Published dissipation of one surface with one foot and tilt."""

    name: str
    foot: str
    tilt_deg: float
    c3_mean: C3
    c3_low: C3
    c3_high: C3

    @property
    def c3_std(self) -> float:
        return (self.c3_high - self.c3_low) / _SIGMAS_IN_RANGE


@dataclass(frozen=True)
class SurfaceSettings:
    """The known surfaces and the priors."""

    surfaces: tuple[KnownSurface, ...]
    unknown_probability: Annotated[float, Limits(1e-6, 1.0)]
    unknown_c3_low: C3
    unknown_c3_high: C3
    prior_c3_mean: C3
    prior_c3_std: Std
    compaction_std: Std
    simulated: Any = None  # the same file's soils of the simulation, no business of flight's


def load_surfaces(path: Path | None = None) -> SurfaceSettings:
    """Read and check `config/surfaces.yaml`. Raises `ConfigError` naming file, key, value and limit."""
    where = path or config_path("surfaces.yaml")
    settings = load_settings(where, SurfaceSettings)
    check_surfaces(settings, str(where))
    return settings


def check_surfaces(settings: SurfaceSettings, where: str) -> None:
    """Raises `ConfigError` naming `where`, key, value and limit if the settings contradict themselves."""
    for index, surface in enumerate(settings.surfaces):
        if not surface.c3_low <= surface.c3_mean <= surface.c3_high or surface.c3_std == 0.0:
            raise ConfigError(
                f"{where}: surfaces[{index}]: c3_mean = {surface.c3_mean:g} must lie within "
                f"[c3_low, c3_high] = [{surface.c3_low:g}, {surface.c3_high:g}], which must not be empty"
            )
    if settings.unknown_c3_low >= settings.unknown_c3_high:
        raise ConfigError(f"{where}: unknown_c3_low must be below unknown_c3_high")


@dataclass(frozen=True)
class SurfaceBelief:
    """Belief about one spot after `hops` hops: Gaussian C3, and the probability of each surface."""

    c3_mean: float
    c3_std: float
    probabilities: Mapping[str, float]
    hops: int = 0

    @property
    def most_probable(self) -> str:
        return max(self.probabilities, key=lambda name: self.probabilities[name])


def prior_belief(settings: SurfaceSettings, foot: str, tilt_deg: float) -> SurfaceBelief:
    """Before the first hop on a spot: the published surfaces of this foot and tilt, equally probable."""
    names = [surface.name for surface in _relevant(settings, foot, tilt_deg)]
    share = (1.0 - settings.unknown_probability) / len(names) if names else 0.0
    unknown = settings.unknown_probability if names else 1.0
    probabilities = {**dict.fromkeys(names, share), UNKNOWN: unknown}
    return SurfaceBelief(settings.prior_c3_mean, settings.prior_c3_std, probabilities)


def updated_belief(
    belief: SurfaceBelief,
    c3: float,
    c3_sigma: float,
    settings: SurfaceSettings,
    foot: str,
    tilt_deg: float,
) -> SurfaceBelief:
    """The belief after one more hop with the measured C3 +- sigma.

    C3 of the spot: a Kalman step, whose process noise is the ground's compaction between hops. Surfaces: a
    surface's own spread and the measurement's add up. Later hops on a spot repeat the same draw of its
    C3, so their evidence counts by the hop's share of the spot's information (1/n), not as if independent.
    """
    if not (math.isfinite(c3) and math.isfinite(c3_sigma) and c3_sigma > 0.0):
        raise ValueError(f"C3 = {c3!r} +- {c3_sigma!r} is no measurement")
    before = belief.c3_std**2 + (settings.compaction_std**2 if belief.hops else 0.0)
    gain = before / (before + c3_sigma**2)
    mean, std = belief.c3_mean + gain * (c3 - belief.c3_mean), math.sqrt((1.0 - gain) * before)
    logs = {name: math.log(p) for name, p in belief.probabilities.items() if p > 0.0}
    weight = 1.0 / (belief.hops + 1)
    for surface in _relevant(settings, foot, tilt_deg):
        if surface.name in logs:
            logs[surface.name] += weight * _log_normal(c3 - surface.c3_mean, surface.c3_std, c3_sigma)
    logs[UNKNOWN] += weight * _log_box(c3, c3_sigma, settings.unknown_c3_low, settings.unknown_c3_high)
    most = max(logs.values())
    total = sum(math.exp(value - most) for value in logs.values())
    probabilities = {name: math.exp(value - most) / total for name, value in logs.items()}
    return SurfaceBelief(mean, std, probabilities, belief.hops + 1)


def _relevant(settings: SurfaceSettings, foot: str, tilt_deg: float) -> list[KnownSurface]:
    return [s for s in settings.surfaces if s.foot == foot and math.isclose(s.tilt_deg, tilt_deg)]


def _log_normal(error: float, spread: float, sigma: float) -> float:
    variance = spread**2 + sigma**2
    return -0.5 * (error**2 / variance + math.log(2.0 * math.pi * variance))


def _log_box(c3: float, sigma: float, low: float, high: float) -> float:
    """Log density of a value uniform in [low, high] seen with Gaussian noise; floored far outside."""
    scale = sigma * math.sqrt(2.0)
    inside = 0.5 * (math.erf((high - c3) / scale) - math.erf((low - c3) / scale))
    return math.log(max(inside, 1e-300) / (high - low))
