"""Start of the `hopper` command: says what to install when the ground tools' libraries are not there."""

from __future__ import annotations

import sys

from hal.raspberry_pi import setup_check

STOPPED = 130
"""Exit code of a command that Ctrl-C stopped."""


def main() -> None:
    """Run the command line, or say how to get it; `setup` is for the robot, which has no ground tools."""
    if sys.argv[1:2] == ["setup"] and "--help" not in sys.argv:
        sys.exit(setup_check.main(sys.argv[2:]))
    try:
        _start()
    except KeyboardInterrupt:  # while the libraries are still being read, which takes seconds
        sys.stderr.write("stopped; nothing was written\n")
        sys.exit(STOPPED)


def _start() -> None:
    try:
        from ground.cli import app  # the ground extra may be absent on a robot
    except ModuleNotFoundError as error:
        if error.name and error.name.split(".")[0] in {"flight", "hal", "sim_hal", "ground"}:
            raise
        sys.exit(
            f"hopper: the ground tools need {error.name!r}; install them with: pip install 'hopper-flight[ground]'\n"
            "On the robot itself, fly with: python -m flight --help"
        )
    app()
