"""The link: commands arrive signed, once, in order, and not too many; everything else comes to nothing."""

from __future__ import annotations

import json
import logging
from pathlib import Path

import hypothesis.strategies as st
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings

from ground.station import GroundStation, acknowledgements
from hal.config import config_path, load_settings
from hal.dictionary import dictionary
from hal.errors import ConfigError, DeviceClosed
from hal.link.framing import Deframer, framed
from hal.link.keys import Key, load_key, make_key
from hal.link.messages import Command, encode_command
from hal.link.packets import BadPacket, SpacePacket
from hal.link.robot import LinkSettings, RobotLink
from hal.link.streams import LoopbackEnd, loopback
from hal.readings import GroundCommand

SETTINGS = load_settings(config_path("link.yaml"), LinkSettings)
KEY, OTHER = Key(bytes(range(32))), Key(bytes(32))
SESSION = b"session1"


class Clock:
    def __init__(self) -> None:
        self.time_s = 0.0

    def now_s(self) -> float:
        return self.time_s

    def sleep_until_s(self, time_s: float) -> None:
        self.time_s = time_s


class Pair:
    """Both ends of a line, which has heard each other."""

    def __init__(self, depth: int = 65536) -> None:
        self.clock = Clock()
        self.far, near = loopback(depth)
        self.robot = RobotLink(near, KEY, SESSION, self.clock, SETTINGS)
        self.ground = GroundStation(self.far, KEY, SETTINGS.longest_packet_bytes)
        self.robot.send("state", "{}")
        self.ground.poll()

    def raw(self, data: bytes) -> tuple[GroundCommand, ...]:
        self.far.write(data)
        return self.robot.receive()


def frame(sequence: int, name: str = "fire", key: Key = KEY, session: bytes = SESSION) -> bytes:
    return framed(encode_command(Command(sequence, name), session, key))


def test_a_command_arrives_as_it_was_sent_and_is_acknowledged() -> None:
    pair = Pair()
    pair.ground.command("tension", (("energy_j", 12.5),))
    (command,) = pair.robot.receive()
    assert (command.name, command.arguments) == ("tension", (("energy_j", 12.5),))
    assert command.authenticated
    (answer,) = acknowledgements(pair.ground.poll())
    assert (answer["command"], answer["sequence"], answer["why"]) == ("tension", command.sequence, "")


def test_forged_commands_come_to_nothing_and_get_no_answer() -> None:
    pair = Pair()
    assert pair.raw(frame(1, key=OTHER)) == ()
    assert pair.raw(frame(1, session=b"another1")) == ()
    telemetry = framed(SpacePacket(False, 0x48, 1, b"x" * 40).encode())
    assert pair.raw(telemetry) == ()
    assert pair.robot.refused == 3
    assert pair.ground.poll() == []


def test_replayed_and_reordered_commands_are_refused_with_the_reason() -> None:
    pair = Pair()
    old, new = frame(1), frame(2)
    assert len(pair.raw(new)) == 1
    assert pair.raw(new) == ()
    assert pair.raw(old) == ()
    whys = [answer["why"] for answer in acknowledgements(pair.ground.poll())]
    assert whys == ["", "sequence 2 is not after 2", "sequence 1 is not after 2"]


def test_a_command_of_an_earlier_life_of_the_robot_is_refused() -> None:
    pair = Pair()
    recorded = pair.ground.command("fire")
    assert len(pair.robot.receive()) == 1
    far, near = loopback()
    reborn = RobotLink(near, KEY, b"session2", pair.clock, SETTINGS)
    far.write(recorded)
    assert reborn.receive() == ()


def test_a_cut_frame_costs_itself_alone() -> None:
    for cut in range(1, len(frame(1)) - 1):
        pair = Pair()
        assert pair.raw(frame(1)[:cut]) == ()
        got = pair.raw(b"\0" + frame(2))
        assert [command.sequence for command in got] == [2]


def test_a_flood_of_good_commands_is_limited_and_recovers() -> None:
    pair = Pair()
    accepted = []
    for sequence in range(1, 201):
        accepted += pair.raw(frame(sequence, "ping"))
    assert len(accepted) == SETTINGS.burst
    assert "too many commands" in {a["why"] for a in acknowledgements(pair.ground.poll())}
    pair.clock.time_s += 1.0
    assert len(pair.raw(frame(201, "ping"))) == 1


def test_memory_stays_bounded_under_a_flood_and_with_a_line_that_takes_nothing() -> None:
    pair = Pair(depth=100_000)
    for _ in range(50):
        pair.raw(b"\x01" * 2048)
    assert pair.robot.held_bytes <= SETTINGS.longest_packet_bytes + 30
    stuck = Pair(depth=200)
    for _ in range(2000):
        stuck.robot.send("event", json.dumps({"text": "x" * 200}))
    assert stuck.robot.held_bytes <= SETTINGS.waiting_bytes
    assert stuck.robot.dropped > 0


def test_a_long_message_is_cut_into_what_the_line_takes_and_arrives_whole() -> None:
    pair = Pair(depth=64)
    text = json.dumps({"text": "y" * 1500})
    pair.robot.send("hop", text)
    got = []
    for _ in range(100):
        got += pair.ground.poll()
        pair.robot.receive()
    assert [message.text for message in got] == [text]


def test_a_closed_link_is_closed() -> None:
    pair = Pair()
    pair.robot.close()
    pair.robot.close()
    with pytest.raises(DeviceClosed):
        pair.robot.receive()


@given(data=st.binary(min_size=0, max_size=2000), pieces=st.integers(1, 50))
@hypothesis_settings(max_examples=100, deadline=None)
def test_any_packet_survives_framing_however_it_is_cut_into_pieces(data: bytes, pieces: int) -> None:
    deframer = Deframer(4096)
    sent = framed(data + b"!") + framed(b"second")
    step = max(1, len(sent) // pieces)
    got = [p for at in range(0, len(sent), step) for p in deframer.feed(sent[at : at + step])]
    assert got == [data + b"!", b"second"]


@given(noise=st.binary(max_size=600))
@hypothesis_settings(max_examples=200, deadline=None)
def test_noise_is_never_a_command(noise: bytes) -> None:
    pair = Pair()
    assert pair.raw(noise + b"\0") == ()
    assert len(pair.raw(b"\0" + frame(1))) == 1


def test_packets_are_those_of_the_standard() -> None:
    packet = SpacePacket(True, 0x48, 77, b"abc")
    assert packet.encode() == bytes([0x10, 0x48, 0xC0, 77, 0, 2]) + b"abc"
    assert SpacePacket.decode(packet.encode()) == packet
    spacepackets = pytest.importorskip("spacepackets.ccsds.spacepacket")
    header = spacepackets.SpacePacketHeader(
        packet_type=spacepackets.PacketType.TC, apid=0x48, seq_count=77, data_len=2
    )
    assert bytes(header.pack()) == packet.encode()[:6]


@pytest.mark.parametrize("at", range(9))
def test_a_packet_with_a_wrong_header_is_refused(at: int) -> None:
    good = SpacePacket(True, 0x48, 1, b"abc").encode()
    bad = {0: 0x30, 2: 0x00, 4: 1, 5: 9}.get(at)
    if bad is None:
        with pytest.raises(BadPacket):
            SpacePacket.decode(good[: at % 7])
    else:
        with pytest.raises(BadPacket):
            SpacePacket.decode(good[:at] + bytes([bad]) + good[at + 1 :])


def test_keys_with_loose_permissions_or_no_content_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "link.key"
    make_key(path)
    assert load_key(path).secret != bytes(32)
    with pytest.raises(ConfigError, match="cannot be written"):
        make_key(path)
    for mode in (0o640, 0o604, 0o620, 0o666):
        path.chmod(mode)
        with pytest.raises(ConfigError, match=f"permissions {mode:04o}"):
            load_key(path)
    path.chmod(0o600)
    path.write_text("not a key", encoding="ascii")
    with pytest.raises(ConfigError, match="is no key"):
        load_key(path)
    path.write_text("00ff", encoding="ascii")
    with pytest.raises(ConfigError, match="a key of 2 bytes"):
        load_key(path)


def test_a_key_does_not_show_itself(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.DEBUG):
        logging.getLogger().warning("%s %r", KEY, KEY)
    assert KEY.secret.hex() not in caplog.text
    assert repr(KEY.secret) not in caplog.text
    assert str(KEY) == "Key(...)"


def test_numbers_of_commands_on_the_link_are_those_of_the_dictionary() -> None:
    for name in dictionary().commands:
        pair = Pair()
        pair.ground.command(name)
        assert [command.name for command in pair.robot.receive()] == [name]


def test_the_ends_of_a_line_are_two() -> None:
    end = LoopbackEnd(10)
    assert end.write(b"nobody") == 0


def test_a_robot_is_commanded_over_the_whole_way_to_its_safe_state() -> None:
    """From a signed frame through the link and the executive to the acknowledgement on the ground."""
    from dataclasses import replace

    from flight import settings as flight_settings
    from flight.executive import fly
    from flight.mission import HopPlan, MissionPlan
    from hal.board import open_board
    from hal.config import read_yaml
    from hal.log import MemoryLog

    far, near = loopback(1 << 22)
    with open_board("sim", read_yaml(config_path("boards", "sim.yaml"))) as opened:
        board = replace(opened, ground_link=RobotLink(near, KEY, SESSION, opened.clock, SETTINGS))
        ground = GroundStation(far, KEY, SETTINGS.longest_packet_bytes)
        answers: list[dict[str, object]] = []
        sent: list[str] = []

        def operate(progress: object) -> None:
            answers.extend(acknowledgements(ground.poll()))
            now_s = board.clock.now_s()
            for at_s, name in ((0.5, "fire"), (1.0, "ping"), (1.5, "abort")):
                if now_s >= at_s and name not in sent:
                    sent.append(name)
                    ground.command(name)

        plan = MissionPlan("m", (HopPlan(1.0, "steel"),))
        result = fly(board, flight_settings.load(), plan, MemoryLog(), operate)
        answers.extend(acknowledgements(ground.poll()))
    assert result.end_reason == "abort"
    told = [(a["name"], a["command"]) for a in answers if a["name"] != "link" and a["sequence"]]
    assert told == [("command_refused", "fire"), ("command_accepted", "ping"), ("command_accepted", "abort")]
