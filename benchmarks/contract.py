"""The matrix of the contract suite: for each device and case, what came of it on each backend.

    python -m benchmarks.contract [--json FILE]

Runs `tests/contract` of this checkout and prints a row for each device and case: `ok`, `FAILED`, or `-` where it was
skipped (the bench hardware, unless it is asked for by `pytest -m bench -s -n0 tests/contract`).
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from pathlib import Path
from typing import Any

import pytest

from benchmarks.figures import write_figures

SUITE = Path(__file__).resolve().parents[1] / "tests" / "contract"
MARKS = {"passed": "ok", "failed": "FAILED", "skipped": "-"}
WORST_FIRST = ("failed", "passed", "skipped")


class Matrix:
    """A pytest plugin that gathers outcomes by device, case and backend."""

    def __init__(self) -> None:
        self.cells: dict[tuple[str, str], dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
        self._of: dict[str, tuple[str, str, str]] = {}

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        """Note whose test each is: by its parameter `device`, else by the mark `device`."""
        for item in items:
            given = item.callspec.params
            marked = item.get_closest_marker("device")
            device = given.get("device") or (marked.args[0] if marked else "board")
            case = item.originalname.removeprefix("test_").replace("_", " ")
            self._of[item.nodeid] = (device, case, given["backend"])

    def pytest_runtest_logreport(self, report: Any) -> None:
        """A test that fails while it is set up or taken down has failed."""
        if report.when == "call" or report.outcome != "passed":
            device, case, backend = self._of[report.nodeid]
            self.cells[device, case][backend].append(report.outcome)

    @property
    def backends(self) -> list[str]:
        """In the order of the suite."""
        return list(dict.fromkeys(backend for _, _, backend in self._of.values()))

    def count(self, outcome: str) -> int:
        """How many tests came out so."""
        return sum(o == outcome for row in self.cells.values() for cell in row.values() for o in cell)

    def table(self) -> str:
        """The matrix as text, a device after the other; a cell of several values says its worst and how many."""
        backends = self.backends
        head = f"{'device':16s} {'case':74s} " + " ".join(f"{name:>16s}" for name in backends)
        lines = [head]
        for device, case in sorted(self.cells):
            cells = [_cell(self.cells[device, case][name]) for name in backends]
            lines.append(f"{device:16s} {case:74s} " + " ".join(f"{text:>16s}" for text in cells))
        return "\n".join(lines)


def _cell(outcomes: list[str]) -> str:
    worst = next((outcome for outcome in WORST_FIRST if outcome in outcomes), "skipped")
    return MARKS[worst] + (f" ({len(outcomes)})" if len(outcomes) > 1 else "")


def main() -> None:
    """Run the suite and print."""
    parser = argparse.ArgumentParser(description="Print the matrix of the contract suite.")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    matrix = Matrix()
    code = pytest.main(
        [str(SUITE), "-q", "-n0", "--no-header", "--no-summary", "-p", "no:randomly"], [matrix]
    )
    print(matrix.table())
    figures: dict[str, int] = {outcome: matrix.count(outcome) for outcome in MARKS}
    figures |= {"rows": len(matrix.cells), "backends": len(matrix.backends)}
    print(", ".join(f"{name}: {value}" for name, value in figures.items()))
    if options.json:
        write_figures(options.json, {name: (value, "1") for name, value in figures.items()})
    raise SystemExit(int(code))


if __name__ == "__main__":
    main()
