"""`hopper console` as a process: it prints its address, serves, and ends cleanly by Ctrl-C."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def start(*arguments: str | Path) -> tuple[subprocess.Popen[str], str]:
    """The process and the address that it printed."""
    process = subprocess.Popen(
        [
            sys.executable,
            "-c",
            "from ground.entry import main; main()",
            "console",
            "--no-browser",
            *arguments,
        ],
        env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    for line in process.stdout:
        found = re.search(r"http://\S+", line)
        if found:
            return process, found.group()
    raise AssertionError(process.communicate()[1])


def stop(process: subprocess.Popen[str]) -> str:
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    assert "Traceback" not in err
    return out


def test_a_log_is_served_to_who_has_the_address(flown_log: Path) -> None:
    process, address = start(flown_log)
    opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
    assert b"hopper console" in opener.open(address).read()
    try:
        urllib.request.urlopen(address.partition("?")[0])
        raise AssertionError("served without the token")
    except urllib.error.HTTPError as refused:
        assert refused.code == 403
        refused.close()
    assert "closing" in stop(process)


def test_a_simulation_that_is_closed_says_what_was_kept(tmp_path: Path) -> None:
    process, _ = start("--sim", "--hops", "1", "--energy-j", "2", "--stay-s", "0", "--out", tmp_path / "out")
    assert f"kept: {tmp_path / 'out'}" in stop(process).replace("\n", "")
    assert (tmp_path / "out" / "report.html").is_file()
