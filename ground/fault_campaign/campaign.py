"""The study of faults: each case a mission with its faults, and what came of all of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flight import settings as flight_settings
from flight.surface.known import load_surfaces
from ground.campaign.crews import Crew, OneProcess
from ground.campaign.engine import StudyResult, run_study
from ground.campaign.study import FAILED, Row
from ground.fault_campaign.drawing import CampaignSettings, draw_case
from ground.fault_campaign.flying import fly_case
from ground.fault_campaign.hazards import HAZARDS
from hal.config import config_path, read_yaml


@dataclass(frozen=True)
class CampaignResult:
    """All cases as rows (see `flying.CaseResult`); `failed` are those that came to no result."""

    rows: tuple[dict[str, Any], ...]
    failed: tuple[dict[str, Any], ...] = ()

    @property
    def faults(self) -> int:
        """Faults that count: those that have made a difference."""
        return sum(len(row["case"]["faults"]) for row in self.rows)

    @property
    def without_effect(self) -> int:
        """Faults that count though no effect of theirs is on record."""
        return self.faults - sum(len(row["effects_s"]) for row in self.rows)

    @property
    def came_to_nothing(self) -> int:
        """Further faults that were planted and made none; they do not count."""
        return sum(row["came_to_nothing"] for row in self.rows)

    @property
    def hazards(self) -> Counter[str]:
        """Cases in which each kind of hazard happened."""
        return Counter({name: sum(name in row["hazards"] for row in self.rows) for name in HAZARDS})

    @property
    def ends(self) -> Counter[str]:
        """How the missions ended."""
        return Counter(row["end_reason"] for row in self.rows)


@dataclass(frozen=True)
class FaultStudy:
    """Faults in whole missions; wanted are faults that made a difference."""

    campaign: CampaignSettings
    seed: int
    name: str = "faults"

    def settings(self) -> object:
        """The campaign's, the flight software's, the surfaces and the simulated board."""
        board = read_yaml(config_path("boards", "sim.yaml"))
        return self.campaign, flight_settings.load(), load_surfaces(), board

    def schema(self) -> Any:
        """The columns of `flying.CaseResult`."""
        import pyarrow as pa

        text, real = pa.string(), pa.float64()
        planted = {"device": text, "kind": text, "from_s": real, "until_s": real, "size": real}
        case = {"index": pa.int64(), "seed": pa.int64(), "surface": text, "energy_j": real, "nut_m": real}
        drawn = pa.struct({**case, "loaded": pa.bool_(), "faults": pa.list_(pa.struct(planted))})
        columns = {
            "case": drawn,
            "effects_s": pa.list_(real),
            "came_to_nothing": pa.int64(),
            "end_reason": text,
        }
        more = {"releases": pa.int64(), "hazards": pa.list_(text), "simulated_s": real}
        return pa.schema({**columns, **more})

    def run(self, index: int) -> Row:
        """Fly the case of an index."""
        return fly_case(self.campaign, draw_case(self.campaign, index, self.seed)).as_row()

    def counts(self, row: Row) -> float:
        """Its faults that made a difference."""
        return 0.0 if row[FAILED] is not None else float(len(row["case"]["faults"]))

    def most_cases(self, wanted: float) -> int | None:
        """Nobody knows before which faults will make a difference."""
        return None

    def suspicious(self, row: Row) -> bool:
        """Whether it was dangerous."""
        return bool(row["hazards"])


def run_campaign(
    study: FaultStudy,
    wanted: int,
    folder: Path,
    show: Callable[[str, float], None],
    workers: Crew | None = None,
) -> tuple[CampaignResult, StudyResult]:
    """Fly cases until `wanted` faults have made a difference; `show` is told a text and how many there are by now.

    Cases already in `folder` count. Raises `ConfigError` when those are of another seed, other settings or code.
    """
    ran = run_study(study, float(wanted), folder, workers or OneProcess(), show)
    return CampaignResult(ran.rows, ran.failed), ran
