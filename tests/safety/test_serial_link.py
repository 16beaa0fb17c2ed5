"""The link over a real serial device of the kernel (a pseudo-terminal): there and back, full, and gone."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from types import FrameType

import pytest
from pseudo_terminal import FarEnd, StillClock, open_line

from ground.station import GroundStation, acknowledgements
from hal.config import config_path, load_settings
from hal.errors import BoardUnavailable, DeviceError
from hal.link.keys import Key
from hal.link.robot import LinkSettings, RobotLink
from hal.link.streams import SerialLine

SETTINGS = load_settings(config_path("link.yaml"), LinkSettings)
KEY = Key(bytes(range(32)))


@pytest.fixture
def ends() -> Iterator[tuple[SerialLine, FarEnd]]:
    def hangs(number: int, frame: FrameType | None) -> None:
        raise AssertionError("the line makes the tick wait")

    far, near = open_line()
    signal.signal(signal.SIGALRM, hangs)
    signal.alarm(20)
    line = SerialLine(os.ttyname(near), SETTINGS.baud)
    os.close(near)
    yield line, far
    signal.alarm(0)
    line.close()


def test_commands_and_acknowledgements_cross_a_serial_line(ends: tuple[SerialLine, FarEnd]) -> None:
    line, far = ends
    robot = RobotLink(line, KEY, b"session1", StillClock(), SETTINGS)
    ground = GroundStation(far, KEY, SETTINGS.longest_packet_bytes)
    robot.send("state", "{}")
    ground.poll()
    ground.command("tension", (("energy_j", 3.0),))
    (command,) = robot.receive()
    assert (command.name, command.arguments) == ("tension", (("energy_j", 3.0),))
    assert [answer["why"] for answer in acknowledgements(ground.poll())] == [""]
    far.close()


def test_a_line_that_nobody_reads_neither_waits_nor_grows(ends: tuple[SerialLine, FarEnd]) -> None:
    line, far = ends
    robot = RobotLink(line, KEY, b"session1", StillClock(), SETTINGS)
    for _ in range(200):
        robot.send("hop", "x" * 1000)
    assert robot.dropped > 0
    assert robot.held_bytes <= SETTINGS.waiting_bytes
    assert line.write(b"more") == 0
    far.close()


def test_a_line_that_is_gone_is_a_ground_that_is_silent(ends: tuple[SerialLine, FarEnd]) -> None:
    line, far = ends
    robot = RobotLink(line, KEY, b"session1", StillClock(), SETTINGS)
    far.close()
    with pytest.raises(DeviceError):
        line.read(10)
    with pytest.raises(DeviceError):
        line.write(b"anybody?")
    robot.send("hop", "{}")
    assert robot.receive() == ()


def test_a_port_that_is_not_there_is_named() -> None:
    with pytest.raises(BoardUnavailable, match=r"/dev/no-such-port: the serial line cannot be opened"):
        SerialLine("/dev/no-such-port", SETTINGS.baud)
