"""How well a jump's time of flight and energy are estimated, over thousands of simulated hops, beside the textbook.

    python -m benchmarks.estimator [--json FILE] [--count N] [--seed S] [--processes P]

N broad hops and N/4 nominal ones (benchmarks/hop_draws.py says how they are drawn). `..._nominal` figures are of the
nominal hops, all others of the broad ones. Wrong and unflagged: a `valid` hop whose time of flight or energy is off
by more than 5 of its own sigmas. Coverage: share of both quantities' 95 % intervals that hold the truth. The bound
is that of benchmarks/flight_bound.py. The textbook's estimators state no sigma, so they have no such figures.
"""

from __future__ import annotations

import argparse
import math
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.figures import write_figures
from benchmarks.flight_bound import flight_bound_s
from benchmarks.hop_cases import simulate
from benchmarks.hop_results import Outcome, figures, flown, record_of
from benchmarks.rival_estimators import RIVALS
from flight.flight_time import estimate_flight

OURS = "flight software"
UNITS = {"percent": "%", "ms": "ms", "sample": "µs"}
_LEAST_IN_CELL = 25
_WORST = 8


def judge(job: tuple[int, bool], seed: int) -> dict[str, Outcome]:
    """All estimators on one hop."""
    index, nominal = job
    hop = simulate(seed, index, nominal)
    truth = hop.truth

    def outcome(answer: object, cost_s: float, bound_s: float = math.nan) -> Outcome:
        return Outcome(
            index,
            nominal,
            hop.case,
            answer,  # type: ignore[arg-type]
            truth.time_of_flight_s,
            truth.potential_j,
            hop.samples,
            cost_s,
            bound_s,
        )

    answer, cost_s = flown(hop)
    record = record_of(hop)
    bound_s = math.nan
    if nominal and answer.accepted:
        fit = estimate_flight(record, hop.settings).fit
        bound_s = flight_bound_s(hop, fit) if fit else math.nan
    found = {OURS: outcome(answer, cost_s, bound_s)}
    for name, rival in RIVALS.items():
        start = time.process_time()
        answer = rival(hop, record)
        found[name] = outcome(answer, time.process_time() - start)
    return found


def measure(hops: int, seed: int, processes: int) -> dict[str, list[Outcome]]:
    """Outcomes by estimator, broad hops first."""
    jobs = [(index, False) for index in range(hops)] + [(index, True) for index in range(hops // 4)]
    outcomes: dict[str, list[Outcome]] = {name: [] for name in (OURS, *RIVALS)}
    with ProcessPoolExecutor(processes) as pool:
        for found in pool.map(partial(judge, seed=seed), jobs, chunksize=16):
            for name, outcome in found.items():
                outcomes[name].append(outcome)
    return outcomes


def summary(outcomes: Sequence[Outcome]) -> dict[str, float]:
    """The figures by their names; those that an estimator does not have are left out."""
    broad = figures([o for o in outcomes if not o.nominal])
    nominal_hops = [o for o in outcomes if o.nominal]
    nominal = figures(nominal_hops)
    found = {
        "accepted_percent": broad["accepted_percent"],
        "tof_rms_ms_nominal": nominal.get("tof_rms_ms", math.nan),
        "tof_rms_ms_all": broad.get("tof_rms_ms", math.nan),
    }
    for name in (
        "energy_rms_percent",
        "energy_bias_percent",
        "coverage95_percent",
        "wrong_unflagged_percent",
        "us_per_sample",
    ):
        found[name] = broad.get(name, math.nan)
    found["energy_rms_percent_nominal"] = nominal.get("energy_rms_percent", math.nan)
    found["tof_coverage95_percent"] = broad.get("tof_coverage95_percent", math.nan)
    found["energy_coverage95_percent"] = broad.get("energy_coverage95_percent", math.nan)
    found["coverage95_percent_nominal"] = nominal.get("coverage95_percent", math.nan)
    found["tof_median_error_ms_all"] = broad.get("tof_median_ms", math.nan)
    bounded = [o for o in nominal_hops if math.isfinite(o.bound_s) and o.answer.accepted]
    if bounded:
        found["ratio_to_bound_nominal"] = _ratio_to_bound(bounded)
        found["ratio_to_bound_nominal_soil"] = _ratio_to_bound(
            [o for o in bounded if o.case.surface != "steel"]
        )
        told = [o for o in bounded if not o.answer.flagged]
        found["ratio_to_bound_nominal_valid"] = _ratio_to_bound(told)
        found["valid_percent_nominal"] = 100.0 * len(told) / len(nominal_hops)
        found["bound_ms_nominal"] = float(np.sqrt(np.mean([(1e3 * o.bound_s) ** 2 for o in bounded])))
    return {name: value for name, value in found.items() if math.isfinite(value)}


def _ratio_to_bound(outcomes: Sequence[Outcome]) -> float:
    """Root mean square error over that of the bound."""
    errors = np.array([o.flight_error_ms for o in outcomes])
    bounds = np.array([1e3 * o.bound_s for o in outcomes])
    return float(np.sqrt(np.mean(errors**2) / np.mean(bounds**2))) if outcomes else math.nan


def cells(outcomes: Sequence[Outcome]) -> list[tuple[str, int, dict[str, float]]]:
    """Broad hops by each property they were drawn with: name, hops, figures; worst time of flight first."""
    groups: dict[str, list[Outcome]] = {}
    for outcome in outcomes:
        if not outcome.nominal:
            for name, value in outcome.case.cells().items():
                groups.setdefault(f"{name} {value}", []).append(outcome)
    rows = [(name, len(own), figures(own)) for name, own in groups.items() if len(own) >= _LEAST_IN_CELL]
    return sorted(rows, key=lambda row: -row[2].get("tof_rms_ms", math.inf))


def print_report(outcomes: Mapping[str, Sequence[Outcome]]) -> None:
    ours = outcomes[OURS]
    names = list(summary(ours))
    print(f"{'':32s}" + "".join(f"{name:>18s}" for name in outcomes))
    sums = {name: summary(own) for name, own in outcomes.items()}
    for figure in names:
        cellsof = (
            f"{sums[name][figure]:18.4g}" if figure in sums[name] else f"{'-':>18s}" for name in outcomes
        )
        print(f"{figure:32s}" + "".join(cellsof))
    print(f"\nworst cells of the {OURS} (time of flight), and the same cells' other figures")
    for name, count, row in cells(ours)[:_WORST]:
        text = "  ".join(
            f"{key} {row[key]:.3g}" for key in row if key not in ("tof_median_ms", "us_per_sample")
        )
        print(f"  {name:42s} {count:5d} hops  {text}")
    reasons = Counter(reason for o in ours if not o.answer.accepted for reason in _kinds(o.answer.reason))
    doubts = Counter(reason for o in ours if o.answer.flagged for reason in _kinds(o.answer.reason))
    print("\nrejected:", dict(reasons.most_common()), "\ndegraded:", dict(doubts.most_common()))


def _kinds(reason: str) -> list[str]:
    """Reasons without their numbers."""
    return ["".join("#" if c.isdigit() else c for c in part).strip() for part in reason.split(";") if part]


def main() -> None:
    """Measure, print, and write the figures where asked."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    parser.add_argument(
        "--count", type=int, default=5000, help="broad hops (default 5000); a quarter as many nominal ones"
    )
    parser.add_argument("--seed", type=int, default=20260, help="seed of all draws")
    parser.add_argument("--processes", type=int, default=1)
    options = parser.parse_args()
    outcomes = measure(options.count, options.seed, options.processes)
    print_report(outcomes)
    if options.json:
        entries = {}
        for name, own in outcomes.items():
            prefix = "" if name == OURS else f"{name}_"
            for figure, value in summary(own).items():
                unit = next((UNITS[part] for part in figure.split("_") if part in UNITS), "1")
                entries[prefix + figure] = (value, unit)
        write_figures(options.json, entries)


if __name__ == "__main__":
    main()
