"""One short mission, flown once by the command, and a folder of sound files to work in."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from desk_files import PLANT, SIDECAR, TABLE
from hopper_command import SHORT, done


@pytest.fixture(scope="session")
def printed_and_folder(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    """What the run printed, and its folder."""
    folder = tmp_path_factory.mktemp("short") / "flown"
    return done(*SHORT, "--out", folder), folder


@pytest.fixture(scope="session")
def printed(printed_and_folder: tuple[str, Path]) -> str:
    return printed_and_folder[0]


@pytest.fixture(scope="session")
def flown(printed_and_folder: tuple[str, Path]) -> Path:
    return printed_and_folder[1]


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder to work in, holding a sound recording and a sound plant, which a refused command must not change."""
    (tmp_path / "a.csv").write_text(TABLE, encoding="utf-8")
    (tmp_path / "a.yaml").write_text(SIDECAR, encoding="utf-8")
    (tmp_path / "cart.yaml").write_text(PLANT, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    assert not [path for path in tmp_path.rglob("*") if path.name.startswith(("out", ".out"))]
