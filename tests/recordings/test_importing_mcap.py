"""MCAP files of other makers become recordings: JSON and ROS 2, topics at rates of their own, damage in words."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.writer import Writer
from mcap_ros2.writer import Writer as Ros2Writer

from ground.importing import import_recording
from ground.recordings import Recording, RecordingError

START_NS = 1_700_000_000_000_000_000
IMU = """std_msgs/Header header
geometry_msgs/Vector3 linear_acceleration
float64[3] covariance
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""


def json_file(path: Path, messages: dict[str, list[tuple[float, Any]]], encoding: str = "json") -> Path:
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("thing", "jsonschema", b'{"type": "object"}')
        for topic, rows in messages.items():
            channel = writer.register_channel(topic, encoding, schema)
            for time_s, content in rows:
                time_ns = START_NS + round(1e9 * time_s)
                writer.add_message(channel, time_ns, json.dumps(content).encode(), time_ns)
        writer.finish()
    return path


def imported(folder: Path, path: Path, channels: dict[str, Any]) -> Recording:
    mapping = folder / "mapping.yaml"
    plan = {
        "format": 1,
        "time": {"variable": "log_time"},
        "channels": channels,
        "sidecar": {"rig": "press", "kind": "axis"},
    }
    mapping.write_text(yaml.safe_dump(plan), encoding="utf-8")
    return import_recording(path, mapping)


def test_topics_at_rates_of_their_own_share_the_recording(tmp_path: Path) -> None:
    motor = [(0.01 * k, {"state": {"force": 2.0 * k, "name": "m"}}) for k in range(5)]
    gap = [(0.02 * k, {"gap": [0.5, 10.0 + k]}) for k in range(3)]
    camera = [(0.003, {"pixels": list(range(500))})]
    path = json_file(tmp_path / "bag.mcap", {"/motor": motor, "/gap": gap, "/camera": camera})
    found = imported(
        tmp_path,
        path,
        {
            "force_n": {"variable": "/motor.state.force", "nan_is_missing": True},
            "gap_m": {"variable": "/gap.gap[1]", "unit": "mm", "nan_is_missing": True},
        },
    )
    np.testing.assert_allclose(found.times_s, [0.0, 0.01, 0.02, 0.03, 0.04], atol=1e-12)
    np.testing.assert_array_equal(found.channels["force_n"], [0.0, 2.0, 4.0, 6.0, 8.0])
    np.testing.assert_allclose(found.channels["gap_m"], [0.010, np.nan, 0.011, np.nan, 0.012], rtol=1e-12)


def test_messages_of_ros_2_are_read(tmp_path: Path) -> None:
    path = tmp_path / "ros.mcap"
    with path.open("wb") as stream:
        writer = Ros2Writer(stream)
        schema = writer.register_msgdef("sensor_msgs/msg/Imu", IMU)
        for k in range(4):
            content = {
                "header": {"stamp": {"sec": k, "nanosec": 0}, "frame_id": "body"},
                "linear_acceleration": {"x": 0.0, "y": 0.1, "z": 9.81 + k},
                "covariance": [1.0, 2.0, 3.0],
            }
            writer.write_message("/imu", schema, content, log_time=START_NS + k * 10_000_000)
        writer.finish()
    found = imported(tmp_path, path, {"body_acceleration_m_s2": {"variable": "/imu.linear_acceleration.z"}})
    np.testing.assert_allclose(found.times_s, [0.0, 0.01, 0.02, 0.03])
    np.testing.assert_allclose(found.channels["body_acceleration_m_s2"], [9.81, 10.81, 11.81, 12.81])


def test_what_the_file_lacks_is_said_with_what_it_has(tmp_path: Path) -> None:
    path = json_file(tmp_path / "bag.mcap", {"/motor": [(0.0, {"force": 1.0}), (0.1, {"force": 2.0})]})
    with pytest.raises(RecordingError, match=r"no '/motor\.torque' is in the file; it has .*/motor\.force"):
        imported(tmp_path, path, {"force_n": {"variable": "/motor.torque"}})
    with pytest.raises(RecordingError, match=r"no '/engine\.force' .* it has .*/motor\.force"):
        imported(tmp_path, path, {"force_n": {"variable": "/engine.force"}})


def test_two_messages_at_the_same_time_are_refused(tmp_path: Path) -> None:
    path = json_file(tmp_path / "bag.mcap", {"/motor": [(0.1, {"force": 1.0}), (0.1, {"force": 2.0})]})
    with pytest.raises(RecordingError, match="/motor has two messages at the same time"):
        imported(tmp_path, path, {"force_n": {"variable": "/motor.force"}})


def test_another_encoding_is_named(tmp_path: Path) -> None:
    path = json_file(tmp_path / "bag.mcap", {"/motor": [(0.0, {"force": 1.0})]}, encoding="flatbuffer")
    with pytest.raises(RecordingError, match=r"flatbuffer.*json and cdr"):
        imported(tmp_path, path, {"force_n": {"variable": "/motor.force"}})


@pytest.mark.parametrize("keep", [0, 10, 200, 400])
def test_a_cut_file_is_refused_in_words(tmp_path: Path, keep: int) -> None:
    path = json_file(tmp_path / "bag.mcap", {"/motor": [(0.1 * k, {"force": 1.0}) for k in range(50)]})
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(RecordingError, match=r"bag\.mcap: (is cut or damaged|no '/motor)"):
        imported(tmp_path, path, {"force_n": {"variable": "/motor.force"}})
