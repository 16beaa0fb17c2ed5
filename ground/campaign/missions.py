"""The study of missions: rigs as built on ground as it comes, flown by the flight software, held to the truth."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from flight import settings as flight_settings
from flight.executive import fly
from flight.mission import HopReport
from flight.surface.known import load_surfaces
from flight.uncertain import Uncertain
from ground.campaign.drawing import as_built, board_with, generator, hops_on, log_uniform, nominal_hop_plant
from ground.campaign.study import FAILED, Row
from hal.board import open_board
from hal.config import Limits, config_path, load_settings, read_yaml
from hal.log import NullLog
from sim_hal.board import world_of
from sim_hal.soils import ground_of, load_soils
from sim_hal.truth import REFERENCE, HopTruth

QUANTITIES = ("c3", "height_m", "time_of_flight_s")
"""What is held to the truth: the estimate, its sigma and the truth are three columns each."""
FOOT = 1


@dataclass(frozen=True)
class MissionRanges:
    """`config/campaigns/missions.yaml`."""

    surfaces: tuple[str, ...]
    hops: tuple[int, ...]
    energies_j: tuple[float, ...]
    reference_energy_j: float
    within_sigmas: Annotated[float, Limits(0.0, 5.0)]
    wrong_sigmas: float


@dataclass(frozen=True)
class MissionStudy:
    """Whole missions; each counts as one."""

    ranges: MissionRanges
    seed: int
    name: str = "missions"

    def settings(self) -> object:
        """The ranges, the flight software's, the surfaces, the simulated board and the nominal plant."""
        board = read_yaml(config_path("boards", "sim.yaml"))
        return self.ranges, flight_settings.load(), load_surfaces(), board, nominal_hop_plant()

    def schema(self) -> Any:
        """A row is a mission; its hops are a list of structures."""
        import pyarrow as pa

        text, real, whole = pa.string(), pa.float64(), pa.int64()
        triples = {name + end: real for name in QUANTITIES for end in ("", "_sigma", "_true")}
        hop = pa.struct({"hop": whole, "surface": text, "energy_j": real, "verdict": text, **triples})
        flown = {"end_reason": text, "completed": pa.bool_(), "simulated_s": real, "hops": pa.list_(hop)}
        return pa.schema({"board_seed": whole, "surface": text, **flown})

    def run(self, index: int) -> Row:
        """Draw and fly the mission of an index."""
        rng, ranges = generator(self.seed, index), self.ranges
        surface = str(rng.choice(ranges.surfaces))
        energies_j = tuple(
            log_uniform(rng, ranges.energies_j)
            for _ in range(int(rng.integers(ranges.hops[0], ranges.hops[1] + 1)))
        )
        plan = hops_on(f"case-{index}", surface, ranges.reference_energy_j, energies_j)
        rig = as_built(nominal_hop_plant(), ranges.within_sigmas, rng)
        spots = [
            {"surface": REFERENCE, "foot": FOOT, "tilt_deg": 0.0},
            *_spots(surface, len(energies_j), rng),
        ]
        board_seed = int(rng.integers(2**31))
        with tempfile.TemporaryDirectory() as folder:
            found = {**board_with(rig, Path(folder)), "spots": spots, "seed": board_seed}
            with open_board("sim", found) as board:
                result = fly(board, flight_settings.load(), plan, NullLog())
                truths, ended_s = world_of(board).hops, board.clock.now_s()
        hops = [_hop_row(report, truth) for report, truth in zip(result.hops, truths, strict=False)]
        flown = {"end_reason": result.end_reason, "completed": result.completed, "simulated_s": ended_s}
        return {"board_seed": board_seed, "surface": surface, **flown, "hops": hops}

    def counts(self, row: Row) -> float:
        """One."""
        return 1.0

    def most_cases(self, wanted: float) -> int | None:
        """As many as are wanted."""
        return int(wanted)

    def suspicious(self, row: Row) -> bool:
        """Whether the mission was not completed, or a valid hop is far off."""
        wrong = self.ranges.wrong_sigmas
        return not row["completed"] or any(abs(error) > wrong for _, error in errors_sigmas([row]))


def load_missions(seed: int, path: Path | None = None) -> MissionStudy:
    """The study of a seed. Raises `ConfigError` naming file, key and value."""
    return MissionStudy(load_settings(path or config_path("campaigns", "missions.yaml"), MissionRanges), seed)


def errors_sigmas(rows: list[Row]) -> list[tuple[str, float]]:
    """Errors of all quantities of all valid hops in their own standard uncertainties, each with its name."""
    found = []
    for row in rows:
        for hop in row["hops"] if row[FAILED] is None else ():
            for name in QUANTITIES if hop["verdict"] == "valid" else ():
                value, sigma, true = (hop[name + end] for end in ("", "_sigma", "_true"))
                if value is not None and true is not None and sigma:
                    found.append((name, (value - true) / sigma))
    return found


def _spots(surface: str, hops: int, rng: np.random.Generator) -> list[dict[str, Any]]:
    """One place of a surface, as loose as drawn, which hops compact if its soil does so."""
    spot: dict[str, Any] = {"surface": surface, "foot": FOOT, "tilt_deg": 0.0}
    if surface == REFERENCE:
        return [spot] * hops
    soils, looseness = load_soils(), float(np.clip(rng.standard_normal(), -2.0, 2.0))
    draws = [float(np.clip(rng.standard_normal(), -2.0, 2.0)) for _ in range(hops)]
    grounds = [
        ground_of(soils, surface, str(FOOT), earlier_hops=earlier, looseness=looseness, hop_change=draw)
        for earlier, draw in enumerate(draws)
    ]
    return [{**spot, "values": ground.values(surface)} for ground in grounds]


def _hop_row(report: HopReport, truth: HopTruth) -> Row:
    seen = report.energies
    pairs: dict[str, tuple[Uncertain | None, float | None]] = {
        "c3": (report.c3, truth.c3),
        "height_m": (seen.height_m, truth.hop_height_m),
        "time_of_flight_s": (seen.time_of_flight_s, truth.time_of_flight_s),
    }
    row: Row = {"hop": report.hop_index, "surface": report.plan.surface, "energy_j": report.plan.energy_j}
    row["verdict"] = report.verdict
    for name, (estimate, true) in pairs.items():
        row[name] = None if estimate is None else estimate.value
        row[f"{name}_sigma"] = None if estimate is None else estimate.sigma
        row[f"{name}_true"] = true
    return row
