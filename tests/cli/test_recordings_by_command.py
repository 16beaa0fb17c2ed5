"""`hopper simulate`, `convert`, `import` and `plant check` on files that the tests make or the robot wrote."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from hopper_command import done
from scipy.io import savemat

from ground.recordings import Recording, load_recording, load_recordings, save_recording
from hal.config import config_path
from sim_hal.plant.simulate import load_plant

OUTPUTS = {
    "drive": {"motor_current_a", "nut_position_m", "spring_compression_m"},
    "hop": {"body_acceleration_m_s2", "spring_compression_m", "magnet_current_a"},
}


def simulated(kind: str, like: Path, out: Path) -> Recording:
    """The run of a recording as the built-in plant of its kind predicts it."""
    done("simulate", "--plant", f"bb0b_{kind}", "--like", like, "--out", out)
    return load_recording(out)


def rms_sigmas(measured: Recording, predicted: Recording, channel: str, use: np.ndarray) -> float:
    """Error of a predicted channel over the chosen samples, in the standard deviation of its sensor."""
    sensor = measured.sensors[channel]
    sigma = np.hypot(sensor.noise_std or 0.0, (sensor.resolution or 0.0) / np.sqrt(12.0))
    errors = (measured.channels[channel] - predicted.channels[channel])[use] / sigma
    errors = errors[np.isfinite(errors)]
    assert errors.size > 50
    return float(np.sqrt(np.mean(errors**2)))


def test_the_drive_is_predicted_down_to_the_noise(flown: Path, tmp_path: Path) -> None:
    measured = load_recording(flown / "hop_00.drive.csv.gz")
    predicted = simulated("drive", flown / "hop_00.drive.csv.gz", tmp_path / "drive.csv")
    assert predicted.channels.keys() == OUTPUTS["drive"]
    np.testing.assert_array_equal(predicted.times_s, measured.times_s)
    running = measured.times_s > 0.5  # the log's clock rounds where the motor starts
    assert rms_sigmas(measured, predicted, "motor_current_a", running) < 1.5
    assert rms_sigmas(measured, predicted, "spring_compression_m", running) < 1.5
    # the encoder has no noise; where the string is taut is known to some micrometres
    nut_error_m = np.abs(measured.channels["nut_position_m"] - predicted.channels["nut_position_m"])
    assert np.nanmax(nut_error_m) < 15e-6  # five sigmas of it
    assert np.nanmax(measured.channels["nut_position_m"]) > 3e-3


def test_the_hop_is_predicted_down_to_the_noise_until_the_touchdown(flown: Path, tmp_path: Path) -> None:
    """Beyond the touchdown, small errors of the flight move the impact by more than its samples are apart."""
    measured = load_recording(flown / "hop_00.hop.csv.gz")
    predicted = simulated("hop", flown / "hop_00.hop.csv.gz", tmp_path / "hop.mcap")
    assert predicted.channels.keys() == OUTPUTS["hop"]
    (hop,) = json.loads((flown / "mission.json").read_text(encoding="utf-8"))["hops"]
    fire_s = measured.event_time_s("fire_command")
    assert fire_s is not None
    touchdown_s = fire_s + hop["truth"]["touchdown_s"] - hop["fire_s"]
    opening_s = fire_s + hop["truth"]["opening_s"] - hop["fire_s"]
    flying = (measured.times_s < touchdown_s - 2e-3) & (np.abs(measured.times_s - opening_s) > 2e-3)
    for channel in OUTPUTS["hop"]:
        assert rms_sigmas(measured, predicted, channel, flying) < 1.5, channel


@pytest.mark.parametrize("kind", ["drive", "hop"])
def test_what_was_measured_has_no_influence_on_the_prediction(kind: str, flown: Path, tmp_path: Path) -> None:
    recording = load_recording(flown / f"hop_00.{kind}.csv.gz")
    generator = np.random.default_rng(3)
    altered = {
        name: generator.normal(size=values.size) if name in OUTPUTS[kind] else values
        for name, values in recording.channels.items()
    }
    assert altered.keys() >= OUTPUTS[kind]
    (tmp_path / "other").mkdir()
    like = save_recording(replace(recording, channels=altered), tmp_path / "other" / f"hop_00.{kind}.csv")
    simulated(kind, flown / f"hop_00.{kind}.csv.gz", tmp_path / "true.csv")
    simulated(kind, like, tmp_path / "blind.csv")
    assert (tmp_path / "blind.csv").read_bytes() == (tmp_path / "true.csv").read_bytes()


def test_inputs_do_influence_the_prediction(flown: Path, tmp_path: Path) -> None:
    recording = load_recording(flown / "hop_00.drive.csv.gz")
    halved = {**recording.channels, "motor_voltage_v": 0.5 * recording.channels["motor_voltage_v"]}
    like = save_recording(replace(recording, channels=halved), tmp_path / "halved.csv")
    slow = simulated("drive", like, tmp_path / "slow.csv")
    true = simulated("drive", flown / "hop_00.drive.csv.gz", tmp_path / "true.csv")
    assert slow.channels["nut_position_m"][-1] < true.channels["nut_position_m"][-1] - 1e-3


def test_a_recording_goes_to_mcap_and_back_without_loss(flown: Path, tmp_path: Path) -> None:
    original = load_recording(flown / "hop_00.hop.csv.gz")
    done("convert", flown / "hop_00.hop.csv.gz", tmp_path / "a.mcap")
    done("convert", tmp_path / "a.mcap", tmp_path / "b.csv")
    for name in ("a.mcap", "b.csv"):
        assert load_recording(tmp_path / name).same_content(original)


def test_a_missions_folder_gives_its_recordings_and_not_its_log(flown: Path) -> None:
    assert [each.run[-10:] for each in load_recordings([flown])] == ["op00-drive", "-hop00-hop"]


MAPPING = {
    "format": 1,
    "time": {"variable": "t"},
    "channels": {"position_m": {"variable": "x", "unit": "mm"}, "force_n": {"variable": "u", "scale": 10.0}},
    "sidecar": {"rig": "cart", "kind": "axis"},
}


@pytest.mark.parametrize("suffix", ["csv", "mat"])
def test_a_foreign_file_is_imported_by_its_mapping(suffix: str, tmp_path: Path) -> None:
    (tmp_path / "cart.yaml").write_text(yaml.safe_dump(MAPPING, sort_keys=False), encoding="utf-8")
    source = tmp_path / f"lab.{suffix}"
    if suffix == "mat":
        savemat(
            source, {"t": [[0.0], [0.5], [1.0]], "x": [[0.0], [250.0], [1000.0]], "u": [[0.1], [0.2], [0.3]]}
        )
    else:
        source.write_text("t,x,u\n0,0,0.1\n0.5,250,0.2\n1,1000,0.3\n", encoding="utf-8")
    out = tmp_path / "out.csv"
    assert "position_m, force_n, 3 samples" in done(
        "import", source, "--map", tmp_path / "cart.yaml", "--out", out
    )
    recording = load_recording(out)
    np.testing.assert_allclose(recording.channels["position_m"], [0.0, 0.25, 1.0])
    np.testing.assert_allclose(recording.channels["force_n"], [1.0, 2.0, 3.0])
    assert (recording.rig, recording.kind) == ("cart", "axis")


@pytest.mark.parametrize("name", ["bb0b_drive", "bb0b_hop", "emps_published"])
def test_a_plant_that_is_sound_is_listed(name: str) -> None:
    path = config_path("plant", f"{name}.yaml")
    printed = done("plant", "check", path)
    assert done("plant", "check", name) == printed
    assert "sound" in printed
    for parameter, found in load_plant(path).flat().items():
        assert any(line.split()[1:4:2] == [parameter, f"{found.value:g}"] for line in printed.splitlines())
