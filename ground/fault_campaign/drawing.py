"""What is drawn: a mission, and the faults that are planted in it. One index and seed, one case."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from hal.config import Limits, config_path, load_settings
from hal.errors import ConfigError

Share = Annotated[float, Limits(0.0, 1.0)]
FOR_GOOD_S = 10.0


@dataclass(frozen=True)
class MissionDraw:
    """Ranges of the missions."""

    surfaces: tuple[str, ...]
    energies_j: tuple[float, ...]
    strong_share: Share
    strong_j: tuple[float, ...]
    found_loaded_share: Share
    found_nut_m: tuple[float, ...]
    start_nut_m: tuple[float, ...]


@dataclass(frozen=True)
class HazardLimits:
    """What the plant's truth is held to."""

    string_force_n: float
    stop_margin_m: float
    energy_share: Share
    c3_sigmas: float
    c3_least: float
    after_s: float


@dataclass(frozen=True)
class CampaignSettings:
    """The whole file; `kinds` are rows of device, kind, smallest and largest size."""

    mission: MissionDraw
    patience_s: float
    faults_at_once: Annotated[int, Limits(1, 10)]
    apart_s: float
    groups: Annotated[int, Limits(1, 10)]
    groups_apart_s: tuple[float, ...]
    length_s: tuple[float, ...]
    horizon_s: float
    kinds: tuple[Any, ...]
    limits: HazardLimits


@dataclass(frozen=True)
class PlantedFault:
    """One fault of one case."""

    device: str
    kind: str
    from_s: float
    until_s: float | None
    size: float


@dataclass(frozen=True)
class FaultCase:
    """One mission with its faults."""

    index: int
    seed: int
    surface: str
    energy_j: float
    nut_m: float
    loaded: bool
    faults: tuple[PlantedFault, ...]


def load_campaign(path: Path | None = None) -> CampaignSettings:
    """Read the file of a campaign. Raises `ConfigError` naming file, key and value."""
    where = path or config_path("campaigns", "faults.yaml")
    settings = load_settings(where, CampaignSettings)
    for row, kind in enumerate(settings.kinds):
        if not (
            isinstance(kind, list) and len(kind) == 4 and all(isinstance(text, str) for text in kind[:2])
        ):
            raise ConfigError(f"{where}: kinds[{row}] = {kind!r} must be [device, kind, smallest, largest]")
    return settings


def draw_case(settings: CampaignSettings, index: int, seed: int) -> FaultCase:
    """The case of an index; the same one each time."""
    rng = np.random.default_rng([seed, index])
    mission = settings.mission
    loaded = bool(rng.random() < mission.found_loaded_share)
    span_j = mission.strong_j if rng.random() < mission.strong_share else mission.energies_j
    return FaultCase(
        index=index,
        seed=int(rng.integers(2**31)),
        surface=str(rng.choice(mission.surfaces)),
        energy_j=_log_uniform(rng, *span_j),
        nut_m=_uniform(rng, *(mission.found_nut_m if loaded else mission.start_nut_m)),
        loaded=loaded,
        faults=_faults(settings, rng),
    )


def _faults(settings: CampaignSettings, rng: np.random.Generator) -> tuple[PlantedFault, ...]:
    """Faults of different devices in up to so many groups, within which the onsets lie close together."""
    faults: list[PlantedFault] = []
    rows = [settings.kinds[int(row)] for row in rng.permutation(len(settings.kinds))]
    first_s = float(rng.uniform(0.0, settings.horizon_s))
    for _ in range(int(rng.integers(1, settings.groups + 1))):
        for _ in range(int(rng.integers(1, settings.faults_at_once + 1))):
            taken = {fault.device for fault in faults}
            row = next((row for row in rows if row[0] not in taken), None)
            if row is not None:
                faults.append(_fault(settings, rng, row, first_s))
        first_s += _uniform(rng, *settings.groups_apart_s)
    return tuple(faults)


def _fault(
    settings: CampaignSettings, rng: np.random.Generator, row: list[Any], first_s: float
) -> PlantedFault:
    device, kind, low, high = row
    from_s = first_s + float(rng.uniform(0.0, settings.apart_s))
    length_s = _log_uniform(rng, *settings.length_s)
    until_s = None if length_s > FOR_GOOD_S else from_s + length_s
    return PlantedFault(device, kind, from_s, until_s, float(rng.uniform(low, high)))


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def _uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(rng.uniform(low, high))
