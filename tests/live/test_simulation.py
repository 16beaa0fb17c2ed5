"""A simulated robot behind the console: heard, commanded over the signed link, and closed cleanly."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import pytest

from flight import settings as flight_settings
from ground.live.shows import LiveShow
from ground.live.sources import ConsoleError, LinkSource, Simulation, SimulationPlan
from ground.mission_run import plan_mission
from hal.config import config_path, load_settings
from hal.errors import DeviceError
from hal.link.keys import Key
from hal.link.robot import LinkSettings

SETTINGS = flight_settings.load()


def wait(until: Callable[[], bool]) -> None:
    """Give the other thread time; the limit is against a test that hangs, it measures nothing."""
    for _ in range(1200):
        if until():
            return
        time.sleep(0.05)
    raise AssertionError("it did not come")


def test_a_simulation_is_heard_commanded_and_kept(tmp_path: Path) -> None:
    plan = plan_mission("quartz_sand", 1, 4.0, SETTINGS)
    show = LiveShow(Simulation(SimulationPlan(plan, tmp_path / "out", 1, 1000.0, 0.0)), SETTINGS)
    wait(lambda: show.content({})["phase"] not in ("", "power_up", "self_test"))
    with pytest.raises(ConsoleError, match="launch: not sent: it is not in the dictionary"):
        show.command("launch", {})
    show.command("reset", {})
    wait(lambda: any(a["words"].startswith("reset: refused in") for a in show.content({})["answers"]))
    kept = show.close()
    assert kept == f"kept: {tmp_path / 'out'} (log, recordings, report.html)"
    assert (tmp_path / "out" / "flight.mcap").is_file()
    content = show.content({})
    assert content["phase"] == "safe"
    assert content["reason"] in ("abort", "stowed")


class Gone:
    """A line that has been pulled."""

    def read(self, most: int) -> bytes:
        raise DeviceError("unplugged")

    def write(self, data: bytes) -> int:
        raise DeviceError("unplugged")

    def close(self) -> None:
        pass


def test_a_robot_that_is_not_heard_is_said_so() -> None:
    bounds = load_settings(config_path("link.yaml"), LinkSettings)
    source = LinkSource(Gone(), Key(bytes(32)), bounds, "robot")
    assert source.status().startswith("waiting for the robot")
    with pytest.raises(ConsoleError, match="arm: not sent: the robot has not been heard yet"):
        source.command("arm", ())
    assert source.poll() == []
    assert source.status() == "the link is lost: unplugged"
