"""A recording drives the simulation of a plant of its kind, or is refused in words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recording_samples import SHARED, small_hop

from ground.recordings import Event, RecordingError, load_recording
from ground.recordings.plant_run import FIRST_SAMPLES, to_run
from hal.config import config_path
from sim_hal.plant.simulate import load_plant


def test_a_hop_gives_its_event_state_and_conditions() -> None:
    plant = load_plant(config_path("plant", "bb0b_hop.yaml"))
    hop = small_hop()
    run = to_run(replace(hop, events=(*hop.events, Event("fire_command", 9.0))), plant)
    np.testing.assert_array_equal(run.times_s, hop.times_s)
    assert run.events == {"fire_command": 0.001}  # the first of its name
    assert run.known == {"spring_compression_m": 0.0362}
    assert run.conditions["surface"] == "quartz_sand"
    assert not run.inputs


def test_another_kind_a_lacking_input_and_nothing_to_predict_are_refused() -> None:
    drive = load_plant(config_path("plant", "bb0b_drive.yaml"))
    hop = small_hop()
    with pytest.raises(RecordingError, match="kind is 'hop', the plant 'bb0b' is of kind 'drive'"):
        to_run(hop, drive)
    with pytest.raises(RecordingError, match="needs the input 'motor_voltage_v'; channels here: body_acc"):
        to_run(replace(hop, kind="drive"), drive)
    voltage = {"motor_voltage_v": hop.times_s}
    with pytest.raises(RecordingError, match="no channel that 'bb0b' predicts"):
        to_run(replace(hop, kind="drive", channels=voltage), drive)


def test_a_practice_drive_hands_over_its_voltage() -> None:
    path = SHARED / "practice/case_04/train/run_01.csv.gz"
    if not path.is_file():
        pytest.skip("the practice recordings are not here")
    recording = load_recording(path)
    run = to_run(recording, load_plant(config_path("plant", "bb0b_drive.yaml")))
    np.testing.assert_array_equal(run.inputs["motor_voltage_v"], recording.channels["motor_voltage_v"])
    assert run.known == {"spring_compression_m": 0.0, "nut_position_m": 0.0}
    assert all(values.size == FIRST_SAMPLES for values in run.first_samples.values())
