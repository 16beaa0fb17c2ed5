"""A whole simulated mission's telemetry, as its bytes lay on the line, decoded by an XTCE reader that is not ours."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest

from flight import settings as flight_settings
from ground.mission_run import plan_mission, run_mission
from ground.xtce import parameter_name, write_xtce
from hal.board import Board
from hal.config import config_path, load_settings
from hal.dictionary import dictionary
from hal.link.framing import Deframer
from hal.link.keys import Key
from hal.link.robot import LinkSettings, RobotLink

reader = pytest.importorskip(
    "space_packet_parser", reason="space-packet-parser is not installed (extra 'dev')"
)
KEY, SESSION = Key(bytes(range(32))), b"session7"
BOUNDS = load_settings(config_path("link.yaml"), LinkSettings)


class Line:
    """A serial line that keeps what the robot writes, and on which the ground is silent."""

    def __init__(self) -> None:
        self.written = bytearray()

    def read(self, most: int) -> bytes:
        return b""

    def write(self, data: bytes) -> int:
        self.written += data
        return len(data)

    def close(self) -> None:
        """Nothing to give back."""


class KeptLink(RobotLink):
    """A link that remembers what the flight software gave it to send."""

    sent: list[tuple[str, str]]

    def send(self, topic: str, payload: str) -> None:
        self.sent.append((topic, payload))
        super().send(topic, payload)


@pytest.fixture(scope="module")
def mission(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, list[tuple[str, str]]]:
    """The bytes that a hop of 1 J put on the line, and the messages that were meant."""
    line, sent = Line(), list[tuple[str, str]]()

    def fitted(board: Board) -> Board:
        link = KeptLink(line, KEY, SESSION, board.clock, BOUNDS)
        link.sent = sent
        return replace(board, ground_link=link)

    plan = plan_mission("quartz_sand", 1, 1.0, flight_settings.load(), references=0)
    run_mission(plan, tmp_path_factory.mktemp("xtce") / "flown", seed=5, fitted=fitted)
    return bytes(line.written), sent


@pytest.fixture(scope="module")
def decoded(
    mission: tuple[bytes, list[tuple[str, str]]], tmp_path_factory: pytest.TempPathFactory
) -> list[dict[str, Any]]:
    """Every packet of the line by the exported description, the stream of packets cut apart by the reader itself."""
    path = write_xtce(dictionary(), tmp_path_factory.mktemp("xtce") / "hopper.xml")
    definition = reader.xtce.definitions.XtcePacketDefinition.from_xtce(path, root_container_name="packet")
    stream = b"".join(Deframer(BOUNDS.longest_packet_bytes).feed(mission[0]))
    return [dict(definition.parse_bytes(packet)) for packet in reader.ccsds_generator(io.BytesIO(stream))]


def test_every_message_arrives_in_order_with_its_topic_and_session(
    mission: tuple[bytes, list[tuple[str, str]]], decoded: list[dict[str, Any]]
) -> None:
    sent = mission[1]
    assert [str(packet["topic"]) for packet in decoded] == [topic for topic, _ in sent]
    assert [int(packet["sequence_count"]) for packet in decoded] == [
        n % 2**14 for n in range(1, len(sent) + 1)
    ]
    assert {bytes(packet["session"]) for packet in decoded} == {SESSION}
    assert {topic for topic, _ in sent} >= {"channels", "state", "hop", "event"}


def test_every_text_is_the_one_that_was_sent(
    mission: tuple[bytes, list[tuple[str, str]]], decoded: list[dict[str, Any]]
) -> None:
    pairs = [
        (text, packet)
        for (topic, text), packet in zip(mission[1], decoded, strict=True)
        if topic != "channels"
    ]
    assert len(pairs) > 5
    for text, packet in pairs:
        assert packet["text"] == text


def channels_of(
    mission: tuple[bytes, list[tuple[str, str]]], decoded: list[dict[str, Any]]
) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    for (topic, text), packet in zip(mission[1], decoded, strict=True):
        if topic == "channels":
            yield json.loads(text), packet


def test_every_channel_of_the_mission_has_the_value_that_was_sent(
    mission: tuple[bytes, list[tuple[str, str]]], decoded: list[dict[str, Any]]
) -> None:
    pairs = list(channels_of(mission, decoded))
    assert len(pairs) > 30
    moved = set()
    for sent, got in pairs:
        assert (got["time_s"], got["phase"], got["hop_index"]) == (
            sent["time_s"],
            sent["phase"],
            sent["hop_index"],
        )
        for channel in dictionary().channels:
            value, found = sent[channel], got[parameter_name(channel)]
            if value is None:
                assert math.isnan(found), channel
            else:
                number = float(found == "yes" if isinstance(found, str) else found)
                assert math.isclose(number, value, rel_tol=1e-6, abs_tol=1e-30), channel
                moved |= {channel} if value else set()
    assert {sent["phase"] for sent, _ in pairs} >= {"homing", "tensioning", "armed", "de_tension"}
    assert len(moved) > len(dictionary().channels) / 2  # zeros alone would compare nothing
