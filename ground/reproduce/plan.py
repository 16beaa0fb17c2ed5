"""The campaign's plan (`config/paper/campaign.yaml`): set-ups, each a reference jump and the tests after it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from ground.reproduce.paper import NotNegative, Paper, Positive, Share
from hal.config import Limits, config_path, load_settings
from hal.errors import ConfigError


@dataclass(frozen=True)
class SoilTest:
    """One test on soil: E_spr, and the place, which is prepared before its first hop."""

    surface: str
    energy_j: Positive
    place: str
    tilt_deg: Annotated[float, Limits(0.0, 45.0)] = 0.0


@dataclass(frozen=True)
class SetupPlan:
    """One mounting of the rig: its foot, what its mechanism loses, a reference jump (E_spr), then the tests."""

    name: str
    foot: str
    c2_ref: Share
    reference_energy_j: Positive
    tests: tuple[SoilTest, ...] = ()


@dataclass(frozen=True)
class AnalysisModel:
    """The minimal damping of the numerical model that C1 is taken from."""

    damping_n_s_m: NotNegative
    contact_lost_share: Share


@dataclass(frozen=True)
class CampaignPlan:
    """All set-ups, and what they share."""

    probe_energy_j: Positive
    repeatability: NotNegative
    least_damping_n_s_m: Positive
    flight_timeout_s: Positive
    analysis: AnalysisModel
    setups: tuple[SetupPlan, ...]

    def row(self, key: tuple[str, str, float]) -> Iterator[tuple[SetupPlan, SoilTest]]:
        """All tests of one row of Table 5 (surface, foot, tilt), in order."""
        for setup in self.setups:
            for test in setup.tests:
                if (test.surface, setup.foot, test.tilt_deg) == key:
                    yield setup, test


def load_campaign(paper: Paper, path: Path | None = None) -> CampaignPlan:
    """Read and check the plan. Raises `ConfigError` naming file, key, value and limit."""
    where = path or config_path("paper", "campaign.yaml")
    plan = load_settings(where, CampaignPlan)
    names = [setup.name for setup in plan.setups]
    for index, setup in enumerate(plan.setups):
        key = f"{where}: setups[{index}]"
        if names.index(setup.name) != index:
            raise ConfigError(f"{key}.name = {setup.name!r} stands twice")
        if setup.foot not in paper.feet:
            raise ConfigError(f"{key}.foot = {setup.foot!r} is unknown; feet: {', '.join(paper.feet)}")
        for number, test in enumerate(setup.tests):
            if paper.row(test.surface, setup.foot, test.tilt_deg) is None:
                raise ConfigError(
                    f"{key}.tests[{number}]: nothing is published for {test.surface!r} with foot {setup.foot!r} "
                    f"at {test.tilt_deg:g} deg"
                )
    return plan
