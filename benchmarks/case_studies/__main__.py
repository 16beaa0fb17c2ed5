"""A case study: real recordings diagnosed, scored beside their rivals on the same split, told on one page.

    python -m benchmarks.case_studies emps --data FOLDER [--out DIR] [--page FILE.md] [--json FILE]

The studies are `config/case_studies/*.yaml`, by their names. DIR keeps the diagnoses: a second run scores them
without diagnosing again.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path

from benchmarks.case_studies.page import figures_of, write_page
from benchmarks.case_studies.run import run_group
from benchmarks.case_studies.study import Group, load_study, plant_of, read
from benchmarks.extra import require_pysindy
from ground.files import write_atomic
from hal.config import config_root

STUDIES = config_root() / "case_studies"
PAGES = Path(__file__).resolve().parents[2] / "docs" / "case-studies"


def main() -> None:
    """Run one study and write its page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "name", choices=sorted(path.stem.replace("_", "-") for path in STUDIES.glob("*.yaml"))
    )
    parser.add_argument("--data", type=Path, required=True, help="folder of the data set")
    parser.add_argument("--out", type=Path, help="folder for the diagnoses (default: out/case-studies/NAME)")
    parser.add_argument("--page", type=Path, help="default: docs/case-studies/NAME.md")
    parser.add_argument("--json", type=Path, help="write the figures here")
    given = parser.parse_args()
    require_pysindy(parser)
    study = load_study(given.name.replace("-", "_"))
    out = given.out or Path("out/case-studies") / given.name
    recordings, unseen = read(study.recordings, given.data), read(study.unseen, given.data)
    groups: dict[str, Group | None] = dict(study.groups) or {"": None}
    results = []
    for label, group in groups.items():
        mine = [r for r in recordings if group is None or r.run.startswith(group.runs)]
        folder = out / label.replace(" ", "_") if label else out
        tell = progress(label)
        results.append(run_group(study, label, mine, unseen, plant_of(study, group), folder, tell))
    page = given.page or PAGES / f"{given.name}.md"
    write_page(page, given.name, study, results)
    print(page)
    figures = figures_of(results)
    if given.json:
        write_atomic(given.json, json.dumps({"figures": figures}, indent=1) + "\n")
    for name, figure in figures.items():
        if "over_" in name:
            value, low, high = (
                "no bound" if figure[key] is None else f"{figure[key]:.3g}"
                for key in ("value", "low", "high")
            )
            print(f"{name}: {value} ({low} to {high})")


def progress(label: str) -> Callable[[str], None]:
    """Say each step on the error channel."""

    def tell(text: str) -> None:
        print(f"{label}: {text}" if label else text, file=sys.stderr, flush=True)

    return tell


if __name__ == "__main__":
    main()
