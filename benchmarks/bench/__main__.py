"""One table: what hopper costs and gets right, each row beside its peer in the same run.

    python -m benchmarks.bench [--out FILE.md] [--json FILE] [--repeats N] [--parts hops,missions,…]

Times are processor time of one core, so that other work on the machine counts little; a row's jobs are run by turns,
the median and the range are shown. A ratio above 1 means that ours is that many times better.

Parts: hops, missions, estimates, on_board, answers, growth, diagnosis_growth.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
from collections.abc import Sequence
from datetime import date
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.bench.parts import GROWTHS, PARTS
from benchmarks.bench.readme import with_table
from benchmarks.bench.rows import Growth, Row
from ground.files import write_atomic

HEADERS = ("what", "ours: median (range)", "unit", "peer", "peer: median (range)", "ratio", "note")
GROWTH_HEADERS = ("cost against", "size: time", "exponent")
NAMED = ("hopper-flight", "numpy", "scipy", "numba", "mujoco", "pysindy", "mcap", "llvmlite")
PAGE = Path(__file__).resolve().parents[1] / "results.md"
README = PAGE.parents[1] / "README.md"


def main() -> None:
    """Measure, print, and write the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--out",
        type=Path,
        help="the table, as markdown; default of a whole run: results.md, and short the README",
    )
    parser.add_argument("--json", type=Path, help="write the figures here")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--parts", default=",".join((*PARTS, *GROWTHS)))
    given = parser.parse_args()
    parts = given.parts.split(",")
    if unknown := set(parts) - {*PARTS, *GROWTHS}:
        parser.error(f"--parts {', '.join(sorted(unknown))}: known are {', '.join((*PARTS, *GROWTHS))}")
    rows, growths = list[Row](), list[Growth]()
    for name in parts:
        print(f"{name} …", flush=True)
        if name in PARTS:
            rows += PARTS[name](given.repeats)
        else:
            growths += GROWTHS[name](given.repeats)
    show(HEADERS[:-1], [row.cells[:-1] for row in rows])
    show(GROWTH_HEADERS, [growth.cells for growth in growths])
    text = page(rows, growths)
    if given.out:
        write_atomic(given.out, text)
    elif {*parts} == {*PARTS, *GROWTHS}:
        write_atomic(PAGE, text)
        write_atomic(README, with_table(README.read_text(encoding="utf-8"), text))
    if given.json:
        write_atomic(given.json, json.dumps({"figures": figures(rows, growths)}, indent=1) + "\n")


def show(headers: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """A table on the terminal."""
    drawn = Table(*headers)
    for row in rows:
        drawn.add_row(*row)
    Console().print(drawn)


def machine() -> str:
    """What it was measured on: processor, cores, load, system, versions."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = [
            line.partition(":")[2].strip() for line in info.read_text().splitlines() if "model name" in line
        ]
        model = names[0] if names else model
    found = []
    for name in NAMED:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            found.append(f"{name} not installed")
    return (
        f"{date.today().isoformat()}, {model}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, "
        f"{platform.system()} {platform.release()}, Python {platform.python_version()}; {', '.join(found)}."
    )


def page(rows: Sequence[Row], growths: Sequence[Growth]) -> str:
    """The tables as markdown."""
    lines = [
        "# Measured",
        "",
        f"By `make bench`: {machine()}",
        "",
        " ".join(str(__doc__).split("\n\n")[2].split()),
        "",
    ]
    for headers, cells in (
        (HEADERS, [row.cells for row in rows]),
        (GROWTH_HEADERS, [g.cells for g in growths]),
    ):
        if cells:
            lines += [_line(headers), _line(["---"] * len(headers)), *map(_line, cells), ""]
    behind = [row for row in rows if row.ratio is not None and row.ratio < 1.0]
    lines += ["## Behind its peer", ""]
    lines += [f"- {row.name} against {row.peer}: {row.note or 'no reason written'}" for row in behind] or [
        "None."
    ]
    return "\n".join(lines) + "\n"


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def figures(rows: Sequence[Row], growths: Sequence[Growth]) -> dict[str, dict[str, object]]:
    """Medians, ratios and exponents by name."""
    found: dict[str, dict[str, object]] = {}
    for row in rows:
        name = f"{row.name} beside {row.peer}" if row.peer else row.name
        found[name] = {"value": float(np.median(row.ours)), "unit": row.unit}
        if row.ratio is not None:
            found[f"{name}: ratio"] = {"value": row.ratio, "unit": "1"}
    for growth in growths:
        found[f"exponent of {growth.name}"] = {"value": growth.exponent[0], "unit": "1"}
    return found


if __name__ == "__main__":
    main()
