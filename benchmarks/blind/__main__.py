"""Blind cases: draw rigs with something hidden in them, diagnose them, count what was right, beside the rivals.

    python -m benchmarks.blind --count 200 --seed 1 --kinds hop,drive,axis,drop --rows FILE.jsonl
                               [--json FILE] [--page FILE.md] [--processes 2] [--only hop-7]

Cases are the same for the same seed. Rows are added to FILE.jsonl as they come; what stands there is not run again.
"""

from __future__ import annotations

import argparse
import json
from itertools import product
from pathlib import Path

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from benchmarks.blind.cases import KINDS
from benchmarks.blind.run import Row, Task, row_of, run_all
from benchmarks.blind.table import figures, show, write_page
from benchmarks.extra import require_pysindy


def main() -> None:
    """Run what is missing, then show the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=40, help="cases, shared out evenly over the kinds")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--rows", type=Path, default=Path("blind.jsonl"), help="JSON lines, one case each")
    parser.add_argument("--json", type=Path, help="write the figures here")
    parser.add_argument("--page", type=Path, help="write the tables here, as markdown")
    parser.add_argument("--processes", type=int, choices=(1, 2), default=1)
    parser.add_argument("--only", help="run this one case, show all of it, write nothing")
    given = parser.parse_args()
    kinds = tuple(given.kinds.split(","))
    if set(kinds) - set(KINDS):
        parser.error(f"--kinds {given.kinds}: known are {', '.join(KINDS)}")
    require_pysindy(parser)
    if given.only:
        kind, number = given.only.rsplit("-", 1)
        print(json.dumps(row_of((kind, int(number), given.seed)), indent=1, default=float))
        return
    rows = run(kinds, given.count, given.seed, given.rows, given.processes)
    show(rows)
    if given.json:
        given.json.write_text(json.dumps({"figures": figures(rows)}, indent=1) + "\n", encoding="utf-8")
    if given.page:
        write_page(given.page, rows)


def run(kinds: tuple[str, ...], count: int, seed: int, file: Path, processes: int) -> list[Row]:
    """The rows of `count` cases, the kinds by turns."""
    tasks: list[Task] = [
        (kind, number, seed) for number, kind in product(range(-(-count // len(kinds))), kinds)
    ]
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    with Progress(*columns) as progress:
        bar = progress.add_task("blind cases", total=count)

        def seen(row: Row) -> None:
            hidden = " + ".join(one["physics_id"] for one in row["hidden"]) or "nothing"
            found = " + ".join(f["physics_id"] for f in row.get("findings", [])) or row.get(
                "error", "nothing"
            )
            progress.console.print(
                f"{row['case']:9s} {hidden} -> {found}  ({row['seconds']:.0f} s)", markup=False
            )
            progress.advance(bar)

        return run_all(tasks[:count], file, processes, seen)


if __name__ == "__main__":
    main()
