"""Which of many inputs are worth keeping: those that take a branch that no kept one takes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

from coverage import Coverage

from benchmarks.fuzz.targets import feed

PACKAGES = ["flight", "hal", "sim_hal", "ground"]
Branch = tuple[str, int, int]


def branches(name: str, data: bytes) -> set[Branch]:
    """The steps from line to line that a target takes on an input, in our own code."""
    measured = Coverage(data_file=None, branch=True, source=PACKAGES, config_file=False)
    with measured.collect(), suppress(Exception):
        feed(name, data)
    found = measured.get_data()
    return {(file, *arc) for file in found.measured_files() for arc in found.arcs(file) or ()}


def worth_keeping(name: str, kept: Iterable[Path], candidates: Iterable[Path]) -> Iterator[Path]:
    """The candidates that add a branch to those of `kept` and of the ones before them, the smallest first."""
    seen = set[Branch]().union(*(branches(name, path.read_bytes()) for path in kept))
    for path in sorted(candidates, key=lambda each: (each.stat().st_size, each.name)):
        own = branches(name, path.read_bytes())
        if not own <= seen:
            seen |= own
            yield path
