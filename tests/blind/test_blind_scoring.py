"""How blind cases are counted: right names, lookalikes, shares of the excess, and resumed runs."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.blind import run as blind_run
from benchmarks.blind.cases import Hidden
from benchmarks.blind.scoring import paired, removed
from benchmarks.blind.table import MARK, Share, confusion, figures, judged, markdown, write_page
from ground.diagnose.result import Alternative, Finding


def finding(name: str, equation: str = "force_balance", rivals: tuple[str, ...] = ()) -> Finding:
    alternatives = tuple(Alternative(rival, 0.1) for rival in rivals)
    return Finding("physics", "whole_run", equation, (), (), "", name, 0.9, alternatives, "", "", {})


def hidden(name: str, equation: str = "force_balance") -> Hidden:
    return Hidden(name, "physics", equation, None, {}, {"position_m": 2.0}, 100.0, ())


def row(hidden_names: list[str], found: list[str], top1: float | None, number: int = 0) -> blind_run.Row:
    return {
        **{
            "case": f"axis-{number}",
            "kind": "axis",
            "number": number,
            "seed": 1,
            "code": "x",
            "seconds": 2.0,
        },
        "hidden": [{"physics_id": name, "visible": 3.0} for name in hidden_names],
        "findings": [{"physics_id": name} for name in found],
        "verdict": "mismatch" if found else "consistent",
        "judged": {
            "verdict": bool(found) == bool(hidden_names),
            **dict.fromkeys(("top1", "top1_or_alike", "top3", "phase", "equation"), top1),
            "brier": [[0.9, bool(top1)] for _ in found],
        },
        "removed": top1,
        "rivals": {
            name: {"right": True, "named": None if top1 is None else 0.0}
            for name in ("least squares", "sparse regression")
        },
    }


def test_a_finding_is_paired_by_name_before_rivals_and_equation() -> None:
    first, second = finding("viscous_friction", rivals=("coulomb_friction",)), finding("coulomb_friction")
    assert paired([hidden("coulomb_friction")], [first, second]) == [second]
    assert paired([hidden("coulomb_friction")], [first]) == [first]
    assert paired([hidden("backlash", "transmission")], [first]) == [first]
    assert paired([hidden("backlash"), hidden("coulomb_friction")], [second]) == [None, second]


@pytest.mark.parametrize(
    ("extended", "share"),
    [(1.0, 1.0), (3.0, 0.0), (2.0, 0.625), (10.0, -1.0), (float("inf"), -1.0)],
)
def test_the_excess_is_counted_in_squares_above_the_truths(extended: float, share: float) -> None:
    assert removed({"a": 3.0}, {"a": extended}, {"a": 1.0}) == pytest.approx(share)


def test_a_channel_that_was_right_must_stay_right() -> None:
    refit, oracle = {"a": 3.0, "b": 1.0}, {"a": 1.0, "b": 1.0}
    assert removed(refit, {"a": 1.0, "b": 1.0}, oracle) == 1.0
    spoilt = removed(refit, {"a": 1.0, "b": 2.0}, oracle)
    assert spoilt is not None
    assert spoilt < 0.7
    assert removed({"b": 1.0}, {"b": 1.0}, {"b": 1.0}) is None


def test_a_share_has_its_interval() -> None:
    low, high = Share(9, 10).interval
    assert (low, high) == pytest.approx((0.5958, 0.9821), abs=1e-4)


def test_a_crash_counts_as_wrong_and_bad_cases_stay_in_the_tables() -> None:
    rows = [
        row(["backlash"], ["backlash"], 1.0),
        row(["backlash"], ["string_creep"], 0.0, 1),
        row([], [], None, 2),
    ]
    crash = {
        k: v for k, v in row(["backlash"], [], 0.0, 3).items() if k not in ("judged", "findings", "rivals")
    }
    rows.append(crash | {"error": "ValueError: x"})
    assert judged(rows, "top1").value == pytest.approx(1 / 3)
    assert figures(rows)["blind_verdict_right"]["value"] == 0.75
    lines = {line[0]: line[1:] for line in confusion(rows)[1]}
    assert lines["backlash"] == ["3", "1", "string_creep 1, crash 1"]
    assert "string_creep 1" in markdown(rows)


def test_a_page_keeps_what_stands_above_its_mark(tmp_path: Path) -> None:
    page = tmp_path / "blind.md"
    page.write_text(f"# Title\n\nWords.\n\n{MARK}\n\nold figures\n", encoding="utf-8")
    write_page(page, [row(["backlash"], ["backlash"], 1.0)])
    text = page.read_text(encoding="utf-8")
    assert text.startswith("# Title\n\nWords.")
    assert "old figures" not in text
    assert "| backlash | 1 | 1 |" in text


def test_a_run_goes_on_where_it_was_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "rows.jsonl"
    file.write_text(json.dumps(row([], [], None)) + "\n" + '{"case": "axis-1", "ki', encoding="utf-8")
    done: list[blind_run.Task] = []

    def quick(task: blind_run.Task) -> blind_run.Row:
        done.append(task)
        return row([], [], None, task[1])

    monkeypatch.setattr(blind_run, "row_of", quick)
    rows = blind_run.run_all([("axis", 0, 1), ("axis", 1, 1)], file, 1, lambda _row: None)
    assert done == [("axis", 1, 1)]
    assert [r["number"] for r in rows] == [0, 1]
    assert len(list(blind_run.read_rows(file))) == 2
