"""The surfaces that are known: published dissipation by surface, foot and tilt (`config/surfaces.yaml`)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from hal.config import Limits, config_path, load_settings
from hal.errors import ConfigError

UNKNOWN = "none_of_the_known"
C3 = Annotated[float, Limits(-0.5, 1.0)]
Stiffness = Annotated[float, Limits(1e2, 1e10)]

# Mean range of n normal values in standard deviations, d2 of the control charts (ISO 7870-2, annex).
_RANGE_IN_SIGMAS = (1.128, 1.693, 2.059, 2.326, 2.534, 2.704, 2.847, 2.970, 3.078)


@dataclass(frozen=True)
class KnownSurface:
    """Dissipation of one surface with one foot and tilt, from `runs` values.

    For soil that compacts, whose published values were taken hop after hop, `fresh_c3_mean` and `_std` say how fresh
    places of it are, and `fall` which share of C3 is gone at the fourth hop. `stiffness_n_m` is that of the ground
    under the foot while it is pressed in.
    """

    name: str
    foot: str
    tilt_deg: float
    c3_mean: C3
    c3_low: C3
    c3_high: C3
    runs: Annotated[int, Limits(2, 10_000)] = 4
    fresh_c3_mean: Annotated[float | None, Limits(-0.5, 0.999)] = None
    fresh_c3_std: Annotated[float | None, Limits(1e-6, 1.0)] = None
    fall: Annotated[float | None, Limits(0.0, 1.0)] = None
    stiffness_n_m: Annotated[float | None, Limits(1e2, 1e10)] = None

    @property
    def place_c3_mean(self) -> float:
        """Mean C3 of fresh places."""
        return self.c3_mean if self.fresh_c3_mean is None else self.fresh_c3_mean

    @property
    def place_c3_std(self) -> float:
        """Standard deviation of C3 from fresh place to fresh place; from the range unless given."""
        if self.fresh_c3_std is not None:
            return self.fresh_c3_std
        sigmas = _RANGE_IN_SIGMAS[min(self.runs, len(_RANGE_IN_SIGMAS) + 1) - 2]
        return (self.c3_high - self.c3_low) / sigmas


@dataclass(frozen=True)
class SurfaceSettings:
    """The known surfaces, and what is expected of ground that is none of them."""

    surfaces: tuple[KnownSurface, ...]
    unknown_probability: Annotated[float, Limits(1e-6, 1.0)]
    unknown_c3_low: C3
    unknown_c3_high: C3
    unknown_stiffness_low_n_m: Stiffness
    unknown_stiffness_high_n_m: Stiffness
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
        if not surface.c3_low <= surface.c3_mean <= surface.c3_high or surface.place_c3_std <= 0.0:
            raise ConfigError(
                f"{where}: surfaces[{index}]: c3_mean = {surface.c3_mean:g} must lie within "
                f"[c3_low, c3_high] = [{surface.c3_low:g}, {surface.c3_high:g}], which must not be empty"
            )
        if surface.place_c3_mean >= 1.0:
            raise ConfigError(f"{where}: surfaces[{index}]: C3 = {surface.place_c3_mean:g} must be below 1")
    if settings.unknown_c3_low >= settings.unknown_c3_high or settings.unknown_c3_high >= 1.0:
        raise ConfigError(f"{where}: unknown_c3_low must be below unknown_c3_high, and that below 1")
    if settings.unknown_stiffness_low_n_m >= settings.unknown_stiffness_high_n_m:
        raise ConfigError(f"{where}: unknown_stiffness_low_n_m must be below unknown_stiffness_high_n_m")


def same_setting(surface: KnownSurface, foot: str, tilt_deg: float) -> bool:
    """Whether a row was measured with this foot and tilt."""
    return surface.foot == foot and math.isclose(surface.tilt_deg, tilt_deg, abs_tol=0.5)
