"""The link over a real serial device of the kernel (a pseudo-terminal): there and back, full, and gone."""

from __future__ import annotations

import os
import signal
import tty
from collections.abc import Iterator
from types import FrameType

import pytest

from ground.station import GroundStation, acknowledgements
from hal.config import config_path, load_settings
from hal.errors import BoardUnavailable, DeviceError
from hal.link.keys import Key
from hal.link.robot import LinkSettings, RobotLink
from hal.link.streams import SerialLine

SETTINGS = load_settings(config_path("link.yaml"), LinkSettings)
KEY = Key(bytes(range(32)))


class Clock:
    def now_s(self) -> float:
        return 1.0

    def sleep_until_s(self, time_s: float) -> None:
        raise AssertionError("the link never waits")


class Far:
    """The other end of the line."""

    def __init__(self, handle: int) -> None:
        self.handle = handle
        os.set_blocking(handle, False)

    def read(self, most: int) -> bytes:
        try:
            return os.read(self.handle, most)
        except BlockingIOError:
            return b""

    def write(self, data: bytes) -> int:
        return os.write(self.handle, data)

    def close(self) -> None:
        os.close(self.handle)


@pytest.fixture
def ends() -> Iterator[tuple[SerialLine, Far]]:
    def hangs(number: int, frame: FrameType | None) -> None:
        raise AssertionError("the line makes the tick wait")

    far, near = os.openpty()
    tty.setraw(near)
    signal.signal(signal.SIGALRM, hangs)
    signal.alarm(20)
    line = SerialLine(os.ttyname(near), SETTINGS.baud)
    os.close(near)
    yield line, Far(far)
    signal.alarm(0)
    line.close()


def test_commands_and_acknowledgements_cross_a_serial_line(ends: tuple[SerialLine, Far]) -> None:
    line, far = ends
    robot = RobotLink(line, KEY, b"session1", Clock(), SETTINGS)
    ground = GroundStation(far, KEY, SETTINGS.longest_packet_bytes)
    robot.send("state", "{}")
    ground.poll()
    ground.command("tension", (("energy_j", 3.0),))
    (command,) = robot.receive()
    assert (command.name, command.arguments) == ("tension", (("energy_j", 3.0),))
    assert [answer["why"] for answer in acknowledgements(ground.poll())] == [""]
    far.close()


def test_a_line_that_nobody_reads_neither_waits_nor_grows(ends: tuple[SerialLine, Far]) -> None:
    line, far = ends
    robot = RobotLink(line, KEY, b"session1", Clock(), SETTINGS)
    for _ in range(200):
        robot.send("hop", "x" * 1000)
    assert robot.dropped > 0
    assert robot.held_bytes <= SETTINGS.waiting_bytes
    assert line.write(b"more") == 0
    far.close()


def test_a_line_that_is_gone_is_a_ground_that_is_silent(ends: tuple[SerialLine, Far]) -> None:
    line, far = ends
    robot = RobotLink(line, KEY, b"session1", Clock(), SETTINGS)
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
