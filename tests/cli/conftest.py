"""One short mission, flown once by the command, for all tests that need its files."""

from __future__ import annotations

from pathlib import Path

import pytest
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
