"""Manners of the command line: examples that are true, completion, answers for machines."""

from __future__ import annotations

import json
import shlex
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
from hopper_command import done, hopper

from ground.cli import app
from ground.help_examples import EXAMPLES

GROUP: Any = typer.main.get_command(app)


def leaves(group: Any, above: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Every command by its words, also a group that does something by itself."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from leaves(command, (*above, name))
            if command.invoke_without_command:
                yield (*above, name), command
        else:
            yield (*above, name), command


def test_every_command_has_examples_in_its_help() -> None:
    names = {" ".join(words) for words, _ in leaves(GROUP)}
    assert names == set(EXAMPLES)
    for words, command in leaves(GROUP):
        if not hasattr(command, "commands"):
            shown = hopper(*words, "--help")
            assert shown.exit_code == 0
            assert "Examples:" in shown.stdout


@pytest.mark.parametrize("example", [each for examples in EXAMPLES.values() for each in examples])
def test_every_example_is_read_by_the_command_line(example: str) -> None:
    program, *words = shlex.split(example)
    assert program == "hopper"
    command, context = GROUP, GROUP.make_context("hopper", words[:1])
    while hasattr(command, "commands") and words and words[0] in command.commands:
        command = command.commands[words[0]]
        words = words[1:]
        group = hasattr(command, "commands")
        context = command.make_context("hopper", words[:1] if group else words, parent=context)
    assert context.command is command


def test_completion_is_offered() -> None:
    assert "--install-completion" in done("--help")


@pytest.mark.parametrize(
    "arguments", [("plant", "check", "emps_mass"), ("dictionary",), ("setup",), ("data", "list")]
)
def test_answers_for_machines_are_json_and_nothing_else(arguments: tuple[str, ...]) -> None:
    assert json.loads(hopper(*arguments, "--json").stdout)


@pytest.mark.parametrize("words", [("key",), ("layout",), ("dictionary", "export", "--xtce")])
def test_a_written_file_is_named_to_machines(words: tuple[str, ...], tmp_path: Path) -> None:
    file = tmp_path / "written"
    assert json.loads(done(*words, file, "--json")) == {"file": str(file)}
    assert file.stat().st_size > 0


def test_the_calibration_answers_machines_with_target_and_fit() -> None:
    found = json.loads(done("calibrate", "--json"))
    assert found["written"] == []
    sand = next(row for row in found["c3"] if row["surface"] == "quartz_sand")
    assert (sand["foot"], sand["tilt_deg"]) == ("1", 0.0)
    assert abs(sand["fitted"]["mean"] - sand["published"]["mean"]) < 0.02


def test_drawn_figures_are_named_to_machines(flown: Path, tmp_path: Path) -> None:
    pytest.importorskip("kaleido", reason="kaleido is not installed (extra 'figures')")
    if not any(map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))):
        pytest.skip("no Chromium on this computer")
    found = json.loads(done("figures", flown / "report.html", "--out", tmp_path / "drawn", "--json"))
    assert found["files"] and all(
        (tmp_path / "drawn" / name).stat().st_size > 1000 for name in found["files"]
    )


def test_recordings_and_replay_answer_machines(flown_log: Path, tmp_path: Path) -> None:
    out = tmp_path / "hop.mcap"
    found = json.loads(done("convert", flown_log.with_name("hop_01.hop.csv.gz"), out, "--json"))
    assert found["file"] == str(out) and found["samples"] > 1000
    found = json.loads(done("replay", flown_log, "--json"))
    assert found["same"] is True and found["compared"] > 10_000
    found = json.loads(done("export", flown_log, "--out", tmp_path / "tables", "--json"))
    assert found["rows"]["hop.csv"] == 2


def test_a_wrong_command_or_option_ends_with_2() -> None:
    assert hopper("hop").exit_code == 2
    assert hopper("run", "--height", "3").exit_code == 2
    assert hopper("console").exit_code == 2
