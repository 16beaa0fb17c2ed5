"""Fuzz everything that reads what comes from outside, guided by the coverage of its code.

    python -m benchmarks.fuzz [--seconds S] [--only NAME ...]

Each target runs in a process of its own for so many seconds, with Atheris (libFuzzer), from its part of the corpus
(`tests/corpus`) on. What reaches new code is added to it, and so is what crashes, as `crash-*`:
the test of the corpus then fails until the reader is mended. Ends with 1 when something crashed.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.fuzz.targets import CORPUS, TARGETS, inputs_of
from benchmarks.fuzz.worth import worth_keeping


def main() -> None:
    """Fuzz the targets one after the other."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=int, default=60, help="for each target")
    parser.add_argument("--only", nargs="*", choices=TARGETS, default=list(TARGETS), metavar="NAME")
    given = parser.parse_args()
    crashed = [name for name in given.only if fuzz(name, given.seconds)]
    if crashed:
        raise SystemExit(f"crashed: {', '.join(crashed)}; see {CORPUS}")


def fuzz(name: str, seconds: int) -> int:
    """Fuzz one target, and keep what was found; returns how many inputs crash it."""
    target, kept = TARGETS[name], inputs_of(name)
    with tempfile.TemporaryDirectory() as made:
        work, crashes = Path(made) / "work", Path(made) / "crashes"
        work.mkdir()
        crashes.mkdir()
        for path in target.shipped:
            shutil.copyfile(path, work / path.name)
        _run(
            *(name, f"-max_total_time={seconds}", f"-max_len={target.longest_bytes}"),
            *("-timeout=20", "-rss_limit_mb=2000", f"-artifact_prefix={crashes}/", work, CORPUS / name),
        )
        found = [*worth_keeping(name, kept, work.iterdir()), *crashes.iterdir()]
        for path in found:
            shutil.copyfile(path, CORPUS / name / path.name)
        crashed = sum(1 for _ in crashes.iterdir())
    print(f"{name}: {len(kept)} inputs were known, {len(found)} are new, {crashed} crash", flush=True)
    return crashed


def _run(*arguments: str | Path) -> None:
    command = [sys.executable, "-m", "benchmarks.fuzz.one", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if "INFO: seed corpus" not in done.stderr:
        raise SystemExit(done.stderr)  # it did not even start: no Atheris, most likely
    print(next((line for line in reversed(done.stderr.splitlines()) if " cov: " in line), ""))


if __name__ == "__main__":
    main()
