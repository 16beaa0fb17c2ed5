"""`hopper command` over a serial line of the kernel (a pseudo-terminal), a robot's link at its other end."""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from hopper_command import done, hopper, refused
from pseudo_terminal import StillClock, open_line

from hal.config import config_path, load_settings
from hal.link.keys import load_key
from hal.link.robot import LinkSettings, RobotLink

BOUNDS = load_settings(config_path("link.yaml"), LinkSettings)


class Robot(threading.Thread):
    """Says its state, and answers commands as it is told to: with a refusal, an acceptance, or not at all."""

    def __init__(self, link: RobotLink, why: tuple[str, ...] | None) -> None:
        super().__init__(daemon=True)
        self.link, self._why = link, why
        self.got: list[tuple[str, tuple[tuple[str, float], ...]]] = []
        self.over = threading.Event()

    def run(self) -> None:
        while not self.over.wait(0.01):
            self.link.send("state", "{}")
            for command in self.link.receive():
                self.got.append((command.name, command.arguments))
                if self._why is not None:
                    name = "command_refused" if self._why else "command_accepted"
                    answer = {"name": name, "command": command.name, "why": self._why}
                    self.link.send("acknowledgement", json.dumps(answer))


@pytest.fixture
def line(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[tuple[Robot, tuple[str, ...]]]:
    """A robot that answers with the test's parameter, and the options that find it."""
    done("key", tmp_path / "link.key")
    far, near = open_line()
    key = load_key(tmp_path / "link.key")
    robot = Robot(RobotLink(far, key, b"session1", StillClock(), BOUNDS), request.param)
    robot.start()
    yield robot, ("--port", os.ttyname(near), "--key", str(tmp_path / "link.key"))
    robot.over.set()
    robot.join()
    robot.link.close()
    os.close(near)


Line = tuple[Robot, tuple[str, ...]]


@pytest.mark.parametrize("line", [()], indirect=True)
def test_a_command_that_the_robot_takes(line: Line) -> None:
    robot, options = line
    assert done("command", "tension", "energy_j=5", *options).splitlines() == [
        "tension: received",
        "tension: carried out",
    ]
    assert robot.got == [("tension", (("energy_j", 5.0),))]


@pytest.mark.parametrize("line", [("not armed",)], indirect=True)
def test_a_command_that_the_robot_refuses_ends_with_1_also_for_machines(line: Line) -> None:
    _, options = line
    result = hopper("command", "fire", *options, "--json")
    assert result.exit_code == 1
    found = json.loads(result.stdout)
    assert found["accepted"] is False
    assert [answer["name"] for answer in found["answers"]] == ["link", "command_refused"]
    assert found["answers"][1]["why"] == ["not armed"]


@pytest.mark.parametrize("line", [None], indirect=True)
def test_a_robot_that_says_nothing_is_told_with_what_the_link_did(line: Line) -> None:
    _, options = line
    message = refused("command", "ping", *options, "--wait-s", "0.3")
    assert message == "the link took the command, but the robot gave no answer within 0.3 s"


@pytest.mark.parametrize("line", [()], indirect=True)
def test_with_another_key_no_robot_is_heard(line: Line, tmp_path: Path) -> None:
    _, options = line
    done("key", tmp_path / "other.key")
    options = (*options[:2], "--key", str(tmp_path / "other.key"))
    assert refused("command", "ping", *options, "--wait-s", "0.2").startswith(
        "no robot with this key was heard"
    )
