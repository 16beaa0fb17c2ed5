"""What is exported is what was logged, and others' libraries read it."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from flight.log import McapLog, read_log
from flight.mcap_stream import schema_of, unit_of
from ground.export import export, tables_of
from ground.recordings.loading import load_recording
from ground.recordings.log_channels import gather
from ground.viewer_layout import PHASES, PLOTS, TABLES, layout
from hal.errors import ConfigError


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_the_tables_of_a_log_hold_its_readings(flown_log: Path) -> None:
    tables = tables_of(flown_log)
    channels = gather(read_log(flown_log).messages)
    for topic, column, channel in (
        ("spring", "compression_m", "spring_compression_m"),
        ("accelerometer", "specific_force_m_s2", "body_acceleration_m_s2"),
        ("motor_current", "current_a", "motor_current_a"),
    ):
        series = channels.series[channel]
        assert tables[topic]["time_s"] == series.times_s
        assert tables[topic][column] == series.values
    assert tables["state"]["to"][-1] == "safe"
    assert len(tables["hop"]["energy_used_j_sigma"]) == 2


def test_csv_and_parquet_hold_the_same(flown_log: Path, tmp_path: Path) -> None:
    parquet: Any = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    written = export(flown_log, tmp_path / "csv", "csv")
    export(flown_log, tmp_path / "parquet", "parquet")
    for name, count in written.items():
        table = parquet.read_table(tmp_path / "parquet" / name.replace(".csv", ".parquet"))
        assert table.num_rows == count == len(rows(tmp_path / "csv" / name))
    table = parquet.read_table(tmp_path / "parquet" / "spring.parquet")
    assert table.schema.field("compression_m").metadata == {b"unit": b"m"}
    as_text = [float(row["compression_m"]) for row in rows(tmp_path / "csv" / "spring.csv")]
    assert as_text == table.column("compression_m").to_pylist()
    about = json.loads((tmp_path / "csv" / "export.json").read_text())
    assert about["units"]["accelerometer"]["specific_force_m_s2"] == "m/s²"


def test_a_recordings_missing_samples_stay_missing(flown_log: Path, tmp_path: Path) -> None:
    source = flown_log.parent / "hop_01.hop.csv.gz"
    export(source, tmp_path / "out", "csv")
    recording = load_recording(source)
    found = rows(tmp_path / "out" / "main.csv")
    for name, values in recording.channels.items():
        got = np.array([float(row[name]) if row[name] else np.nan for row in found])
        assert np.array_equal(got, values, equal_nan=True)


def test_an_unknown_format_and_a_folder_in_use_are_refused(flown_log: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="--to 'xls' is no format; known: csv, parquet"):
        export(flown_log, tmp_path / "a", "xls")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("years")
    with pytest.raises(ConfigError, match="holds something else"):
        export(flown_log, tmp_path / "mine", "csv")
    assert (tmp_path / "mine" / "thesis.txt").read_text() == "years"


def test_every_field_of_the_layout_is_in_the_log(flown_log: Path) -> None:
    seen: dict[str, dict[str, Any]] = {}
    for message in read_log(flown_log).messages:
        if message.payload.get("method", "read") == "read" and not _empty(message.payload):
            seen.setdefault(message.topic, message.payload)
    for path in [*(path for paths in PLOTS.values() for path in paths), PHASES]:
        topic, *fields = path.replace("[0]", "").split(".")
        value: Any = seen[topic]
        for name in fields:
            value = value[name]
    assert set(TABLES) <= set(seen)


def _empty(payload: dict[str, Any]) -> bool:
    return isinstance(payload.get("result"), dict) and payload["result"].get("times_s") == []


def test_the_layout_shows_each_panel_once() -> None:
    found = json.dumps(layout()["layout"])
    assert all(found.count(f'"{name}"') == 1 for name in layout()["configById"])


def test_schemas_of_topics_say_the_units(tmp_path: Path) -> None:
    assert unit_of("specific_force_m_s2") == "m/s²"
    assert unit_of("energy_used_j_sigma") == "J"
    assert unit_of("phase") == ""
    assert schema_of({"speed_m_s": 0.5, "phase": "hold"})["properties"] == {
        "speed_m_s": {"type": "number", "description": "m/s"},
        "phase": {"type": "string"},
    }
    with McapLog(tmp_path / "a.mcap", {}) as log:
        log.write("outputs", 0.0, {"voltage_v": 1.0})
    with (tmp_path / "a.mcap").open("rb") as stream:
        (schema,) = make_reader(stream).get_summary().schemas.values()
    assert schema.encoding == "jsonschema"
    assert json.loads(schema.data)["properties"]["voltage_v"] == {"type": "number", "description": "V"}
