"""A command that would write over what a person has, or where nothing can be written, says so before it works."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hopper_command import done, hopper, refused

SIMULATE = ("simulate", "--plant", "cart.yaml", "--like", "a.csv", "--out")
LONG = "time_s,force_n,position_m\n" + "".join(f"{0.01 * i:.2f},1.0,{0.01 * i:.2f}\n" for i in range(60))


def contents(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    ("command", "says"),
    [
        ((*SIMULATE, "a.csv"), "a.csv: is the recording that is simulated; choose another name"),
        ((*SIMULATE, "./a.csv"), "a.csv: is the recording that is simulated; choose another name"),
        ((*SIMULATE, "cart.csv"), "cart.csv: its sidecar would replace cart.yaml, which is none; choose another"),
        (("convert", "a.csv", "a.csv"), "a.csv: is the recording that is read; choose another name"),
        ((*SIMULATE, "a.csv.gz"), "a.csv.gz: its sidecar would replace that of a.csv; choose another name"),
        ((*SIMULATE, "folder.csv"), "folder.csv: is a folder; name a file"),
        ((*SIMULATE, "a.yaml/b.csv"), "a.yaml/b.csv: cannot be written (a.yaml is no folder)"),
        (("diagnose", "a.csv", "--plant", "cart.yaml", "--out", "a.yaml"), "a.yaml: is a file; name a folder for"),
        (("diagnose", "a.csv", "--plant", "mine/plant.yaml", "--out", "mine"), "mine: holds a plant.yaml that is no"),
        (("diagnose", "a.csv", "--plant", "cart.yaml", "--out", "a.csv/b"), "a.csv/b: cannot be written (a.csv is"),
    ],
)  # fmt: skip
def test_nothing_of_a_persons_is_written_over(desk: Path, command: tuple[str, ...], says: str) -> None:
    (desk / "folder.csv").mkdir()
    (desk / "mine").mkdir()
    (desk / "mine" / "plant.yaml").write_bytes((desk / "cart.yaml").read_bytes())
    before = contents(desk)
    assert refused(*command).startswith(says)
    assert contents(desk) == before


def test_a_result_is_written_again(desk: Path) -> None:
    """What the same command left behind is in nobody's way."""
    results = desk / "results"
    for _ in range(2):
        done(*SIMULATE, results / "b.csv.gz")
    assert {path.name for path in results.iterdir()} == {"b.csv.gz", "b.yaml"}


def test_a_published_plant_of_another_rig_is_refused_before_the_search(desk: Path) -> None:
    (desk / "a.csv").write_text(LONG, encoding="utf-8")
    result = hopper("diagnose", "a.csv", "--plant", "cart.yaml", "--compare", "bb0b_hop", "--out", "out")
    assert result.exit_code == 2
    assert "kind is 'axis', the plant 'bb0b' is of kind 'hop'" in result.stderr
    assert "locating" not in result.stderr


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (
            ",",
            ";",
            "a.csv:1:1: the first column must be 'time_s', not 'time_s;force_n;position_m' (columns are told",
        ),
        ("\n0.1,", "\n\n0.1,", "a.csv:3:2: the line is empty"),
    ],
)
def test_tables_of_other_makers_are_told_of_what_is_wrong(desk: Path, old: str, new: str, says: str) -> None:
    text = (desk / "a.csv").read_text(encoding="utf-8")
    (desk / "a.csv").write_text(text.replace(old, new), encoding="utf-8")
    assert refused(*SIMULATE, "out.csv").startswith(says)


def test_a_run_of_one_sample_is_refused(desk: Path) -> None:
    (desk / "a.csv").write_text("time_s,force_n,position_m\n0.0,1.0,0.0\n", encoding="utf-8")
    assert refused(*SIMULATE, "out.csv") == "a.csv: one sample is no run; two are the least"


def test_a_channel_that_stands_still_is_refused_unless_its_sensor_is_described(desk: Path) -> None:
    rows = [f"{t:.2f},1.0,0.25\n" for t in 0.01 * np.arange(60)]
    (desk / "a.csv").write_text("time_s,force_n,position_m\n" + "".join(rows), encoding="utf-8")
    message = refused("diagnose", "a.csv", "--plant", "cart.yaml", "--out", "out")
    assert message.startswith("channel 'position_m' reads the same in every recording that is fitted")
