"""`hopper reproduce`: the published campaign flown again, or a laboratory's table through the same chain."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from flight import settings as flight_settings
from flight.settings import FlightSettings
from ground.files import write_atomic
from ground.reproduce.chain import CampaignRun, through_chain
from ground.reproduce.disagreements import disagreements
from ground.reproduce.fly import Mission, campaign_runs, drawn_missions, fly_campaign
from ground.reproduce.mechanism import Mechanisms
from ground.reproduce.moon import moon_rows
from ground.reproduce.outcome import Reproduction, reproduce
from ground.reproduce.page import HEADERS, table_row, verdict, write_page
from ground.reproduce.paper import Paper, load_paper
from ground.reproduce.plan import CampaignPlan, load_campaign
from ground.reproduce.table import TableMap, load_map, read_campaign_table
from hal.config import config_path
from hal.errors import ConfigError
from sim_hal.soils import Soils, load_soils

FORMAT = 1
PAGE_NAME, JSON_NAME, TABLE_NAME = "report.html", "reproduction.json", "runs.csv"
CONSOLE_HEADERS = (HEADERS[0], HEADERS[1], HEADERS[3], "our range", HEADERS[7])

Show = Callable[..., None]


@dataclass(frozen=True)
class Campaign:
    """What a reproduction needs: the published numbers, the plan, the soils and the flight code's settings."""

    paper: Paper
    plan: CampaignPlan
    soils: Soils
    settings: FlightSettings

    @property
    def hops(self) -> int:
        """Number of hops to be flown, probes included."""
        return sum(len(mission.hops) for mission in self.missions(0))

    def missions(self, seed: int) -> list[Mission]:
        """All set-ups drawn from a seed."""
        return drawn_missions(self.plan, self.soils, self.settings, seed)


def configured_campaign(plan_path: Path | None = None) -> Campaign:
    """The campaign of the configuration; `plan_path` names another plan. Raises `ConfigError`."""
    paper = load_paper()
    settings = flight_settings.load(config_path("flight.yaml"))
    return Campaign(paper, load_campaign(paper, plan_path), load_soils(), settings)


def reproduce_by_flight(campaign: Campaign, seed: int, show: Show, processes: int = 1) -> Reproduction:
    """Fly the whole campaign and compare. The same seed gives the same numbers, on any number of processes."""
    flown = fly_campaign(campaign.missions(seed), campaign.settings, show, processes)
    return compared(campaign, *campaign_runs(flown, campaign.settings))


def flown_words(campaign: Campaign, seed: int) -> str:
    """How the campaign was flown."""
    runs = sum(1 + len(setup.tests) for setup in campaign.plan.setups)
    return (
        f"{runs} runs in {len(campaign.plan.setups)} set-ups, and {campaign.hops - runs} probing hops of "
        f"{campaign.plan.probe_energy_j:g} J, flown by the flight code on the simulated rig (arm geometry), seed "
        f"{seed}. Soils: config/surfaces.yaml; plan: config/paper/campaign.yaml. Which test followed which "
        "reference, and at which energy, is worked out from the published tables, not published there; the loss of "
        "each set-up's mechanism is set to match. C3 and heights are what the flight code estimates from its "
        "sensors.\n\n± σ is the measurement's uncertainty of our mean, errors common to all runs included; the range "
        "is that of the runs."
    )


def reproduce_by_table(campaign: Campaign, table: Path, mapping: Path) -> Reproduction:
    """Put a laboratory's table through the energy chain and compare. Raises `ConfigError` naming row and column."""
    table_map: TableMap = load_map(mapping)
    return compared(campaign, read_campaign_table(table, table_map, mapping, campaign.settings.rig))


def compared(campaign: Campaign, runs: Sequence[CampaignRun], rejected: Sequence[str] = ()) -> Reproduction:
    """The runs through the energy chain, and every published number that they bear on beside theirs.

    Raises `ConfigError` when no run is left.
    """
    if not runs:
        raise ConfigError(f"no run to compare; rejected: {'; '.join(rejected) or 'none'}")
    rig = campaign.settings.rig
    chain = through_chain(runs, rig)
    mechanisms = Mechanisms(rig, campaign.plan.least_damping_n_s_m)
    made = reproduce(chain, campaign.paper, campaign.plan.analysis, mechanisms)
    moon = tuple(moon_rows(chain, campaign.paper))
    return replace(made, found=(*made.found, *moon), rejected=tuple(rejected))


def content(campaign: Campaign, made: Reproduction, seed: int | None) -> dict[str, Any]:
    """All numbers, published and ours, as JSON-able data."""
    figures = {found.name: {k: v for k, v in asdict(found).items() if k != "name"} for found in made.found}
    return {
        "format": FORMAT,
        "paper": campaign.paper.citation,
        "seed": seed,
        "verdict": verdict(made),
        "rejected": list(made.rejected),
        "figures": figures,
        "runs": [run_row(made, index) for index in range(len(made.chain.runs))],
        "disagreements": [asdict(each) for each in disagreements(campaign.paper, campaign.settings.rig)],
    }


def run_row(made: Reproduction, index: int) -> dict[str, Any]:
    """One run as plain data, SI units."""
    each = made.chain.runs[index]
    run = each.run
    row: dict[str, Any] = {
        "run": run.label,
        "setup": run.setup,
        "surface": run.surface,
        "foot": run.foot,
        "tilt_deg": run.tilt_deg,
        "place": run.place,
        "reference": run.reference,
        "compression_m": run.compression_m.value,
        "compression_sigma_m": run.compression_m.sigma,
        "height_m": run.height_m.value,
        "height_sigma_m": run.height_m.sigma,
        "energy_used_j": each.used_j.value,
        "c1_analysis": made.c1_analysis[index],
        "c1_loss_free": each.c1.value,
    }
    for name in ("c2_reference", "c2_direct", "c3_direct", "c3_average"):
        value = getattr(each, name)
        row[name] = None if value is None else value.value
        row[f"{name}_sigma"] = None if value is None else value.sigma
    return row | {"true_c3": run.true_c3, "true_height_m": run.true_height_m}


def write_results(campaign: Campaign, made: Reproduction, folder: Path, seed: int | None, how: str) -> Path:
    """Write page, numbers and table of runs to a folder. Returns the page."""
    numbers = json.dumps(content(campaign, made, seed), indent=1, ensure_ascii=False, allow_nan=False)
    write_atomic(folder / JSON_NAME, numbers + "\n")
    write_atomic(folder / TABLE_NAME, _csv([run_row(made, index) for index in range(len(made.chain.runs))]))
    rig, paper = campaign.settings.rig, campaign.paper
    title = "The published campaign, flown again" if seed is not None else "A campaign's table"
    return write_page(made, paper, rig, campaign.soils, how, folder / PAGE_NAME, title)


def _csv(rows: Sequence[dict[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def console_rows(made: Reproduction) -> list[tuple[str, ...]]:
    """The numbers under `CONSOLE_HEADERS`."""
    rows = (table_row(found) for found in made.found)
    return [(row[0], row[1], row[3], row[4], row[7]) for row in rows]
