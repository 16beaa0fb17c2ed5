"""Explores the state machine with its interlocks exhaustively, and prints the counts.

python -m benchmarks.states [--json FILE]
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from benchmarks.figures import write_figures
from flight import settings as flight_settings
from ground.state_space.explore import explore


def tell(done: int, waiting: int) -> None:
    """Show how far it is, now and then."""
    if done % 50 == 0:
        print(f"{done} states explored, {waiting} wait", file=sys.stderr, flush=True)


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description="Explore the state machine with its interlocks.")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    found = explore(flight_settings.load(), show=tell)
    unsafe = sum(found.unsafe.values())
    counts = {
        "states": found.states,
        "transitions": found.transitions,
        "phases": len(found.phases),
        "magnet_on": found.magnet_on,
        "unsafe": unsafe,
    }
    for name, value in counts.items():
        print(f"{name}: {value}")
    print(found.unsafe, found.example)
    if options.json:
        write_figures(options.json, {name: (value, "1") for name, value in counts.items()})
    raise SystemExit(1 if unsafe else 0)


if __name__ == "__main__":
    main()
