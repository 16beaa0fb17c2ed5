"""One target under Atheris: `python -m benchmarks.fuzz.one NAME [options of libFuzzer] CORPUS...`; never returns."""

from __future__ import annotations

import importlib
import sys
from typing import Any


def main() -> None:
    """Import the readers with their branches counted, then fuzz."""
    try:
        atheris: Any = importlib.import_module("atheris")
    except ImportError:
        raise SystemExit("fuzzing needs atheris; install it with: pip install atheris") from None
    with atheris.instrument_imports(include=["flight", "hal", "ground", "sim_hal", "mcap", "yaml"]):
        targets = importlib.import_module("benchmarks.fuzz.targets")
    name = sys.argv[1]

    def once(data: bytes) -> None:
        targets.feed(name, data)

    atheris.Setup([sys.argv[0], *sys.argv[2:]], once)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
