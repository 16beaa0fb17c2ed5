"""Recordings cut from a flight log say what the simulated robot did, in the conventions of the plants."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flight.log import FlightLog, read_log
from ground.recordings import Recording, RecordingError, load_recordings
from ground.recordings.from_log import (
    held_compression_m,
    recordings_from_log,
    sensors_of_rig,
    string_taut,
    write_hop_recordings,
)
from ground.recordings.log_channels import Channels, Series, Stretch
from ground.recordings.plant_run import to_run
from hal.config import config_path
from sim_hal.plant.simulate import compile_plant, load_plant
from sim_hal.truth import HopTruth

Flown = tuple[Path, HopTruth]


@pytest.fixture(scope="module")
def written(flown: Flown, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Recording]:
    """The recordings of the mission's only hop, read back from their files, by kind."""
    folder = tmp_path_factory.mktemp("hops")
    (hop,) = write_hop_recordings(flown[0], folder)
    read = {recording.kind: recording for recording in load_recordings([folder])}
    assert read["drive"].same_content(hop.drive)
    assert read["hop"].same_content(hop.hop)
    assert [hop.drive.source, hop.hop.source] == [
        folder / f"hop_00.{kind}.csv.gz" for kind in ("drive", "hop")
    ]
    return read


@pytest.fixture(scope="module")
def log(flown: Flown) -> FlightLog:
    """The log of the mission, read."""
    return read_log(flown[0])


def standardised(recording: Recording) -> dict[str, np.ndarray]:
    """Residuals of the plant that the simulated robot is made of, over the sensors' noise."""
    plant = load_plant(config_path("plant", f"bb0b_{recording.kind}.yaml"))
    compiled = compile_plant(plant)
    predicted = compiled.run(compiled.values, to_run(recording, plant))
    columns = {name: index for index, name in enumerate(compiled.output_names)}
    sigmas = {name: spec.noise_std or 1e-5 for name, spec in recording.sensors.items()}  # 10 um: the encoder
    return {
        name: (recording.channels[name] - predicted[:, columns[name]]) / sigmas[name]
        for name in recording.channels
        if name in columns
    }


def test_the_drive_is_predicted_to_its_noise(written: dict[str, Recording]) -> None:
    drive = written["drive"]
    assert list(drive.channels) == [
        "motor_current_a",
        "nut_position_m",
        "spring_compression_m",
        "motor_voltage_v",
    ]
    assert np.isfinite(drive.channels["motor_voltage_v"]).all()
    for name, residual in standardised(drive).items():
        seen = residual[np.isfinite(residual)]
        assert seen.size >= drive.times_s.size - 2
        assert np.sqrt(np.mean(seen**2)) < 1.1, name
        assert np.abs(seen).max() < 6.0, name


def test_the_drive_starts_at_rest_with_a_slack_string_and_counts_from_taut(
    written: dict[str, Recording], flown: Flown
) -> None:
    drive = written["drive"]
    assert drive.times_s[0] == 0.0
    assert drive.state["spring_compression_m"] == 0.0
    assert -0.003 < drive.state["nut_position_m"] < 0.0
    speed_m_s = np.diff(drive.channels["nut_position_m"][1:4]) / np.diff(drive.times_s[1:4])
    assert np.abs(speed_m_s).max() < 3e-4  # a tenth of the speed of homing and tensioning
    compliance = 1.0 + 30600.0 / 190000.0
    assert drive.channels["nut_position_m"][-1] == pytest.approx(
        flown[1].spring_compression_m * compliance, abs=4 * 1.5e-6 * compliance
    )


def test_the_hop_is_predicted_to_its_noise_until_the_landing(
    written: dict[str, Recording], flown: Flown
) -> None:
    hop, truth = written["hop"], flown[1]
    start_s = truth.fire_s - hop.events[0].time_s
    assert truth.touchdown_s is not None
    opening_s, touchdown_s = truth.opening_s - start_s, truth.touchdown_s - start_s
    before_landing = hop.times_s < touchdown_s - 1e-3
    away_from_opening = np.abs(hop.times_s - opening_s) > 1.5e-3  # where the acceleration steps
    for name, residual in standardised(hop).items():
        seen = residual[before_landing & away_from_opening & np.isfinite(residual)]
        assert seen.size > 30, name
        assert np.sqrt(np.mean(seen**2)) < 1.2, name


def test_the_hop_says_when_it_fired_and_what_was_stored(written: dict[str, Recording], flown: Flown) -> None:
    hop, truth = written["hop"], flown[1]
    assert [event.name for event in hop.events] == ["fire_command"]
    assert hop.events[0].time_s == pytest.approx(0.05, abs=1e-9)
    assert hop.state["spring_compression_m"] == pytest.approx(truth.spring_compression_m, abs=4 * 2.5e-6)
    assert hop.conditions == {
        "surface": "quartz_sand",
        "foot": 1,
        "tilt_deg": 0.0,
        "gravity_m_s2": 8.874,
        "hop_index": 0,
        "place": "A",
    }
    assert truth.touchdown_s is not None
    ends_s = hop.times_s[-1] - hop.events[0].time_s
    assert ends_s == pytest.approx(truth.touchdown_s - truth.fire_s + 0.5, abs=2e-3)
    magnet = hop.channels["magnet_current_a"]
    assert np.nanmax(magnet) > 0.9
    assert np.isnan(magnet[hop.times_s > 0.2]).all()


def test_readings_are_kept_as_they_were_sampled(
    written: dict[str, Recording], flown: Flown, log: FlightLog
) -> None:
    hop = written["hop"]
    sampled: dict[float, float] = {}
    for message in log.messages:
        if message.topic == "accelerometer" and message.payload["method"] == "read":
            reading = message.payload["result"]
            sampled |= dict(zip(reading["times_s"], reading["specific_force_m_s2"], strict=True))
    start_s = flown[1].fire_s - hop.events[0].time_s
    taken = np.isfinite(hop.channels["body_acceleration_m_s2"])
    for time_s, value in zip(hop.times_s[taken], hop.channels["body_acceleration_m_s2"][taken], strict=True):
        nearest = min(sampled, key=lambda at_s: abs(at_s - start_s - time_s))
        assert abs(nearest - start_s - time_s) < 1e-9
        assert sampled[nearest] == value
        if time_s > 0.1:
            break


def test_sensors_come_from_the_plant_files_of_the_rig(written: dict[str, Recording]) -> None:
    assert dict(written["hop"].sensors) == dict(sensors_of_rig("bb0b")["hop"])
    assert written["hop"].sensors["body_acceleration_m_s2"].noise_std == 0.035


def without(log: FlightLog, topic: str) -> FlightLog:
    return replace(log, messages=tuple(message for message in log.messages if message.topic != topic))


@pytest.mark.parametrize("topic", ["nut_encoder", "motor_current", "spring", "accelerometer", "motor"])
def test_a_log_without_a_devices_readings_is_refused_in_words(log: FlightLog, topic: str) -> None:
    with pytest.raises(
        RecordingError, match=r"flight\.mcap: hop 0: .*(the log has no \w+_(m|a|v|m_s2) from)"
    ):
        recordings_from_log(without(log, topic))


def test_a_log_without_hops_gives_no_recordings(log: FlightLog) -> None:
    assert recordings_from_log(without(log, "state")) == ()


def test_string_taut_is_as_uncertain_as_it_says() -> None:
    random = np.random.default_rng(5)
    position_m = np.linspace(-0.001, 0.012, 2600)
    misses = []
    for taut_m in random.uniform(-1e-4, 1e-4, 400):
        true_m = np.maximum(0.0, (position_m - taut_m) / 1.161)
        seen_m = np.clip(np.round((true_m + 20e-6 * random.standard_normal(2600)) / 5e-6) * 5e-6, 0.0, 0.06)
        found = string_taut(position_m, seen_m)
        misses.append((found.position_m - taut_m) / found.sigma_m)
    assert 0.90 < np.mean(np.abs(misses) < 1.96) < 0.98
    assert abs(np.mean(misses)) < 0.25  # of a sigma


def test_the_held_compression_is_as_uncertain_as_it_says() -> None:
    random = np.random.default_rng(6)
    slow_s, fast_s = np.arange(0.0, 2.0, 0.005), 2.0 + np.arange(1, 430) / 1666.0
    nut_m = np.where(slow_s < 1.6, 0.030 + 0.003 * (slow_s - 1.6), 0.030)
    stretch = Stretch(0.0, 0.0, 2.0, 2.26, 2.3, 3.0, None)
    misses = []
    for _ in range(400):
        drift_m = np.where(slow_s < 1.6, nut_m - 0.030, 0.0)
        seen_m = np.append(
            0.026 + drift_m + 20e-6 * random.standard_normal(slow_s.size),
            0.026 + 50e-6 * random.standard_normal(fast_s.size),
        )
        series = {
            "nut_position_m": Series(slow_s.tolist(), nut_m.tolist()),
            "spring_compression_m": Series([*slow_s, *fast_s], (np.round(seen_m / 5e-6) * 5e-6).tolist()),
        }
        held_m, sigma_m = held_compression_m(Channels(series, ()), stretch)
        misses.append((held_m - 0.026) / sigma_m)
    assert 0.90 < np.mean(np.abs(misses) < 1.96) < 0.98
    assert abs(np.mean(misses)) < 0.25


def test_a_nut_that_does_not_pull_gives_no_string_taut() -> None:
    position_m = np.linspace(0.0, 0.01, 100)
    for compression_m, says in (
        (np.zeros(100), "only 0 samples of the taut string"),
        (np.linspace(0.01, 0.0, 100), "the spring does not follow the nut"),
    ):
        with pytest.raises(RecordingError, match=says):
            string_taut(position_m, compression_m)
    with pytest.raises(RecordingError, match="the nut does not move"):
        string_taut(np.zeros(100), np.linspace(0.0, 0.01, 100))
