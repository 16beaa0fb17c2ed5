"""A folder of results appears whole or not at all."""

from __future__ import annotations

from pathlib import Path

import pytest

from ground.files import whole_folder
from hal.errors import ConfigError


def fill(path: Path, text: str) -> None:
    with whole_folder(path, "done.txt") as work:
        (work / "done.txt").write_text(text, encoding="utf-8")


def test_it_appears_at_the_end(tmp_path: Path) -> None:
    target = tmp_path / "a" / "b"
    with whole_folder(target, "done.txt") as work:
        (work / "done.txt").write_text("1", encoding="utf-8")
        assert not target.exists()
    assert (target / "done.txt").read_text(encoding="utf-8") == "1"


def test_an_earlier_result_is_replaced_as_a_whole(tmp_path: Path) -> None:
    fill(tmp_path / "out", "old")
    (tmp_path / "out" / "of_the_old_one.txt").touch()
    fill(tmp_path / "out", "new")
    assert [entry.name for entry in (tmp_path / "out").iterdir()] == ["done.txt"]
    assert (tmp_path / "out" / "done.txt").read_text(encoding="utf-8") == "new"
    assert [entry.name for entry in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_a_failure_keeps_the_earlier_result(tmp_path: Path, error: type[BaseException]) -> None:
    fill(tmp_path / "out", "old")
    with pytest.raises(error), whole_folder(tmp_path / "out", "done.txt") as work:
        (work / "half").touch()
        raise error
    assert [entry.name for entry in tmp_path.iterdir()] == ["out"]
    assert (tmp_path / "out" / "done.txt").read_text(encoding="utf-8") == "old"


@pytest.mark.parametrize("there", [(), ("a",), ("a", "b")])
def test_a_failure_leaves_no_folder_that_was_made_for_it(tmp_path: Path, there: tuple[str, ...]) -> None:
    """Folders that stood before stay, also empty ones."""
    tmp_path.joinpath(*there).mkdir(exist_ok=True, parents=True)
    with pytest.raises(RuntimeError), whole_folder(tmp_path / "a" / "b" / "out", "done.txt"):
        raise RuntimeError
    assert {path.name for path in tmp_path.rglob("*")} == set(there)


@pytest.mark.parametrize("kind", ["file", "foreign folder"])
def test_what_is_not_ours_is_refused(tmp_path: Path, kind: str) -> None:
    target = tmp_path / "out"
    if kind == "file":
        target.touch()
    else:
        target.mkdir()
        (target / "letters.txt").touch()
    with pytest.raises(ConfigError, match="holds something else"):
        fill(target, "new")
    assert [entry.name for entry in tmp_path.iterdir()] == ["out"]


def test_a_place_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match="cannot be written"):
        fill(tmp_path / "file" / "out", "new")
