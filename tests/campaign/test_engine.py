"""The engine of campaigns: the same rows whoever does the work; nothing lost, nothing doubled."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sums import Sums, quiet

from ground.campaign import engine, store
from ground.campaign.crews import DIED, OneProcess, crew
from ground.campaign.engine import run_study
from ground.campaign.study import FAILED, INDEX, stamp_of
from hal.errors import ConfigError

HERE = Path(__file__).resolve().parent
SCRIPT = """
import sys
from pathlib import Path
from sums import Sums, quiet
from ground.campaign.crews import crew
from ground.campaign.engine import run_study

if __name__ == "__main__":
    with crew(int(sys.argv[2]), None) as workers:
        run_study(Sums(5, wait_s=0.02), 400, Path(sys.argv[1]), workers, quiet)
"""


def alone(study: Sums, wanted: float, folder: Path) -> engine.StudyResult:
    return run_study(study, wanted, folder, OneProcess(), quiet)


def test_rows_are_those_of_the_first_cases_and_failures_are_kept_with_their_reason(tmp_path: Path) -> None:
    result = alone(Sums(1), 20, tmp_path)
    assert [row[INDEX] for row in (*result.rows, *result.failed)] == [*range(7), *range(8, 21), 7]
    assert result.failed[0][FAILED] == "ValueError: seven cannot be done"
    assert result.throughput.cases == 21
    assert alone(Sums(1), 20, tmp_path / "b").rows == result.rows
    assert alone(Sums(2), 20, tmp_path / "c").rows != result.rows


def test_processes_give_the_same_as_one_even_when_one_of_them_dies(tmp_path: Path) -> None:
    expected = alone(Sums(1), 30, tmp_path / "alone")
    study = Sums(1, killed_once=11, trace=str(tmp_path / "trace"))
    with crew(2, None) as workers:
        result = run_study(study, 30, tmp_path / "many", workers, quiet)
    assert (tmp_path / "trace.11.killed").exists()
    assert (result.rows, result.failed) == (expected.rows, expected.failed)
    assert "by 2 workers" in result.throughput.text


def test_a_case_that_kills_every_process_fails_alone(tmp_path: Path) -> None:
    study = Sums(1, deadly=3, trace=str(tmp_path / "trace"))
    with crew(2, None) as workers:
        result = run_study(study, 12, tmp_path / "many", workers, quiet)
    assert {row[INDEX]: row[FAILED] for row in result.failed} == {
        3: DIED,
        7: "ValueError: seven cannot be done",
    }
    assert len(result.rows) == 12


@pytest.mark.parametrize("processes", [1, 2])
def test_a_campaign_that_is_killed_goes_on_and_loses_and_doubles_nothing(
    processes: int, tmp_path: Path
) -> None:
    script, folder = tmp_path / "run.py", tmp_path / "kept"
    script.write_text(SCRIPT, encoding="utf-8")
    paths = os.pathsep.join((str(HERE), str(HERE.parents[1])))
    command = [sys.executable, str(script), str(folder), str(processes)]
    running = subprocess.Popen(command, env={**os.environ, "PYTHONPATH": paths})
    try:
        for _ in range(1000):  # until it is past the first part and in the middle of a second one
            time.sleep(0.02)
            if len(store.read_rows(folder)) > store.PART_ROWS + 5:  # each row counted once
                break
    finally:
        running.send_signal(signal.SIGKILL)
        running.wait()
    kept = store.read_rows(folder)
    assert store.PART_ROWS < len(kept) < 400
    study = Sums(5, wait_s=0.02)
    rest = replace(study, trace=str(tmp_path / "trace"))
    expected = alone(Sums(5), 300, tmp_path / "alone")
    result = alone(rest, 300, folder)
    assert (result.rows, result.failed) == (expected.rows, expected.failed)
    again = {int(line.split()[1]) for line in (tmp_path / "trace").read_text().splitlines()}
    assert not again & kept.keys()
    in_parts = [row[INDEX] for row in store.part_rows_of(folder)]
    assert len(in_parts) == len(set(in_parts))
    assert in_parts and not list(store.journal_rows(folder))


def test_a_kill_between_the_part_and_the_emptied_journal_doubles_nothing(tmp_path: Path) -> None:
    study = Sums(1)
    result = alone(study, 10, tmp_path)
    rows = "".join(json.dumps(row) + "\n" for row in result.rows[:4])
    (tmp_path / store.JOURNAL_NAME).write_text(rows + '{"index": 99, "fai', encoding="utf-8")
    again = alone(study, 10, tmp_path)
    assert (again.rows, again.failed) == (result.rows, result.failed)
    assert again.throughput.text == "all cases were there already"
    assert len(store.read_rows(tmp_path)) == 11


def test_the_result_does_not_depend_on_what_ended_first(tmp_path: Path) -> None:
    expected = alone(Sums(3), 9, tmp_path / "alone")
    rows = {index: engine.replay(Sums(3), index)[0] for index in reversed(range(40))}
    with store.opened(tmp_path / "late", stamp_of(Sums(3)), Sums(3).schema()) as kept:
        for row in rows.values():
            kept.add(row)
    late = alone(Sums(3), 9, tmp_path / "late")
    assert (late.rows, late.failed) == (expected.rows, expected.failed)


@pytest.mark.parametrize(
    ("study", "key"), [(Sums(2), "seed"), (Sums(1, weight=2.0), "settings"), (Sums(1, name="other"), "study")]
)
def test_another_campaigns_folder_is_refused(study: Sums, key: str, tmp_path: Path) -> None:
    alone(Sums(1), 3, tmp_path)
    with pytest.raises(ConfigError, match=f"campaign.json: is of other {key}"):
        alone(study, 3, tmp_path)


def test_two_campaigns_in_one_folder_are_refused(tmp_path: Path) -> None:
    with (
        store.opened(tmp_path, stamp_of(Sums(1)), Sums(1).schema()),
        pytest.raises(ConfigError, match="another campaign is writing here"),
    ):
        alone(Sums(1), 3, tmp_path)


def test_broken_files_are_refused_by_name(tmp_path: Path) -> None:
    alone(Sums(1), 3, tmp_path)
    (tmp_path / "part-00000.parquet").write_bytes(b"PAR1 no")
    with pytest.raises(ConfigError, match=r"part-00000\.parquet: cannot be read as Parquet"):
        alone(Sums(1), 3, tmp_path)
    (tmp_path / store.STAMP_NAME).write_text("[]")
    with pytest.raises(ConfigError, match=r"campaign\.json: is not the file of a campaign"):
        alone(Sums(1), 3, tmp_path)


def test_a_campaign_in_which_everything_fails_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Sums, "run", lambda self, index: 1 / 0)
    with pytest.raises(ConfigError, match="20 cases failed one after the other, the last: ZeroDivisionError"):
        alone(Sums(1), 3, tmp_path)
    assert len(store.read_rows(tmp_path)) == engine.MOST_FAILURES


def test_a_replay_is_the_row_that_was_kept_and_tells_where_it_failed(tmp_path: Path) -> None:
    result = alone(Sums(1), 20, tmp_path)
    assert engine.replay(Sums(1), 3) == (result.rows[3], "")
    row, error = engine.replay(Sums(1), 7)
    assert row == result.failed[0]
    assert "in run\n" in error


@settings(max_examples=30, deadline=None)
@given(st.lists(st.integers(0, 30), unique=True, max_size=25), st.integers(1, 7), st.data())
def test_whatever_is_kept_in_whatever_order_is_read_once(
    indices: list[int], part_rows: int, data: st.DataObject
) -> None:
    import tempfile

    study = Sums(1)
    rows = {index: engine.replay(study, index)[0] for index in indices}
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        cut = data.draw(st.integers(0, len(indices)))
        for some in (indices[:cut], indices[cut:]):
            with store.opened(folder, stamp_of(study), study.schema(), part_rows) as kept:
                for index in some:
                    kept.add(rows[index])
        assert store.read_rows(folder) == dict(sorted(rows.items()))
        with store.opened(folder, stamp_of(study), study.schema()) as kept:
            assert kept.rows.keys() == rows.keys()
            for index in indices[:1]:
                with pytest.raises(ValueError, match=f"case {index} is kept already"):
                    kept.add(rows[index])
