"""Soils under the foot: how strong and how lossy, by surface, foot, tilt, earlier hops, and by chance.

One latent number makes a place looser or denser: a looser place is softer and keeps more of the energy. The laws
are the plainest ones that the published dissipation can tell apart; `config/surfaces.yaml` holds their numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from hal.config import Limits, build_settings, config_path, read_yaml
from hal.errors import ConfigError

Positive = Annotated[float, Limits(1e-12, 1e12)]
NotNegative = Annotated[float, Limits(0.0, 100.0)]

MOST_LOST = 0.99
"""Share of the contact energy that soil keeps at most."""


@dataclass(frozen=True)
class Pad:
    """A foot as the soil meets it: contact area, and whether it is flat or a half cylinder."""

    area_m2: Positive
    flat: bool


@dataclass(frozen=True)
class FootLaw:
    """A larger foot presses less and stands stiffer.

    chi = chi_1 * (flat_factor if flat) * (A/A_1)^-exponent: what is pressed in for good grows with a power of the
    pressure F/A, as in Bekker's pressure-sinkage law (Introduction to Terrain-Vehicle Systems, 1969); the force is
    the springs' own, whatever the foot. k_l = k_1 * (A/A_1)^stiffness_exponent: 1/2 for a plate on an elastic half
    space (Timoshenko and Goodier, Theory of Elasticity, art. 139), less where the soil gives way at its edge.
    """

    reference_area_m2: Positive
    exponent: Annotated[float, Limits(0.0, 3.0)]
    stiffness_exponent: Annotated[float, Limits(-1.0, 2.0)]
    flat_factor: Annotated[float, Limits(0.1, 3.0)]


@dataclass(frozen=True)
class TiltLaw:
    """k_l falls with the tilt: k_l (1 - tilt/friction_angle)^2.

    Meyerhof's factor for inclined loads on soil without cohesion (Proc. 3rd ICSMFE, 1953, vol. 1, 440).
    """

    friction_angle_deg: Annotated[float, Limits(25.0, 90.0)]


@dataclass(frozen=True)
class Soil:
    """One soil under the reference foot, level.

    `stiffness_n_m`, `lost_share`: k_l and chi of a middling fresh place. `spot_std`, `hop_std`: standard deviation
    of ln(chi/(1 - chi)) from place to place, and from hop to hop in one place. `stiffness_spot_std`: of ln k_l
    from place to place, softer where lossier. `kept_by_hop`: chi after a hop as a share of chi before it
    (compaction).
    """

    stiffness_n_m: Positive
    lost_share: Annotated[float, Limits(0.0, MOST_LOST)]
    spot_std: NotNegative
    hop_std: NotNegative
    stiffness_spot_std: NotNegative
    kept_by_hop: Annotated[float, Limits(0.1, 1.0)]


@dataclass(frozen=True)
class Soils:
    """All simulated soils and what they share; `feet` by name, those without a pad only stand on rigid ground."""

    feet: dict[str, Pad]
    foot_law: FootLaw
    tilt_law: TiltLaw
    soils: dict[str, Soil]


@dataclass(frozen=True)
class Ground:
    """The ground of one hop: loading stiffness and share of the contact energy that it keeps."""

    stiffness_n_m: float
    lost_share: float

    def values(self, surface: str) -> dict[str, float]:
        """As values of a hop plant's surface, by flat name."""
        return {f"{surface}.k_l": self.stiffness_n_m, f"{surface}.chi": self.lost_share}


def load_soils(path: Path | None = None) -> Soils:
    """Read the part `simulated` of `config/surfaces.yaml`. Raises `ConfigError` naming file, key, value, limit."""
    where = path or config_path("surfaces.yaml")
    data = read_yaml(where)
    if not isinstance(data, dict) or "simulated" not in data:
        raise ConfigError(f"{where}: key simulated is missing")
    return build_settings(data["simulated"], Soils, str(where), "simulated.")


def ground_of(
    soils: Soils,
    surface: str,
    foot: str,
    tilt_deg: float = 0.0,
    *,
    earlier_hops: int = 0,
    looseness: float = 0.0,
    hop_change: float = 0.0,
) -> Ground:
    """The ground that a hop meets.

    `earlier_hops`: made in this place since it was prepared. `looseness`, `hop_change`: standard normal draws of the
    place and of the hop; 0 gives the middling one. Raises `ConfigError` for a soil or foot that is not in the file,
    and for a tilt at which the ground does not bear.
    """
    if surface not in soils.soils:
        raise ConfigError(f"surface {surface!r} is not a simulated soil; known: {', '.join(soils.soils)}")
    if foot not in soils.feet:
        raise ConfigError(
            f"foot {foot!r} has no pad to stand on soil; those with one: {', '.join(soils.feet)}"
        )
    soil, pad, law = soils.soils[surface], soils.feet[foot], soils.foot_law
    bearing = 1.0 - abs(tilt_deg) / soils.tilt_law.friction_angle_deg
    if bearing <= 0.0:
        raise ConfigError(
            f"tilt_deg = {tilt_deg:g}: soil does not bear at or beyond its friction angle "
            f"({soils.tilt_law.friction_angle_deg:g} deg)"
        )
    size, shape = pad.area_m2 / law.reference_area_m2, law.flat_factor if pad.flat else 1.0
    stiffness_n_m = soil.stiffness_n_m * size**law.stiffness_exponent * bearing**2
    stiffness_n_m *= math.exp(-soil.stiffness_spot_std * looseness)
    pressed = shape * size**-law.exponent
    lost = soil.lost_share * pressed * soil.kept_by_hop**earlier_hops
    return Ground(stiffness_n_m, _moved(lost, soil.spot_std * looseness + soil.hop_std * hop_change))


def _moved(share: float, by: float) -> float:
    """A share moved along ln(share/(1 - share)), which keeps it between 0 and 1."""
    share = min(share, MOST_LOST)
    if share <= 0.0:
        return 0.0
    return min(1.0 / (1.0 + math.exp(-math.log(share / (1.0 - share)) - by)), MOST_LOST)
