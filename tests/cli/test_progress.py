"""What long work tells of itself: in a terminal, elsewhere, and of a search whose length nobody knows."""

from __future__ import annotations

import io
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from ground import console
from ground.diagnose.outlook import LOOKS, Outlook
from ground.progress import part_of, steps_of


class Wall:
    """A wall clock that the test turns on."""

    def __init__(self) -> None:
        self.time_s = 100.0

    def __call__(self) -> float:
        return self.time_s


@pytest.fixture
def wall(monkeypatch: pytest.MonkeyPatch) -> Wall:
    made = Wall()
    monkeypatch.setattr(console, "err", Console(stderr=True, get_time=made))
    return made


def test_where_no_line_can_move_lines_come_now_and_then(
    wall: Wall, capsys: pytest.CaptureFixture[str]
) -> None:
    with console.steps(total=200.0) as show:
        show("reading")
        for second in range(100):
            wall.time_s += 1.0
            show(f"case {second}", second + 1.0)
        show("writing")
    printed = capsys.readouterr()
    lines = printed.err.splitlines()
    assert printed.out == ""
    assert (lines[0], lines[-1]) == ("reading", "writing (50 %, about 0:01:40 left)")
    assert lines[1:-1] == [
        f"case {s - 1} ({s / 2:.0f} %, about {(200 - s) // 60}:{(200 - s) % 60:02d} left)".replace(
            "about ", "about 0:0"
        )
        for s in range(20, 101, 20)
    ]


def test_the_time_left_counts_down_between_reports_and_is_never_negative(
    wall: Wall, capsys: pytest.CaptureFixture[str]
) -> None:
    with console.steps() as show:
        wall.time_s += 10.0
        show("first", 0.25)
        wall.time_s += 12.0
        show("second")
        wall.time_s += 60.0
        show("third")
    assert capsys.readouterr().err.splitlines() == [
        "first (25 %, about 0:00:30 left)",
        "second (25 %, about 0:00:18 left)",
        "third (25 %, about 0:00:00 left)",
    ]


def test_nothing_is_said_of_the_rest_too_early_and_what_is_done_stays_done(
    wall: Wall, capsys: pytest.CaptureFixture[str]
) -> None:
    with console.steps() as show:
        wall.time_s += 10.0
        show("begun", 1e-5)
        wall.time_s += 30.0
        show("half", 0.5)
        wall.time_s += 40.0
        show("back", 0.1)
    assert capsys.readouterr().err.splitlines() == [
        "begun",
        "half (50 %, about 0:00:40 left)",
        "back (50 %, about 0:01:20 left)",
    ]


def test_a_terminal_shows_the_time_left_in_its_moving_line(monkeypatch: pytest.MonkeyPatch) -> None:
    wall, screen = Wall(), io.StringIO()
    terminal = Console(file=screen, force_terminal=True, width=100, get_time=wall)
    monkeypatch.setattr(console, "err", terminal)
    with console.steps() as show:
        wall.time_s += 10.0
        show("working", 0.25)
    assert "about 0:00:30 left" in screen.getvalue()


def test_a_part_of_the_work_lies_between_its_shares_and_its_steps_can_be_had_alone() -> None:
    told: list[tuple[str, float | None]] = []
    steps: list[str] = []
    for show in (lambda text, done=None: told.append((text, done)), steps_of(steps.append)):
        part = part_of(show, 0.2, 0.6)
        part("begins")
        part("half", 0.5)
    assert told == [("begins", None), ("half", pytest.approx(0.4))]
    assert steps == ["begins"]


def shares_of(stages: list[str]) -> list[float]:
    told: list[float] = []
    outlook = Outlook(lambda text, done=None: told.append(done) if done is not None else None)
    for stage in stages:
        outlook.begin(stage, stage)
        if stage == "fit":
            list(outlook.counted(range(4), range(4)))
    return told


@given(st.integers(0, 8), st.integers(0, 3))
def test_the_share_of_a_diagnosis_never_falls_and_never_ends_early(found: int, replaced: int) -> None:
    look = ["screen", "fit", *["replace"] * replaced]
    shares = shares_of(["refit", "locate", *look * (found + 1), "settle", *["replace"] * replaced, "verify"])
    assert shares == sorted(shares)
    assert shares[0] >= 0.0 and shares[-1] < 1.0


def test_a_diagnosis_that_takes_the_expected_looks_is_told_evenly() -> None:
    shares = shares_of(["refit", "locate", *["screen", "fit"] * LOOKS, "settle", "verify"])
    assert shares[0] == 0.0
    assert shares[-1] == pytest.approx(1.0, abs=0.05)
    assert max(b - a for a, b in pairwise(shares)) < 0.25
