"""Continuous operation for hours of simulated time: hop after hop, faults sprinkled in, the log in files that rotate.

    python -m benchmarks.long_run [--hours H] [--energy-j E] [--seed S] [--json FILE]

One process all the time; a mission of 20 hops ends early when a fault sends it to SAFE, and the next one begins,
as after a reset by the ground. `growth_kb_per_hour`: slope of the resident memory over simulated time, the first
quarter left out, the simulated robot and all ground code included; `growth_sigma_kb_per_hour` from the slopes between
parts of the time. `log_bytes_most`: the most that all files of a log took, beside its limit.
`*_mean_error_sigmas_*`: mean error of the valid hops' estimates in their own sigmas, of the first and of the last
third of the time; its standard error is 1/√hops. `*_rms_sigmas`: 1 where the stated sigmas are true. `wrong`:
estimates off by more than 5 sigmas.
"""

from __future__ import annotations

import argparse
import gc
import resource
import tempfile
from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.figures import write_figures
from benchmarks.growth import growth_per_hour
from flight import settings as flight_settings
from flight.executive import fly
from flight.log import McapLog, parts_of
from flight.mission import HopPlan, HopReport, MissionPlan
from flight.settings import FlightSettings
from ground.campaign.drawing import generator
from ground.fault_campaign.drawing import draw_case, load_campaign
from hal.board import open_board
from hal.config import config_path, read_yaml
from hal.tap import tap_board
from sim_hal.board import world_of
from sim_hal.truth import HopTruth

SURFACE, WRONG_SIGMAS = "quartz_sand", 5.0
FAULTY_SHARE = 0.3
"""Of missions that have faults planted, drawn as the fault campaign draws them; the others fly on undisturbed."""


@dataclass(frozen=True)
class Operation:
    """What is flown. `log_bytes` is the limit of a mission's log: low enough that it rotates in every mission.

    Memory and log are looked at every `sampled_every_s` of simulated time.
    """

    hours: float
    energy_j: float = 2.0
    seed: int = 1
    hops_of_a_mission: int = 20
    log_bytes: int = 2_000_000
    sampled_every_s: float = 10.0


@dataclass
class Seen:
    """What was seen in all the time; times are simulated seconds since the start."""

    memory: list[tuple[float, float]] = field(default_factory=list)
    errors: list[tuple[float, str, float]] = field(default_factory=list)
    ends: Counter[str] = field(default_factory=Counter)
    log_most: int = 0
    hops: int = 0
    missions: int = 0
    faults: int = 0


def operate(operation: Operation) -> Seen:
    """Fly missions one after the other until the time is over."""
    settings = flight_settings.load()
    limits = replace(settings.log, total_bytes=operation.log_bytes, file_bytes=operation.log_bytes // 8)
    seen, now_s = Seen(), 0.0
    while now_s < 3600.0 * operation.hours:
        now_s += _mission(seen, now_s, operation, replace(settings, log=limits))
        memory_mb = seen.memory[-1][1] / 1024.0
        print(
            f"  {now_s / 60:.0f} min, {seen.hops} hops in {seen.missions} missions, {memory_mb:.1f} MB",
            flush=True,
        )
    return seen


def _mission(seen: Seen, since_s: float, operation: Operation, settings: FlightSettings) -> float:
    """One mission; returns how long it took [s]."""
    rng = generator(operation.seed, seen.missions)
    found = _board_settings(seen, rng, operation.seed)
    plan = MissionPlan("long", (HopPlan(operation.energy_j, SURFACE),) * operation.hops_of_a_mission)
    with tempfile.TemporaryDirectory() as made, open_board("sim", found) as board:
        path = Path(made) / "flight.mcap"

        def watch(progress: Any) -> None:
            now_s = since_s + progress.time_s
            if not seen.memory or now_s - seen.memory[-1][0] >= operation.sampled_every_s:
                seen.memory.append((now_s, _resident_kb()))
                seen.log_most = max(seen.log_most, _taken_bytes(path))

        with McapLog(path, {}, settings.log) as log:
            result = fly(tap_board(board, log), settings, plan, log, watch)
        seen.log_most = max(seen.log_most, _taken_bytes(path))
        truths = {truth.fire_s: truth for truth in world_of(board).hops}
        ended_s = board.clock.now_s()
    for report in result.hops:
        truth = next((t for fire_s, t in truths.items() if abs(fire_s - report.fire_s) < 1e-6), None)
        if truth is not None and report.verdict == "valid":
            seen.errors += [(since_s + report.fire_s, *each) for each in _errors(report, truth)]
    seen.hops, seen.missions = seen.hops + len(result.hops), seen.missions + 1
    seen.ends[result.end_reason] += 1
    gc.collect()  # as flight does after each hop: what the simulated robot leaves in cycles is not its memory
    return ended_s


def _board_settings(seen: Seen, rng: np.random.Generator, seed: int) -> dict[str, Any]:
    found = read_yaml(config_path("boards", "sim.yaml"))
    faults: list[dict[str, Any]] = []
    if rng.random() < FAULTY_SHARE:
        case, from_s = draw_case(load_campaign(), seen.missions, seed), float(rng.uniform(0.0, 300.0))
        faults = [
            {
                **vars(fault),
                "from_s": from_s + fault.from_s,
                "until_s": fault.until_s and from_s + fault.until_s,
            }
            for fault in case.faults
            if fault.device not in ("log", "ground_link")
        ]
    seen.faults += len(faults)
    spots = [{"surface": SURFACE, "foot": 1, "tilt_deg": 0.0}]
    return {**found, "seed": int(rng.integers(2**31)), "spots": spots, "faults": faults}


def _errors(report: HopReport, truth: HopTruth) -> list[tuple[str, float]]:
    """Errors of height and time of flight in their own sigmas."""
    energies = report.energies
    pairs = (
        ("height", energies.height_m, truth.hop_height_m),
        ("time_of_flight", energies.time_of_flight_s, truth.time_of_flight_s),
    )
    return [
        (name, (estimate.value - true) / estimate.sigma)
        for name, estimate, true in pairs
        if estimate is not None and true is not None
    ]


def _taken_bytes(log: Path) -> int:
    return sum(part.stat().st_size for part in parts_of(log))


def _resident_kb() -> float:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 1024.0


def figures(seen: Seen, operation: Operation) -> dict[str, tuple[float, str]]:
    """Value and unit by name."""
    times, memory = np.array(seen.memory).T
    late = times > 0.25 * times[-1]
    growth, sigma = growth_per_hour(times[late], memory[late])
    found: dict[str, tuple[float, str]] = {
        "hours": (float(times[-1]) / 3600.0, "h"),
        "hops": (seen.hops, "1"),
        "missions": (seen.missions, "1"),
        "faults_planted": (seen.faults, "1"),
        "growth_kb_per_hour": (growth, "kB/h"),
        "growth_sigma_kb_per_hour": (sigma, "kB/h"),
        "memory_first_mb": (float(memory[late][0]) / 1024.0, "MB"),
        "memory_last_mb": (float(memory[-1]) / 1024.0, "MB"),
        "log_bytes_most": (seen.log_most, "B"),
        "log_bytes_limit": (operation.log_bytes, "B"),
        "wrong": (sum(abs(error) > WRONG_SIGMAS for _, _, error in seen.errors), "1"),
    }
    for name in ("height", "time_of_flight"):
        found |= _bias(name, [(t / times[-1], error) for t, n, error in seen.errors if n == name])
    return found


def _bias(name: str, errors: list[tuple[float, float]]) -> dict[str, tuple[float, str]]:
    """Mean error in sigmas at the start and at the end, and its spread; `errors` have their share of the time."""
    found: dict[str, tuple[float, str]] = {}
    for part, low, high in (("first", 0.0, 1 / 3), ("last", 2 / 3, 1.0)):
        inside = [error for share, error in errors if low <= share <= high]
        if inside:
            found[f"{name}_mean_error_sigmas_{part}"] = (float(np.mean(inside)), "1")
            found[f"{name}_hops_{part}"] = (len(inside), "1")
    if errors:
        found[f"{name}_rms_sigmas"] = (float(np.sqrt(np.mean([error**2 for _, error in errors]))), "1")
    return found


def main() -> None:
    """Operate, print, and write the figures where asked."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--hours", type=float, default=1.0, help="simulated time")
    parser.add_argument("--energy-j", type=float, default=2.0, help="of each hop")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path, help="write the figures here")
    given = parser.parse_args()
    operation = Operation(given.hours, given.energy_j, given.seed)
    seen = operate(operation)
    found = figures(seen, operation)
    for name, (value, unit) in found.items():
        print(f"{name:40s} {value:10.4g} {unit}")
    print("ends: " + ", ".join(f"{reason} {number}" for reason, number in seen.ends.most_common()))
    if given.json:
        write_figures(given.json, found)


if __name__ == "__main__":
    main()
