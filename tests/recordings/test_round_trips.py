"""What is written is read back, to the bit, from either container."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from recording_samples import SHARED, recordings, small_hop

from ground.recordings import Recording, RecordingError, load_recording, load_recordings, save_recording

SUFFIXES = ["csv", "csv.gz", "mcap"]


@pytest.mark.parametrize("suffix", SUFFIXES)
@given(recording=recordings())
def test_any_recording_survives(
    tmp_path_factory: pytest.TempPathFactory, suffix: str, recording: Recording
) -> None:
    path = save_recording(recording, tmp_path_factory.mktemp("run") / f"run.{suffix}")
    read = load_recording(path)
    assert read.same_content(recording)
    assert read.source == path


def test_a_difference_of_one_bit_is_seen() -> None:
    one = small_hop()
    values = one.channels["body_acceleration_m_s2"].copy()
    values[3] = 0.0  # was -0.0
    channels = {**one.channels, "body_acceleration_m_s2": values}
    assert one.same_content(small_hop())
    assert not one.same_content(replace(one, channels=channels))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_the_same_recording_gives_the_same_file(tmp_path: Path, suffix: str) -> None:
    first = save_recording(small_hop(), tmp_path / f"a.{suffix}").read_bytes()
    assert save_recording(small_hop(), tmp_path / f"b.{suffix}").read_bytes() == first
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_a_csv_is_read_with_its_tables_at_other_rates_by_any_of_its_names(tmp_path: Path) -> None:
    save_recording(small_hop(), tmp_path / "run.csv")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run.csv", "run.drive.csv", "run.yaml"]
    for name in ("run.csv", "run.yaml"):
        assert load_recording(tmp_path / name).same_content(small_hop())
    (tmp_path / "run.csv").rename(tmp_path / "run.hop.csv")
    for path in (tmp_path / "run.yaml", tmp_path / "run.hop.csv"):
        read = load_recording(path)
        assert list(read.channels) == ["body_acceleration_m_s2", "magnet_current_a"]
        assert list(read.extra_tables) == ["drive"]
    assert len(load_recordings([tmp_path])) == 1


def test_a_csv_with_its_own_sidecar_is_its_own_recording(tmp_path: Path) -> None:
    save_recording(small_hop(), tmp_path / "run.csv")
    other = replace(small_hop(), run="2", extra_tables={})
    save_recording(other, tmp_path / "run.drive.csv")
    assert [recording.run for recording in load_recordings([tmp_path])] == ["bb0b-004", "2"]


def test_files_patterns_and_folders_name_recordings_once(tmp_path: Path) -> None:
    for index, suffix in enumerate(SUFFIXES):
        save_recording(replace(small_hop(), run=f"r{index}"), tmp_path / f"r{index}.{suffix}")
    everything = ["r0", "r1", "r2"]
    assert [r.run for r in load_recordings([tmp_path])] == everything
    assert [r.run for r in load_recordings([tmp_path / "*"])] == everything
    assert [r.run for r in load_recordings(sorted(tmp_path.iterdir()))] == everything
    assert [r.run for r in load_recordings([str(tmp_path / "r[02].*")])] == ["r0", "r2"]
    with pytest.raises(RecordingError, match=r"r0\.csv: is named twice"):
        load_recordings([tmp_path / "r0.csv", tmp_path / "r0.csv"])
    save_recording(load_recording(tmp_path / "r0.csv"), tmp_path / "copy.mcap")
    with pytest.raises(RecordingError, match=r"run 'r0' is in .*copy\.mcap already"):
        load_recordings([tmp_path])


def test_nothing_named_is_an_error(tmp_path: Path) -> None:
    for names, says in (
        ([], "no recording was named"),
        ([tmp_path], "the folder holds no recording"),
        ([tmp_path / "*.csv"], "no file fits the pattern"),
        ([tmp_path / "a.csv"], r"a\.csv: no such file"),
        ([tmp_path / "a.mcap"], r"a\.mcap: cannot be read"),
        ([tmp_path / "a.txt"], r"a\.txt: a recording ends in"),
    ):
        with pytest.raises(RecordingError, match=says):
            load_recordings(names)


def test_the_practice_recordings_read_and_survive(tmp_path: Path) -> None:
    if not SHARED.is_dir():
        pytest.skip("the practice recordings are not here")
    folders = sorted((SHARED / "practice").glob("case_*/train"))
    recordings = [recording for folder in folders for recording in load_recordings([folder])]
    assert len(recordings) >= 50
    for recording in recordings:
        assert set(recording.sensors) == set(recording.channels) - {"motor_voltage_v"}
        assert (recording.event_time_s("fire_command") is not None) == (recording.kind == "hop")
    for recording in recordings[::10]:
        for suffix in SUFFIXES:
            path = save_recording(recording, tmp_path / f"{recording.run}.{suffix}")
            assert load_recording(path).same_content(recording)


def test_missing_samples_and_gaps_are_kept(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("time_s,x_m,y_m\r\n0,1,\r\n1,,\r\n5,,2.5E-1\r\n")
    (tmp_path / "a.yaml").write_text("{format: 1, run: a, rig: r, kind: axis}")
    read = load_recording(tmp_path / "a.csv")
    np.testing.assert_array_equal(read.times_s, [0.0, 1.0, 5.0])
    np.testing.assert_array_equal(read.channels["x_m"], [1.0, np.nan, np.nan])
    np.testing.assert_array_equal(read.channels["y_m"], [np.nan, np.nan, 0.25])


def test_a_recording_is_immutable() -> None:
    times = np.array([0.0, 1.0])
    recording = Recording(times, {"x_m": times}, run="r", rig="r", kind="axis")
    times[0] = -5.0
    assert recording.times_s[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        recording.times_s[0] = 1.0
