"""Foreign files become recordings, by a mapping; what they lack is said in words."""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from recording_samples import SHARED
from scipy.io import loadmat, savemat

from ground.importing import import_recording, import_recordings
from ground.matlab_files import read_mat
from ground.recordings import Recording, RecordingError, load_recording, save_recording
from ground.sampling import sampling
from hal.config import config_path
from hal.errors import ConfigError

TABLE = '"Time (ms)","gap (mm)",force,note\n0,1.5,2,a\n10,,3,b\n25,2.5,4,c\n'


def plan(**changes: Any) -> dict[str, Any]:
    """A mapping of `TABLE`, with changes."""
    return {
        "format": 1,
        "time": {"variable": "Time (ms)", "scale": 1e-3},
        "channels": {
            "gap_m": {"variable": "gap (mm)", "unit": "mm", "nan_is_missing": True},
            "force_n": {"variable": "force", "scale": -2.0, "offset": 0.5},
        },
        "sidecar": {"rig": "press", "kind": "axis", "state": {"gap_m": 0.0015}},
        **changes,
    }


def imported(
    folder: Path, mapping: dict[str, Any], content: str = TABLE, name: str = "press.csv"
) -> Recording:
    (folder / "mapping.yaml").write_text(yaml.safe_dump(mapping))
    data = content.encode()
    (folder / name).write_bytes(gzip.compress(data) if name.endswith(".gz") else data)
    return import_recording(folder / name, folder / "mapping.yaml")


@pytest.mark.parametrize("name", ["press.csv", "press.txt.gz"])
def test_columns_are_scaled_shifted_and_converted(tmp_path: Path, name: str) -> None:
    recording = imported(tmp_path, plan(), name=name)
    np.testing.assert_array_equal(recording.times_s, [0.0, 0.01, 0.025])
    np.testing.assert_allclose(recording.channels["gap_m"], [1.5e-3, np.nan, 2.5e-3], rtol=1e-15)
    np.testing.assert_array_equal(recording.channels["force_n"], [-3.5, -5.5, -7.5])
    assert (recording.run, recording.rig, recording.kind) == ("press", "press", "axis")
    assert recording.state == {"gap_m": 0.0015}


def test_an_imported_recording_is_saved_like_any_other(tmp_path: Path) -> None:
    recording = imported(tmp_path, plan())
    assert load_recording(save_recording(recording, tmp_path / "out.csv")).same_content(recording)


def test_an_even_rate_gives_the_times_and_rows_a_stretch(tmp_path: Path) -> None:
    changes = {"time": {"rate_hz": 4.0, "start_s": 1.0}, "rows": {"first": 2}}
    recording = imported(tmp_path, plan(**changes))
    np.testing.assert_array_equal(recording.times_s, [1.0, 1.25])
    np.testing.assert_array_equal(recording.channels["force_n"], [-5.5, -7.5])


def test_a_table_without_header_names_columns_by_number(tmp_path: Path) -> None:
    mapping = plan(
        table={"delimiter": "\t", "header": False, "skip_lines": 1},
        time={"variable": "1"},
        channels={"force_n": {"variable": "2"}},
    )
    recording = imported(tmp_path, mapping, content="a title\n0\t7\n1\t8\n", name="raw.txt")
    np.testing.assert_array_equal(recording.channels["force_n"], [7.0, 8.0])


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"time": {"variable": "t"}}, r"press\.csv: time .*no 't' is in the file; it has Time \(ms\) 3, gap"),
        ({"channels": {"x_m": {"variable": "x"}}}, r"press\.csv: channels\.x_m .*no 'x' is in the file"),
        ({"channels": {"x_m": {"variable": "note"}}}, r"channels\.x_m .*'note': sample 0 is 'a', no number"),
        (
            {"channels": {"x_m": {"variable": "gap (mm)"}}},
            r"channels\.x_m .*sample 1 of 'gap \(mm\)' is not a",
        ),
        ({"time": {"variable": "force", "scale": -1}}, r"press\.csv: time .*time goes back from -2\.0 s"),
        ({"rows": {"first": 4}}, r"has no sample in rows 4 to the end"),
        ({"sidecar": {"rig": "press"}}, r"mapping\.yaml: sidecar: key kind is missing"),
        (
            {"sidecar": {"rig": "p", "kind": "axis", "run": 3}},
            r"mapping\.yaml: sidecar: key run must be text",
        ),
        (
            {"channels": {"force_n": {"variable": "force", "index": [7]}}},
            r"'force' 3 has no index 7 \(index\[0\]\)",
        ),
    ],
)
def test_what_the_file_lacks_is_said(tmp_path: Path, changes: dict[str, Any], says: str) -> None:
    with pytest.raises(RecordingError, match=says):
        imported(tmp_path, plan(**changes))


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"time": {}}, r"mapping\.yaml: time must have either variable or rate_hz"),
        ({"time": {"rate_hz": 0.0}}, r"mapping\.yaml: time\.rate_hz = 0\.0 is outside its limits"),
        ({"time": {"rate_hz": 1.0, "variable": "t"}}, r"either variable or rate_hz"),
        ({"channels": {}}, r"mapping\.yaml: channels is empty"),
        ({"format": 2}, r"mapping\.yaml: format = 2 is outside"),
        ({"chanels": {}}, r"mapping\.yaml: unknown key chanels"),
        (
            {"channels": {"force": {"variable": "force"}}},
            r"mapping\.yaml: channels\.force: channel 'force' does not",
        ),
        (
            {"channels": {"f_n": {"variable": "force", "unit": "mm"}}},
            r"channels\.f_n\.unit = 'mm' is no unit that be",
        ),
        (
            {"channels": {"f_n": {"variable": "force", "unit": "blob"}}},
            r"channels\.f_n\.unit = 'blob' is no unit",
        ),
    ],
)
def test_a_faulty_mapping_is_said(tmp_path: Path, changes: dict[str, Any], says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        imported(tmp_path, plan(**changes))


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (TABLE.replace("10,,3,b", "10,,3"), r"press\.csv:3: the row has 3 cells, not 4"),
        (TABLE.replace("force", "gap (mm)"), r"press\.csv:1:3: column 'gap \(mm\)' stands twice"),
        (TABLE.replace("3,b", "inf,b"), r"channel 'force_n': sample 1 is infinite"),
        (TABLE.replace("3,b", "1_0,b"), r"sample 1 is '1_0', no number"),
        ('"open', r"press\.csv: is no table"),
        ("", r"press\.csv:1: the file is empty"),
    ],
)
def test_a_bad_table_is_refused(tmp_path: Path, content: str, says: str) -> None:
    with pytest.raises(RecordingError, match=says):
        imported(tmp_path, plan(), content=content)


def mat_plan(**channel: Any) -> dict[str, Any]:
    return plan(time={"variable": "t"}, channels={"phi_rad": channel})


def saved_mat(folder: Path) -> tuple[Path, Path]:
    cells = np.empty(2, dtype=object)
    cells[0], cells[1] = np.arange(6.0).reshape(2, 3), np.arange(6.0, 12.0).reshape(2, 3)
    content = {
        "t": np.arange(3.0)[:, None],
        "runs": cells,
        "c": np.ones(3) * 1j,
        "short": np.ones(2),
        "s": "text",
    }
    savemat(folder / "a.mat", content)
    return folder / "a.mat", folder / "mapping.yaml"


def test_cells_and_rows_of_a_matlab_variable_are_picked_by_index(tmp_path: Path) -> None:
    path, mapping = saved_mat(tmp_path)
    mapping.write_text(yaml.safe_dump(mat_plan(variable="runs", index=[1, 0])))
    np.testing.assert_array_equal(import_recording(path, mapping).channels["phi_rad"], [6.0, 7.0, 8.0])


@pytest.mark.parametrize(
    ("channel", "says"),
    [
        ({"variable": "q"}, r"a\.mat: channels\.phi_rad .*no 'q' is in the file; it has t 3×1, runs"),
        ({"variable": "runs"}, r"'runs' is .* of object; one row or column of real numbers is needed"),
        ({"variable": "runs", "index": [1]}, r"'runs' is 2×3 of float64; one row or column"),
        ({"variable": "runs", "index": [1, 2]}, r"'runs' 2×3 has no index 2 \(index\[1\]\)"),
        ({"variable": "c"}, r"'c' is 1×3 of complex128"),
        ({"variable": "s"}, r"'s': sample 0 is 'text', no number"),
        ({"variable": "short"}, r"channels\.phi_rad: has 2 samples, the time 3"),
    ],
)
def test_what_a_matlab_file_lacks_is_said(tmp_path: Path, channel: dict[str, Any], says: str) -> None:
    path, mapping = saved_mat(tmp_path)
    mapping.write_text(yaml.safe_dump(mat_plan(**channel)))
    with pytest.raises(RecordingError, match=says):
        import_recording(path, mapping)


@pytest.mark.parametrize("compressed", [False, True])
def test_a_matlab_file_is_read_as_scipy_reads_it(tmp_path: Path, compressed: bool) -> None:
    cells = np.empty((2, 2), dtype=object)
    for index in range(4):
        cells.flat[index] = np.arange(index * 6.0).reshape(-1, 2)
    content = {
        "cells": cells,
        "whole": np.arange(6, dtype=np.int16).reshape(2, 3),
        "single": np.array([0.1, 0.2], dtype=np.float32),
        "truth": np.array([True, False]),
        "cube": np.arange(24.0).reshape(2, 3, 4),
        "log": {"time_s": np.arange(3.0), "n": 3.0},
    }
    savemat(tmp_path / "a.mat", content, do_compression=compressed)
    expected, read = loadmat(str(tmp_path / "a.mat")), read_mat(tmp_path / "a.mat")
    assert sorted(read) == ["cells", "cube", "log.n", "log.time_s", "single", "truth", "whole"]
    for name in ("whole", "single", "truth", "cube"):
        np.testing.assert_array_equal(read[name], expected[name])
    for one, other in zip(read["cells"].flat, expected["cells"].flat, strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(read["log.time_s"], expected["log"]["time_s"][0, 0])


def test_a_matlab_file_of_another_version_is_refused(tmp_path: Path) -> None:
    mapping = saved_mat(tmp_path)[1]
    mapping.write_text(yaml.safe_dump(mat_plan(variable="t")))
    for content, says in (
        (
            b"MATLAB 7.3 MAT-file, Platform: GLNXA64" + b" " * 100,
            "is a MATLAB file of version 7.3; save it with -v7",
        ),
        (b"time_s,x_m\n", "is no MATLAB file of version 5"),
        (b"", "is no MATLAB file of version 5"),
    ):
        (tmp_path / "a.mat").write_bytes(content)
        with pytest.raises(RecordingError, match=says):
            import_recording(tmp_path / "a.mat", mapping)


def test_the_double_pendulum_is_read_by_index(tmp_path: Path) -> None:
    path = SHARED / "data/double-pendulum/DoublePendulumDataForParameterEstimation.mat"
    if not path.is_file():
        pytest.skip("the recording of the double pendulum is not here")
    mapping = plan(
        time={"variable": "Time_id", "index": [25]},
        channels={"phi2_rad": {"variable": "Y_id", "index": [25, 1]}},
    )
    (tmp_path / "mapping.yaml").write_text(yaml.safe_dump(mapping))
    recording = import_recording(path, tmp_path / "mapping.yaml")
    np.testing.assert_array_equal(recording.channels["phi2_rad"], loadmat(str(path))["Y_id"][25, 0][1])
    assert recording.times_s.size == 2667


@given(data=st.data())
def test_a_damaged_matlab_file_is_read_or_refused_in_words(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    folder = tmp_path_factory.mktemp("mat")
    path, mapping = saved_mat(folder)
    mapping.write_text(yaml.safe_dump(mat_plan(variable="runs", index=[1, 0])))
    content = bytearray(path.read_bytes())
    content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content[: data.draw(st.integers(0, len(content)))])
    try:
        import_recording(path, mapping)
    except RecordingError as error:
        assert "a.mat" in str(error)


def test_absent_and_unknown_files_are_refused(tmp_path: Path) -> None:
    _, mapping = saved_mat(tmp_path)
    mapping.write_text(yaml.safe_dump(plan()))
    for name, says in (
        ("no.mat", r"no\.mat: cannot be read"),
        ("no.csv", r"no\.csv: cannot be read"),
        ("a.xls", r"a\.xls: a file to import ends in \.mat"),
    ):
        with pytest.raises(RecordingError, match=says):
            import_recording(tmp_path / name, mapping)


def test_the_mapping_of_emps_gives_its_motor_force_and_position(tmp_path: Path) -> None:
    path = SHARED / "data/emps/DATA_EMPS.mat"
    if not path.is_file():
        pytest.skip("the recording of EMPS is not here")
    recording = import_recording(path, config_path("imports", "emps.yaml"))
    raw = loadmat(str(path))
    assert recording.times_s.size == 24841
    assert np.diff(recording.times_s).max() < 1.1e-3
    np.testing.assert_array_equal(recording.channels["position_m"], raw["qm"].ravel())
    force_n = raw["gtau"].item() * raw["vir"].ravel()
    np.testing.assert_allclose(recording.channels["motor_force_n"], force_n, rtol=1e-6)
    assert recording.sensors["position_m"].resolution == 5e-8
    saved = save_recording(recording, tmp_path / "emps.csv.gz")
    assert load_recording(saved).same_content(recording)


DROPS = """ball,drop,t,h
Tennis Ball,1,0,2
Tennis Ball,1,1,1
Tennis Ball,2,0,4
Golf,1,0,3
Golf,1,1,2
Tennis Ball,2,1,0
"""


def test_columns_tell_the_recordings_of_a_table_apart(tmp_path: Path) -> None:
    mapping = plan(
        time={"variable": "t"}, channels={"height_m": {"variable": "h"}}, split={"by": ["ball", "drop"]}
    )
    (tmp_path / "mapping.yaml").write_text(yaml.safe_dump(mapping))
    (tmp_path / "drops.csv").write_text(DROPS)
    found = import_recordings(tmp_path / "drops.csv", tmp_path / "mapping.yaml")
    assert [r.run for r in found] == ["drops_tennis_ball_1", "drops_tennis_ball_2", "drops_golf_1"]
    np.testing.assert_array_equal(found[1].channels["height_m"], [4.0, 0.0])
    assert found[2].conditions == {"ball": "Golf", "drop": 1.0}
    with pytest.raises(RecordingError, match="holds 3 recordings; one is needed"):
        import_recording(tmp_path / "drops.csv", tmp_path / "mapping.yaml")


def test_cells_and_stretches_tell_recordings_apart(tmp_path: Path) -> None:
    path, mapping = saved_mat(tmp_path)
    content = mat_plan(variable="runs", index=[1])
    mapping.write_text(yaml.safe_dump({**content, "split": {"cells": "runs"}}))
    found = import_recordings(path, mapping)
    assert [r.run for r in found] == ["a_1", "a_2"]
    np.testing.assert_array_equal(found[1].channels["phi_rad"], [9.0, 10.0, 11.0])
    rows = {"start": {"last": 2}, "end": {"first": 2}}
    mapping.write_text(yaml.safe_dump({**mat_plan(variable="t"), "split": {"rows": rows}}, sort_keys=False))
    found = import_recordings(path, mapping)
    assert [(r.run, r.times_s.tolist()) for r in found] == [("a_start", [0.0, 1.0]), ("a_end", [1.0, 2.0])]


@pytest.mark.parametrize(
    ("split", "error", "says"),
    [
        ({"cells": "t"}, RecordingError, r"split\.cells .*'t' is no cell array"),
        ({"by": ["ball"]}, RecordingError, r"split\.by .*no column 'ball'; it has t, runs"),
        ({"by": ["t"], "cells": "runs"}, ConfigError, "split takes one of by, cells, rows"),
    ],
)
def test_a_split_that_does_not_fit_is_refused(
    tmp_path: Path, split: dict[str, Any], error: type[Exception], says: str
) -> None:
    path, mapping = saved_mat(tmp_path)
    mapping.write_text(yaml.safe_dump({**mat_plan(variable="t"), "split": split}))
    with pytest.raises(error, match=says):
        import_recordings(path, mapping)


def test_the_longest_quiet_stretch_is_kept(tmp_path: Path) -> None:
    heard = [9, 9, 1, 9, 9, 1, -1, 1, 0, 9]
    text = "t,a\n" + "".join(f"{0.1 * i:.1f},{a}\n" for i, a in enumerate(heard))
    mapping = plan(time={"variable": "t"}, channels={"a_m_s2": {"variable": "a"}})
    keep = {"channel": "a_m_s2", "below": 2.0, "shortest_s": 0.25, "lead_s": 0.11, "trim_s": 0.05}
    recording = imported(tmp_path, {**mapping, "keep": keep}, content=text)
    np.testing.assert_allclose(recording.times_s, [0.4, 0.5, 0.6, 0.7])
    with pytest.raises(
        RecordingError, match=r"no stretch of 0\.5 s .* stays below 2; the longest lasts 0\.3 s"
    ):
        imported(tmp_path, {**mapping, "keep": {**keep, "shortest_s": 0.5}}, content=text)
    with pytest.raises(ConfigError, match=r"keep\.channel = 'b_m' is none of the channels"):
        imported(tmp_path, {**mapping, "keep": {**keep, "channel": "b_m"}}, content=text)


def test_the_way_of_sampling_is_told_in_words() -> None:
    even = np.arange(0.0, 1.0, 0.01)
    assert sampling(even) == "100 samples/s over 0.99 s"
    gap = np.delete(even, slice(50, 53))
    assert sampling(gap).endswith(", 1 gaps, the longest of 0.04 s at 0.49 s")
    assert "uneven by" in sampling(even + 0.002 * np.sin(np.arange(even.size)))
