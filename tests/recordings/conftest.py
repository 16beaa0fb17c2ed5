"""The flown mission, once for each process that runs tests."""

from __future__ import annotations

from pathlib import Path

import pytest
from flown_mission import fly_short_mission

from sim_hal.truth import HopTruth


@pytest.fixture(scope="session")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, HopTruth]:
    """The log of a short mission on the simulated robot, and the truth of its hop."""
    path = tmp_path_factory.mktemp("flown") / "flight.mcap"
    return path, fly_short_mission(path)[0]
