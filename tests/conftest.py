"""What tests of several packages share: a short mission, flown once."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
from hypothesis import settings

os.environ.setdefault(
    "HOPPER_COMPILED", "0"
)  # tests replace parts of modules, which machine code would not see

from flight import settings as flight_settings
from ground.mission_run import plan_mission, run_mission

settings.register_profile("any machine", deadline=None)  # a busy one may be slow, which is no failure
settings.load_profile("any machine")

if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    # A shell starts what runs in the background deaf to Ctrl-C, and the commands under test would inherit that.
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def flown_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("console") / "mission"
    plan = plan_mission("quartz_sand", 1, 4.0, flight_settings.load())
    run_mission(plan, folder, seed=3)
    return folder / "flight.mcap"
