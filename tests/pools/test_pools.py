"""Workers of a killed command end with it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = """
import multiprocessing, os, sys, time
from concurrent.futures import ProcessPoolExecutor
from ground.pools import end_with_parent

def work(seconds):
    os.write(1, f"{os.getpid()}\\n".encode())  # whole: print writes the line's end apart
    time.sleep(seconds)

if __name__ == "__main__":
    initializer = end_with_parent if sys.argv[1] == "watched" else None
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn"), initializer) as pool:
        list(pool.map(work, [30.0, 30.0]))
"""


def alive(pid: int) -> bool:
    """Whether a process runs (one that ended and was not yet asked for its result does not)."""
    try:
        return ") Z " not in Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks at processes in /proc (Linux)")
@pytest.mark.parametrize("how", ["watched", "left alone"])
def test_workers_end_when_their_parent_is_killed(how: str, tmp_path: Path) -> None:
    """Beside it, the same pool without the watch: its workers do live on, so the test can fail."""
    script = tmp_path / "pool.py"
    script.write_text(SCRIPT)
    parent = subprocess.Popen(
        [sys.executable, str(script), how],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        text=True,
    )
    assert parent.stdout is not None
    workers = [int(parent.stdout.readline()) for _ in range(2)]
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    parent.stdout.close()
    try:
        for _ in range(200 if how == "watched" else 10):
            if not any(map(alive, workers)):
                break
            time.sleep(0.05)
        assert any(map(alive, workers)) == (how == "left alone")
    finally:
        for worker in filter(alive, workers):
            os.kill(worker, signal.SIGKILL)


def test_all_pools_are_watched() -> None:
    """Where the command line starts worker processes, each pool has the watch."""
    for path in (ROOT / "ground").rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        if "ProcessPoolExecutor(" in text:
            assert "end_with_parent" in text, path
