"""Runs a campaign on all cores. Each case is kept in a file as it ends, so that an interrupted campaign goes on."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from dataclasses import dataclass
from itertools import count, islice
from pathlib import Path
from typing import Any

from flight import settings as flight_settings
from flight.surface.known import load_surfaces
from ground.fault_campaign.drawing import CampaignSettings, draw_case
from ground.fault_campaign.flying import fly_case
from ground.fault_campaign.hazards import HAZARDS
from ground.pools import end_with_parent
from hal.config import config_path, read_yaml
from hal.errors import ConfigError

CASES_NAME = "cases.jsonl"


@dataclass(frozen=True)
class CampaignResult:
    """All cases as rows (see `flying.CaseResult`)."""

    rows: tuple[dict[str, Any], ...]

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


def run_campaign(
    settings: CampaignSettings,
    wanted: int,
    seed: int,
    folder: Path,
    processes: int,
    show: Callable[[str, float], None],
) -> CampaignResult:
    """Fly cases until `wanted` faults have made a difference; `show` is told a text and how many there are by now.

    Cases already in `folder` count. Raises `ConfigError` when those are of another seed or of other settings.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / CASES_NAME
    stamp = _stamp(settings, seed)
    rows = _kept(path, stamp)
    planted = sum(len(row["case"]["faults"]) for row in rows)
    done = {row["case"]["index"] for row in rows}
    with path.open("a", encoding="utf-8") as file:
        for row in _flown(settings, seed, done, processes) if planted < wanted else ():
            rows.append(row)
            file.write(json.dumps({**stamp, **row}) + "\n")
            file.flush()
            planted += len(row["case"]["faults"])
            hazards = sum(bool(each["hazards"]) for each in rows)
            show(
                f"{planted} of {wanted} faults in {len(rows)} missions, {hazards} with hazards",
                float(planted),
            )
            if planted >= wanted:
                break
    return CampaignResult(tuple(rows))


def _stamp(settings: CampaignSettings, seed: int) -> dict[str, Any]:
    """What all cases of one campaign share: seed, and a digest of all that they were drawn and flown with."""
    given = (settings, flight_settings.load(), load_surfaces(), read_yaml(config_path("boards", "sim.yaml")))
    return {"seed": seed, "settings": hashlib.sha256(repr(given).encode()).hexdigest()[:16]}


def _kept(path: Path, stamp: dict[str, Any]) -> list[dict[str, Any]]:
    if not path.exists():
        return []
    rows: list[dict[str, Any]] = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        try:
            row = json.loads(line)
        except ValueError:
            path.write_text("".join(json.dumps({**stamp, **kept}) + "\n" for kept in rows), encoding="utf-8")
            break  # the last line of a campaign that was cut
        for key, value in stamp.items():
            if row.pop(key, None) != value:
                raise ConfigError(f"{path}:{number}: is of other {key} than {value}; choose another folder")
        rows.append(row)
    return rows


def _flown(settings: CampaignSettings, seed: int, done: set[int], processes: int) -> Iterator[dict[str, Any]]:
    jobs = ((settings, seed, index) for index in count(0) if index not in done)
    if processes == 1:
        yield from map(_fly, jobs)
        return
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, spawn, end_with_parent) as pool:
        waiting = {pool.submit(_fly, job) for job in islice(jobs, 4 * processes)}
        try:
            while True:
                ended, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                waiting |= {pool.submit(_fly, job) for job in islice(jobs, len(ended))}
                yield from (future.result() for future in ended)
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _fly(job: tuple[CampaignSettings, int, int]) -> dict[str, Any]:
    settings, seed, index = job
    return fly_case(settings, draw_case(settings, index, seed)).as_row()
