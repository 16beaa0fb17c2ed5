"""What the benchmarks need beside the project, said before the work and not after an hour of it."""

from __future__ import annotations

import argparse
from importlib.util import find_spec


def require_pysindy(parser: argparse.ArgumentParser) -> None:
    """End with a message for a person where the rivals' sparse regression is not installed."""
    if find_spec("pysindy") is None:
        parser.error("the rivals need PySINDy: pip install 'hopper-flight[ground,bench]'")
