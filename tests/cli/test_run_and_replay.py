"""`hopper run` and `hopper replay`: what is printed, what is on file, and that both repeat to the bit."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

import pytest
from hopper_command import SHORT, done, hopper, refused

from flight.executive import Progress
from flight.log import McapLog, read_log
from ground import console
from ground.mission_summary import HOP_LINE_HEADERS

FILES = {"flight.mcap", "mission.json", "report.html"} | {
    f"hop_00.{kind}{suffix}" for kind in ("drive", "hop") for suffix in (".csv.gz", ".yaml")
}


def test_the_table_shows_what_is_on_file(printed: str, flown: Path) -> None:
    assert {path.name for path in flown.iterdir()} == FILES
    content = json.loads((flown / "mission.json").read_text(encoding="utf-8"))
    (hop,) = content["hops"]
    lines = [line.split() for line in printed.splitlines()]
    (values,) = [line for line in lines if line[:3] == ["1", "quartz", "sand"]]
    (sigmas,) = [line for line in lines if line[:2] == ["±", "1σ"]]
    (truths,) = [line for line in lines if line[:1] == ["truth"]]
    time_of_flight = hop["time_of_flight_s"]
    assert float(values[4]) == pytest.approx(1e3 * time_of_flight["value"], abs=0.06)
    assert float(sigmas[3]) == pytest.approx(1e3 * time_of_flight["sigma"], rel=0.06)
    assert float(truths[2]) == pytest.approx(1e3 * hop["truth"]["time_of_flight_s"], abs=0.06)
    assert values[-1] == hop["verdict"]
    assert content["summary"] in printed
    assert f"page: {flown / 'report.html'}" in printed


def test_the_table_fits_80_columns_at_its_widest(capsys: pytest.CaptureFixture[str]) -> None:
    lines = [
        ("12", "quartz aggregate", "25.983", "1250.32", "12.586", "1103.45", "100.06", "degraded"),
        ("", "± 1σ", "0.331", "120.22", "0.064", "100.31", "10.33", ""),
        ("", "truth", "25.983", "1250.30", "12.590", "1103.43", "100.10", ""),
    ]
    console.hop_table(HOP_LINE_HEADERS, [lines, lines])
    shown = capsys.readouterr().out
    assert max(map(len, shown.splitlines())) <= 80
    for text in (text for line in lines for text in line if text):
        assert shown.count(text) >= 2


def test_json_is_the_mission_file_and_nothing_else_and_one_seed_repeats_to_the_bit(
    flown: Path, tmp_path: Path
) -> None:
    printed = done(*SHORT, "--out", tmp_path / "again", "--json")
    stored = (tmp_path / "again" / "mission.json").read_text(encoding="utf-8")
    assert json.loads(printed) == json.loads(stored)
    for name in FILES - {"report.html"}:
        assert (tmp_path / "again" / name).read_bytes() == (flown / name).read_bytes(), name


def test_a_log_replays_to_the_bit(flown: Path) -> None:
    printed = done("replay", flown / "flight.mcap")
    messages = read_log(flown / "flight.mcap").messages
    end = max(m.sequence for m in messages if m.payload.get("method") != "close")
    assert end > 10_000
    assert f"compared: {end + 1} messages" in printed  # all but the devices' closing
    assert printed.endswith("the replay is the same, bit for bit\n")


def test_an_altered_reading_makes_the_replay_differ(flown: Path, tmp_path: Path) -> None:
    log = read_log(flown / "flight.mcap")
    reads = [m for m in log.messages if m.topic == "nut_encoder" and m.payload["method"] == "read"]
    victim = reads[len(reads) // 2]
    with McapLog(tmp_path / "altered.mcap", log.metadata) as copy:
        for message in log.messages:
            payload = message.payload
            if message is victim:
                position_m = payload["result"]["position_m"] + 1e-6
                payload = {**payload, "result": {**payload["result"], "position_m": position_m}}
            copy.write(message.topic, message.time_s, payload)
    result = hopper("replay", tmp_path / "altered.mcap")
    assert result.exit_code == 1
    assert "first difference: message" in result.stderr
    assert "the same" not in result.stdout


def test_a_log_of_nothing_cannot_be_replayed(flown: Path, tmp_path: Path) -> None:
    """A replay that compared nothing has shown nothing."""
    with McapLog(tmp_path / "empty.mcap", read_log(flown / "flight.mcap").metadata):
        pass
    assert refused("replay", tmp_path / "empty.mcap").endswith(
        "empty.mcap: holds no messages, so there is nothing to compare"
    )
    (tmp_path / "hollow.mcap").touch()
    assert "hollow.mcap" in refused("replay", tmp_path / "hollow.mcap")


def test_ctrl_c_names_the_log_that_it_keeps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(progress: Progress) -> None:
        if progress.time_s > 0.3:
            os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr("ground.cli.mission_watcher", lambda *_: stop)
    result = hopper(*SHORT, "--out", tmp_path / "out")
    assert result.exit_code == 130
    log = tmp_path / "out.stopped" / "flight.mcap"
    assert f"stopped; the log of the flight is kept: {log}" in result.stderr
    assert done("replay", log).endswith("the replay is the same, bit for bit\n")


def test_a_mission_through_the_real_drivers_is_flown_and_replayed_by_the_same_commands(
    tmp_path: Path,
) -> None:
    options = ("--references", "0", "--hops", "1", "--energy-j", "0.8", "--out", tmp_path / "out")
    printed = done("run", "--board", "raspberry_pi_emulated", *options)
    assert "All 1 hops were made, and the robot is stowed" in printed
    content = json.loads((tmp_path / "out" / "mission.json").read_text(encoding="utf-8"))
    assert content["board"] == "raspberry_pi_emulated"
    printed = done("replay", tmp_path / "out" / "flight.mcap")
    assert printed.endswith("the replay is the same, bit for bit\n")
