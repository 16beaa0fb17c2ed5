"""The `hopper` command as a person calls it, in this process."""

from __future__ import annotations

from pathlib import Path

from typer.testing import CliRunner, Result

from ground.cli import app

SHORT = (
    "run",
    "--surface",
    "quartz_sand",
    "--hops",
    "1",
    "--references",
    "0",
    "--energy-j",
    "2",
    "--seed",
    "7",
)
"""A mission of one small hop."""


def hopper(*arguments: str | Path) -> Result:
    """Run `hopper ARGUMENTS` to its end."""
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def done(*arguments: str | Path) -> str:
    """What a command prints that must succeed."""
    result = hopper(*arguments)
    assert result.exit_code == 0, result.output
    return result.stdout


def refused(*arguments: str | Path) -> str:
    """The one-line message with which a command is refused, without its `error: `."""
    result = hopper(*arguments)
    assert result.exit_code == 2, result.output
    assert isinstance(result.exception, SystemExit), result.exception  # anything else would be a traceback
    assert result.stdout == ""
    lines = result.stderr.strip().splitlines()
    message = [line for line in lines if line.startswith("error: ")]
    assert len(message) == 1, lines
    assert lines[-1] == message[0]
    return message[0].removeprefix("error: ")
