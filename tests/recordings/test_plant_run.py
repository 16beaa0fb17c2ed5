"""A recording drives the simulation of a plant of its kind, or is refused in words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import yaml
from recording_samples import SHARED, small_hop

from ground.diagnose.windows import segments_to_fit
from ground.recordings import Event, Recording, RecordingError, load_recording
from ground.recordings.plant_run import FIRST_SAMPLES, to_run
from hal.config import config_path
from sim_hal.plant.plantfile import read_plant
from sim_hal.plant.simulate import Plant, compile_plant, load_plant


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


CART = """
format: 1
name: cart
kind: equations
inputs: {force_n: N}
states:
  q: {unit: m, initial: position_m}
  v: {unit: m/s, initial: fit}
parameters:
  mass: {value: 2.0, std: 0.2, unit: kg}
equations:
  kinematics: {state: q, rate: v}
  force_balance: {state: v, rate: force_n / mass, balance: true, per_force: 1 / mass}
outputs:
  position_m: {value: q}
"""


def cart_run(unread: slice, channel: str = "position_m") -> tuple[Recording, Plant]:
    times = 0.01 * np.arange(800)
    channels = {"force_n": np.sin(times), "position_m": 0.5 * (times - np.sin(times))}
    channels[channel][unread] = np.nan
    return Recording(times, channels, run="a", rig="cart", kind="axis"), read_plant(
        yaml.safe_load(CART), "cart.yaml"
    )


def test_a_start_that_nothing_tells_is_refused_with_its_channel() -> None:
    with pytest.raises(RecordingError, match=r"a: a start is read from the first 20 samples of 'position_m'"):
        to_run(*cart_run(slice(0, FIRST_SAMPLES)))
    to_run(*cart_run(slice(1, FIRST_SAMPLES)))


def test_an_input_without_readings_is_refused_with_its_channel() -> None:
    with pytest.raises(RecordingError, match=r"a: the input 'force_n' has no reading at all"):
        to_run(*cart_run(slice(None), "force_n"))


def test_windows_that_begin_in_a_gap_are_left_out() -> None:
    whole, plant = cart_run(slice(0, 0))
    holed, _ = cart_run(slice(150, 350))
    compiled = compile_plant(plant)
    starts = [[s.run.times_s[0] for s in segments_to_fit([r], plant, compiled)] for r in (whole, holed)]
    assert [start for start in starts[0] if not 1.5 <= start < 3.4] == starts[1]
    assert len(starts[1]) < len(starts[0])
