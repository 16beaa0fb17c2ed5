"""The file of a benchmark's figures: `{"figures": {NAME: {"value": …, "unit": …}}}`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from ground.files import write_atomic


def write_figures(path: Path, figures: Mapping[str, tuple[float, str]]) -> None:
    """Write value and unit of each figure by its name, the whole file or nothing of it."""
    content = {name: {"value": value, "unit": unit} for name, (value, unit) in figures.items()}
    write_atomic(path, json.dumps({"figures": content}, indent=1) + "\n")
