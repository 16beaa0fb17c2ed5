"""The on-board log: exact, ordered, readable after a cut, and readable by the container's own reader."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from log_fakes import ScriptedRig, fly_toy
from mcap.reader import make_reader

from flight.log import METADATA_NAME, McapLog, read_log
from hal.log import LogError, MemoryLog
from hal.replay import ReplayBoard
from hal.tap import tap_board

METADATA = {"settings": "tick_rate_hz: 200\n", "mission": "hops: 1\n", "board": "scripted", "seed": "1"}

exact_json = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=10,
)


def flown_log(path: Path, ticks: int = 40) -> MemoryLog:
    """Fly the toy on a file and keep the messages in memory too."""
    memory = MemoryLog()
    with McapLog(path, METADATA) as log:

        class Both:
            def write(self, topic: str, time_s: float, payload: dict[str, object]) -> None:
                memory.write(topic, time_s, payload)
                log.write(topic, time_s, payload)

        fly_toy(tap_board(ScriptedRig().board(), Both()), Both(), ticks)  # type: ignore[arg-type]
    return memory


def as_json(value: object) -> object:
    return json.loads(json.dumps(value))


def test_what_is_read_is_what_was_written(tmp_path: Path) -> None:
    memory = flown_log(tmp_path / "a.mcap")
    log = read_log(tmp_path / "a.mcap")
    assert log.metadata == METADATA
    assert log.damage == ""
    assert [(m.sequence, m.topic, m.time_s, m.payload) for m in log.messages] == [
        (m.sequence, m.topic, m.time_s, as_json(m.payload)) for m in memory.messages
    ]


def test_a_flight_replays_from_its_file(tmp_path: Path) -> None:
    flown_log(tmp_path / "a.mcap")
    board = ReplayBoard.of(read_log(tmp_path / "a.mcap").messages)
    fly_toy(board, board.tape)
    assert not board.tape.remaining


names = st.text().filter(lambda name: name != "log_time_s")


@given(payload=st.dictionaries(names, exact_json, max_size=5), time_s=st.floats(0.0, 1e8))
@hypothesis_settings(deadline=None)
def test_every_json_value_comes_back_exactly(
    tmp_path_factory: pytest.TempPathFactory, payload: dict[str, object], time_s: float
) -> None:
    path = tmp_path_factory.mktemp("log") / "a.mcap"
    with McapLog(path, {}) as log:
        log.write("state", time_s, payload)
    message = read_log(path).messages[0]
    assert repr(message.payload) == repr(payload)  # repr tells -0.0 from 0.0 and 1 from 1.0
    assert message.time_s == time_s


@pytest.mark.parametrize("bad", [math.nan, math.inf, {1, 2}, object(), b"bytes"])
def test_what_json_cannot_keep_is_refused_by_topic(tmp_path: Path, bad: object) -> None:
    with McapLog(tmp_path / "a.mcap", {}) as log:
        log.write("state", 0.0, {"name": "READY"})
        with pytest.raises(LogError, match=r"message 1 \(motor\)"):
            log.write("motor", 0.0, {"deep": [{"x": bad}]})
        log.write("state", 0.1, {"name": "HOLD"})
    names = [message.payload["name"] for message in read_log(tmp_path / "a.mcap").messages]
    assert names == ["READY", "HOLD"]


@pytest.mark.parametrize("time_s", [-0.1, math.nan, math.inf, 1e10])
def test_a_time_that_is_none_is_refused(tmp_path: Path, time_s: float) -> None:
    with McapLog(tmp_path / "a.mcap", {}) as log, pytest.raises(LogError, match="message 0"):
        log.write("state", time_s, {})


def test_the_logs_own_field_is_refused(tmp_path: Path) -> None:
    with McapLog(tmp_path / "a.mcap", {}) as log, pytest.raises(LogError, match="own field"):
        log.write("state", 0.0, {"log_time_s": 1.0})


def test_a_log_is_never_overwritten(tmp_path: Path) -> None:
    flown_log(tmp_path / "a.mcap", ticks=1)
    with pytest.raises(LogError, match=r"a\.mcap: exists already"):
        McapLog(tmp_path / "a.mcap", {})
    with pytest.raises(LogError, match="cannot be created"):
        McapLog(tmp_path / "no" / "a.mcap", {})


def test_the_containers_own_reader_finds_topics_schemas_and_metadata(tmp_path: Path) -> None:
    memory = flown_log(tmp_path / "a.mcap")
    with (tmp_path / "a.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == len(memory.messages)
        assert {record.name: record.metadata for record in reader.iter_metadata()} == {
            METADATA_NAME: METADATA
        }
        schema, _, message = next(iter(reader.iter_messages(topics=["motor_current"])))
    assert schema is not None
    assert schema.encoding == "jsonschema"
    described = json.loads(schema.data)["properties"]
    assert described["result"]["properties"]["current_a"] == {"type": "number", "description": "A"}
    content = json.loads(message.data)
    assert set(content) <= set(described) | {"error"}
    assert message.log_time == round(content["log_time_s"] * 1e9)


def test_a_cut_log_is_refused_and_its_whole_part_recovered(tmp_path: Path) -> None:
    memory = flown_log(tmp_path / "a.mcap", ticks=400)
    whole = (tmp_path / "a.mcap").read_bytes()
    recovered = []
    for keep in range(len(whole) - 1, 360, -len(whole) // 40):
        (tmp_path / "cut.mcap").write_bytes(whole[:keep])
        with pytest.raises(LogError, match=r"cut\.mcap: .* byte \d+"):
            read_log(tmp_path / "cut.mcap")
        log = read_log(tmp_path / "cut.mcap", recover=True)
        assert log.damage
        count = len(log.messages)
        assert [m.payload for m in log.messages] == [as_json(m.payload) for m in memory.messages[:count]]
        recovered.append(count)
    assert recovered == sorted(recovered, reverse=True)
    assert recovered[0] == len(memory.messages)
    assert len(set(recovered)) > 3, "several chunks, so that a cut loses little"


def test_a_log_that_was_never_closed_keeps_all_but_its_last_chunk(tmp_path: Path) -> None:
    log = McapLog(tmp_path / "a.mcap", METADATA)
    text = "x" * 1000
    for index in range(203):
        log.write("state", index * 0.005, {"name": text})
    on_disk = read_log(tmp_path / "a.mcap", recover=True)
    log.close()
    assert 190 <= len(on_disk.messages) < 203
    assert on_disk.metadata == METADATA
    assert len(read_log(tmp_path / "a.mcap").messages) == 203


@given(data=st.data())
@hypothesis_settings(deadline=None)
def test_a_damaged_log_is_a_log_error_and_nothing_else(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    folder = tmp_path_factory.mktemp("log")
    flown_log(folder / "a.mcap", ticks=3)
    content = bytearray((folder / "a.mcap").read_bytes())
    place = data.draw(st.integers(0, len(content) - 1))
    content[place] ^= data.draw(st.integers(1, 255))
    (folder / "b.mcap").write_bytes(content)
    expected = read_log(folder / "a.mcap")
    for recover in (False, True):
        try:
            read = read_log(folder / "b.mcap", recover=recover)
        except LogError as error:
            assert "b.mcap" in str(error)
        else:
            count = len(read.messages)
            assert read.messages == expected.messages[:count]
            assert count == len(expected.messages) or (recover and read.damage)


@pytest.mark.parametrize("content", [b"", b"time_s,x_m\n", b"\x89MCAP0\r\n"])
def test_what_is_no_log_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.mcap").write_bytes(content)
    with pytest.raises(LogError, match=r"a\.mcap"):
        read_log(tmp_path / "a.mcap", recover=True)
    with pytest.raises(LogError, match="cannot be read"):
        read_log(tmp_path / "absent.mcap")
