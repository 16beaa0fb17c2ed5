"""A robot at the other end of a serial line, as the console meets it."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator

import pytest
from pseudo_terminal import StillClock, open_line

from flight import settings as flight_settings
from flight.states import Machine, Outputs, Phase, Snapshot
from flight.telemetry import Telemetry
from ground.live.sources import LinkSource
from ground.live.view import View
from hal.config import config_path, load_settings
from hal.link.keys import Key
from hal.link.robot import LinkSettings, RobotLink
from hal.link.streams import SerialLine

BOUNDS = load_settings(config_path("link.yaml"), LinkSettings)
KEY, OTHER = Key(bytes(range(32))), Key(bytes(32))


@pytest.fixture
def line() -> Iterator[tuple[RobotLink, str]]:
    far, near = open_line()
    robot = RobotLink(far, KEY, b"session1", StillClock(7.0), BOUNDS)
    yield robot, os.ttyname(near)
    robot.close()
    os.close(near)


def tell(robot: RobotLink) -> None:
    snap = Snapshot(time_s=7.0, motor_current_a=0.25)
    telemetry = Telemetry()
    telemetry.take(snap)
    message = telemetry.message(Machine(phase=Phase.HOLD), snap, Outputs(), flight_settings.load())
    robot.send("channels", json.dumps(message))


def test_a_robot_is_heard_and_commanded_over_a_serial_port(line: tuple[RobotLink, str]) -> None:
    robot, port = line
    source = LinkSource(SerialLine(port, BOUNDS.baud), KEY, BOUNDS, f"robot at {port}")
    assert source.status().startswith("waiting for the robot")
    tell(robot)
    view = View()
    for told in source.poll():
        view.take(told)
    assert (view.phase, view.time_s, view.channels["motor_current.current_a"]) == ("hold", 7.0, 0.25)
    assert source.status() == ""
    source.command("arm", ())
    (command,) = robot.receive()
    assert (command.name, command.authenticated) == ("arm", True)
    for told in source.poll():
        view.take(told)
    assert view.content()["answers"][-1]["words"] == "arm: received"
    source.close()


def test_with_another_key_nothing_is_heard(line: tuple[RobotLink, str]) -> None:
    robot, port = line
    source = LinkSource(SerialLine(port, BOUNDS.baud), OTHER, BOUNDS, "robot")
    tell(robot)
    assert source.poll() == []
    assert source.status().startswith("waiting for the robot: nothing signed with this key")
    source.close()
