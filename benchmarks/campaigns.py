"""Throughput of a campaign against the number of workers, on this computer and on a Dask cluster of its processes.

    python -m benchmarks.campaigns [--kind faults|missions] [--cases N] [--workers 1,2,4] [--json FILE]

The same cases each time; the rows are compared bit for bit. `busy`: share of the time that workers spent on cases.
Wall time: it says something only on a machine with nothing else to do.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from benchmarks.figures import write_figures
from ground.campaign.crews import crew
from ground.campaign.engine import StudyResult, run_study
from ground.campaign.missions import load_missions
from ground.campaign.study import Study
from ground.fault_campaign.campaign import FaultStudy
from ground.fault_campaign.drawing import load_campaign

SEED = 1


def run(study: Study, wanted: int, processes: int, scheduler: str | None) -> StudyResult:
    """A campaign from nothing."""
    with tempfile.TemporaryDirectory() as folder, crew(processes, scheduler) as workers:
        return run_study(study, wanted, Path(folder), workers, lambda text, done: None)


def on_cluster(study: Study, wanted: int, processes: int) -> StudyResult:
    """The same on a cluster of so many processes. Raises `ImportError` without Dask."""
    from distributed import LocalCluster

    made = LocalCluster(  # type: ignore[no-untyped-call]
        n_workers=processes, threads_per_worker=1, dashboard_address="127.0.0.1:0", silence_logs=50
    )
    with made:
        return run(study, wanted, 1, made.scheduler_address)


def main() -> None:
    """Measure, print, compare."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kind", choices=("faults", "missions"), default="faults")
    parser.add_argument("--cases", type=int, default=40, help="missions, or faults that make a difference")
    parser.add_argument("--workers", default="1,2", help="numbers of workers")
    parser.add_argument("--json", type=Path, help="write the figures here")
    given = parser.parse_args()
    study: Study = FaultStudy(load_campaign(), SEED) if given.kind == "faults" else load_missions(SEED)
    figures: dict[str, tuple[float, str]] = {}
    first: StudyResult | None = None
    for number in map(int, given.workers.split(",")):
        for place, made in (
            ("processes", run(study, given.cases, number, None)),
            ("cluster", on_cluster(study, given.cases, number)),
        ):
            first = first or made
            same = (made.rows, made.failed) == (first.rows, first.failed)
            print(f"{place} of {number}: {made.throughput.text}; rows {'the same' if same else 'DIFFER'}")
            rate = made.throughput.cases / made.throughput.seconds
            figures[f"cases_per_s_{place}_{number}"] = (rate, "1/s")
            figures[f"same_rows_{place}_{number}"] = (float(same), "1")
    if given.json:
        write_figures(given.json, figures)


if __name__ == "__main__":
    main()
