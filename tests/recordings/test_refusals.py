"""What is not a recording is refused in words, with file, line and column; never with another exception."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recording_samples import small_hop

from ground.recordings import Recording, RecordingError, Table, load_recording, save_recording

TABLE = "time_s,x_m,v_m_s\n0.0,1.0,2.0\n0.1,1.5,2.5\n0.2,1.75,2.75\n"
SIDECAR = """\
format: 1
run: a
rig: bb0b
kind: axis
sensors:
  x_m: {noise_std: 0.1, resolution: 0.01, range: [-1, 3]}
conditions: {surface: steel, foot: 1, tilt_deg: 0, gravity_m_s2: 9.81, hop_index: 0, place: A}
events:
- {name: start, time_s: 0.1}
state: {x_m: 1.0}
notes: good
"""


def refusal(folder: Path, table: str | bytes = TABLE, sidecar: str | bytes = SIDECAR) -> str:
    """The message with which a pair is refused, from its file's name on."""
    for name, content in (("a.csv", table), ("a.yaml", sidecar)):
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(RecordingError) as caught:
        load_recording(folder / "a.csv")
    message = str(caught.value)
    assert message.startswith(str(folder))
    return message.removeprefix(f"{folder}/")


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("0.2,1.75", "0.05,1.75", "a.csv:4:1: column 'time_s': time goes back from 0.1 s to 0.05 s"),
        ("0.2,1.75", "0.1,1.75", "a.csv:4:1: column 'time_s': time stands still at 0.1 s"),
        ("0.1,1.5", ",1.5", "a.csv:3:1: column 'time_s': the time is missing"),
        ("v_m_s", "v", "a.csv:1:3: channel 'v' does not end in a unit"),
        ("v_m_s", "V_m_s", "a.csv:1:3: channel 'V_m_s': a name is lower-case"),
        ("v_m_s", "", "a.csv:1:3: channel ''"),
        ("v_m_s", "x_m", "a.csv:1:3: column 'x_m' stands twice"),
        ("time_s", "t", "a.csv:1:1: the first column must be 'time_s', not 't'"),
        ("1.5", "1.5x", "a.csv:3:2: column 'x_m': '1.5x' is no number"),
        ("1.5", " 1.5", "a.csv:3:2: column 'x_m': ' 1.5' is no number"),
        ("1.5", "1_5", "a.csv:3:2: column 'x_m': '1_5' is no number"),
        ("1.5", "1.5.", "a.csv:3:2: column 'x_m': '1.5.' is no number"),
        ("1.5", "١", "a.csv:3:2: column 'x_m': '١' is no number"),
        ("2.75", "nan", "a.csv:4:3: column 'v_m_s': 'nan' is not finite"),
        ("2.75", "-inf", "a.csv:4:3: column 'v_m_s': '-inf' is not finite"),
        ("2.75", "1e999", "a.csv:4:3: column 'v_m_s': '1e999' is not finite"),
        ("1.5,2.5", "1.5", "a.csv:3:3: the row has 2 cells, the header 3"),
        ("1.5,2.5", "1.5,2.5,", "a.csv:3:4: the row has 4 cells, the header 3"),
        ("0.1,1.5,2.5\n", "\n", "a.csv:3:2: the line is empty"),
        (TABLE, "time_s,x_m,v_m_s\n", "a.csv:2: the file has a header but no samples"),
        (TABLE, "time_s\n0.1\n", "a.csv:1:1: there is no channel beside the time"),
        (TABLE, "", "a.csv:1: the file is empty"),
        (TABLE, "\n\n", "a.csv:1: the file is empty"),
    ],
)
def test_a_bad_table_is_refused_at_its_place(tmp_path: Path, old: str, new: str, says: str) -> None:
    assert TABLE.count(old) == 1
    assert refusal(tmp_path, table=TABLE.replace(old, new)).startswith(says)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("format: 1", "format: 2", "a.yaml:1:1: key format is 2; this reader knows format 1"),
        ("format: 1", "format: true", "a.yaml:1:1: key format is True"),
        ("run: a\n", "", "a.yaml:1:1: key run is missing"),
        ("run: a\n", "run: 2026-11-21\n", "a.yaml:2:1: key run must be text, not datetime.date"),
        ("run: a\n", "run: ' '\n", "a.yaml:2:1: key run is empty"),
        ("run: a\n", "run: a\nrun: b\n", "a.yaml:3:1: key 'run' stands twice"),
        ("kind: axis", "kind: An axis", "a.yaml:4:1: key kind is 'An axis'"),
        ("notes: good", "note: good", "a.yaml:11:1: key note is not known; known here: format, run"),
        ("notes: good", "notes: 3", "a.yaml:11:1: key notes must be text, not 3"),
        ("noise_std: 0.1", "noise: 0.1", "a.yaml:6:9: key sensors.x_m.noise is not known"),
        (
            "noise_std: 0.1",
            "noise_std: -0.1",
            "a.yaml:6:9: key sensors.x_m.noise_std is -0.1, below its limit 0",
        ),
        ("noise_std: 0.1", "noise_std: low", "a.yaml:6:9: key sensors.x_m.noise_std must be a number"),
        ("noise_std: 0.1", "noise_std:", "a.yaml:6:9: key sensors.x_m.noise_std must be a number, not None"),
        ("noise_std: 0.1", "noise_std: .nan", "a.yaml:6:9: key sensors.x_m.noise_std must be finite"),
        (
            "noise_std: 0.1",
            f"noise_std: 1{'0' * 400}",
            "a.yaml:6:9: key sensors.x_m.noise_std must be finite",
        ),
        ("[-1, 3]", "[3, -1]", "a.yaml:6:43: key sensors.x_m.range is [3, -1]; the low end must be below"),
        ("[-1, 3]", "3", "a.yaml:6:43: key sensors.x_m.range must be a list [low, high], not 3"),
        ("[-1, 3]", "[-1, yes]", "a.yaml:6:55: key sensors.x_m.range.1 must be a number, not True"),
        ("surface: steel", "surface: 4", "a.yaml:7:14: key conditions.surface must be text, not 4"),
        ("surface:", "surfac:", "a.yaml:7:14: key conditions.surfac is not known; surface is meant?"),
        ("foot: 1", "foot: 9", "a.yaml:7:30: key conditions.foot is 9, outside [0, 4]"),
        ("foot: 1", "foot: 1.0", "a.yaml:7:30: key conditions.foot must be a whole number, not 1.0"),
        ("gravity_m_s2: 9.81", "gravity_m_s2: 9,81", "a.yaml:7"),
        ("time_s: 0.1", "time_s: soon", "a.yaml:9:17: key events.0.time_s must be a number, not 'soon'"),
        (", time_s: 0.1", "", "a.yaml:9:3: key events.0.time_s is missing"),
        ("- {name: start, time_s: 0.1}", "  start: 0.1", "a.yaml:8:1: key events must be a list"),
        ("state: {x_m: 1.0}", "state: [1.0]", "a.yaml:10:1: key state must be a mapping, not [1.0]"),
        ("state: {x_m: 1.0}", "state: {x_m: true}", "a.yaml:10:9: key state.x_m must be a number, not True"),
        ("state: {x_m: 1.0}", "state: {1: 1.0}", "a.yaml:10:9: key state.1 must be text"),
        ("state: {x_m: 1.0}", "state: {x_m: 1.0", "a.yaml:11:"),
        ("state: {x_m: 1.0}", "state: {[1]: 1.0}", "a.yaml:10:9: a list or mapping cannot be a key"),
        ("state: {x_m: 1.0}", "state: 2026-99-99", "a.yaml: is no valid YAML"),
        ("state: {x_m: 1.0}", "state: &a [*a]", "a.yaml:10:1: key state must be a mapping"),
        ("state: {x_m: 1.0}", f"state: {'[' * 5000}", "a.yaml"),
        ("good", "\x07", "a.yaml: is no valid YAML"),
        (SIDECAR, "", "a.yaml:1:1: the sidecar is empty"),
        (SIDECAR, "- format: 1\n", "a.yaml:1:1: the sidecar must be a mapping"),
    ],
)
def test_a_bad_sidecar_is_refused_at_its_place(tmp_path: Path, old: str, new: str, says: str) -> None:
    assert SIDECAR.count(old) == 1
    assert refusal(tmp_path, sidecar=SIDECAR.replace(old, new)).startswith(says)


def test_another_encoding_is_refused_at_its_place(tmp_path: Path) -> None:
    assert refusal(tmp_path, table=TABLE.replace("1.5", "1\xb5").encode("latin-1")).startswith(
        "a.csv:3:2: is not UTF-8 text (byte 34)"
    )
    assert "not UTF-8" in refusal(tmp_path, table=TABLE.encode("utf-16"))
    sidecar = SIDECAR.replace("good", "gr\xfc\xdfe").encode("latin-1")
    assert refusal(tmp_path, sidecar=sidecar).startswith("a.yaml:11:1: is not UTF-8 text")


def test_the_mark_of_utf_8_is_none(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(TABLE.encode("utf-8-sig"))
    (tmp_path / "a.yaml").write_text(SIDECAR)
    assert load_recording(tmp_path / "a.csv").times_s.size == 3


def test_a_cut_or_false_gzip_file_is_refused(tmp_path: Path) -> None:
    path = save_recording(small_hop(), tmp_path / "a.csv.gz")
    whole = path.read_bytes()
    for content in (whole[:-9], whole[:20], TABLE.encode(), b"", whole[:30] + b"xx" + whole[32:]):
        path.write_bytes(content)
        with pytest.raises(RecordingError, match=r"a\.csv\.gz"):
            load_recording(path)


def test_missing_and_doubled_neighbours_are_refused(tmp_path: Path) -> None:
    alone = replace(small_hop(), extra_tables={})
    path = save_recording(alone, tmp_path / "a.csv")
    save_recording(alone, tmp_path / "a.csv.gz")
    with pytest.raises(RecordingError, match=r"both a\.csv and a\.csv\.gz stand beside it"):
        load_recording(tmp_path / "a.yaml")
    (tmp_path / "a.yaml").unlink()
    with pytest.raises(RecordingError, match=r"a\.yaml: the sidecar cannot be read \(No such file"):
        load_recording(path)


@given(data=st.data())
def test_a_mutated_pair_is_read_or_refused_in_words(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    folder = tmp_path_factory.mktemp("run")
    good = {"a.csv": TABLE.encode(), "a.yaml": SIDECAR.encode()}
    name = data.draw(st.sampled_from(sorted(good)))
    content = good[name]
    start = data.draw(st.integers(0, len(content)))
    end = data.draw(st.integers(start, min(len(content), start + 8)))
    good[name] = content[:start] + data.draw(st.binary(max_size=8)) + content[end:]
    for each, mutated in good.items():
        (folder / each).write_bytes(mutated)
    try:
        recording = load_recording(folder / "a.csv")
    except RecordingError as error:
        assert str(error).startswith(f"{folder / name}")
    else:
        assert np.isfinite(recording.times_s).all()
        assert (np.diff(recording.times_s) > 0).all()


@given(data=st.data())
def test_a_mutated_mcap_is_read_or_refused_in_words(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    path = save_recording(small_hop(), tmp_path_factory.mktemp("run") / "a.mcap")
    content = bytearray(path.read_bytes())
    content[data.draw(st.integers(0, len(content) - 1))] ^= data.draw(st.integers(1, 255))
    path.write_bytes(content)
    for recover in (False, True):
        try:
            recording = load_recording(path, recover)
        except RecordingError as error:
            assert str(error).startswith(str(path))
        else:
            assert recover or recording.same_content(small_hop())


def test_a_cut_mcap_is_refused_and_its_whole_part_recovered_saying_so(tmp_path: Path) -> None:
    count = 40_000
    times_s = np.arange(count, dtype=np.float64) * 1e-3
    recording = Recording(times_s, {"x_m": np.sin(times_s)}, run="long", rig="r", kind="axis", notes="mine")
    path = save_recording(recording, tmp_path / "a.mcap")
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) * 2 // 3])
    with pytest.raises(RecordingError, match=r"a\.mcap: the file is cut at byte \d+"):
        load_recording(path)
    part = load_recording(path, recover=True)
    assert count // 3 < part.times_s.size < count
    np.testing.assert_array_equal(part.channels["x_m"], recording.channels["x_m"][: part.times_s.size])
    assert part.notes.startswith("mine\nRecovered in part: the file is cut at byte")


@pytest.mark.parametrize(
    ("times_s", "values", "says"),
    [
        ([0.0, 1.0], [0.0], "has 1 samples, not 2"),
        ([0.0, 0.0], [0.0, 1.0], "sample 1: time stands still"),
        ([0.0, np.nan], [0.0, 1.0], "sample 1: the time is missing"),
        ([0.0, 1.0], [0.0, np.inf], "'x_m': sample 1 is infinite"),
        ([], [], "at least one time"),
    ],
)
def test_a_table_that_is_none_cannot_be_built(times_s: list[float], values: list[float], says: str) -> None:
    with pytest.raises(RecordingError, match=says):
        Table(np.array(times_s), {"x_m": np.array(values)})


def test_a_recording_that_a_sidecar_cannot_say_is_not_written(tmp_path: Path) -> None:
    hop = small_hop()
    bad = replace(hop, conditions={"gravity_m_s2": float("nan")})
    for suffix in ("csv", "csv.gz", "mcap"):
        with pytest.raises(RecordingError, match=r"conditions\.gravity_m_s2 must be finite"):
            save_recording(bad, tmp_path / f"a.{suffix}")
    with pytest.raises(RecordingError, match=r"is written to \.csv"):
        save_recording(hop, tmp_path / "a.txt")
    assert not list(tmp_path.iterdir())
