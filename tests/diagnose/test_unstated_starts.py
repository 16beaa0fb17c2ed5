"""A body that was dropped or pushed by hand: the sidecars do not tell how it started, and the diagnosis finds it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ground import api
from ground.diagnose.pipeline import diagnose
from ground.recordings.model import Recording, SensorSpec
from ground.recordings.open_starts import unstated_starts, with_open_starts
from hal.config import config_path
from sim_hal.plant.simulate import EffectUse, Parameter, Plant, Run, compile_plant, load_plant

NOISE_M, NOISE_M_S2 = 0.01, 0.05
AREA_M2 = 4e-3
AIR = {"cd_a": Parameter(AREA_M2, 0.0, "m^2"), "rho": Parameter(1.2, 0.0, "kg/m^3")}
DRAG = EffectUse("aerodynamic_drag_quadratic", "ballistic", None, AIR)


@pytest.fixture
def body(tmp_path: Path) -> Plant:
    path = tmp_path / "body.yaml"
    path.write_text(
        "format: 1\nplant: body\nkind: drop\nparameters:\n"
        "  m: {value: 0.2, std: 0.0, unit: kg}\n  g: {value: 9.81, std: 0.0, unit: m/s^2}\n",
        encoding="utf-8",
    )
    return load_plant(path)


def drops(truth: Plant, seed: int, *channels: str) -> list[Recording]:
    """Drops from 30 m by a hand that is not quite still; nothing but the channels is written down."""
    generator, compiled = np.random.default_rng(seed), compile_plant(truth)
    noise = {"height_m": NOISE_M, "body_acceleration_m_s2": NOISE_M_S2}
    found = []
    for number in range(3):
        times = np.arange(110) * 0.02
        start = {"height_m": 30.0, "velocity_m_s": generator.normal(0.0, 0.5)}
        outputs = compiled.run(compiled.values, Run(times, {}, known=start))
        columns = dict(zip(compiled.output_names, outputs.T, strict=True))
        read = {
            name: columns[name] + noise[name] * generator.standard_normal(times.size) for name in channels
        }
        specs = {name: SensorSpec(noise_std=noise[name]) for name in channels}
        found.append(Recording(times, read, run=f"drop_{number}", rig="body", kind="drop", sensors=specs))
    return found


@pytest.mark.parametrize("channels", [("height_m",), ("height_m", "body_acceleration_m_s2")])
def test_what_the_air_does_is_found_without_a_stated_start(body: Plant, channels: tuple[str, ...]) -> None:
    found = diagnose(drops(body.with_effect(DRAG), 3, *channels), body).diagnosis
    assert (found.verdict, found.findings[0].physics_id) == ("mismatch", "aerodynamic_drag_quadratic")
    area = found.findings[0].parameters["cd_a"]
    assert abs(area.value - AREA_M2) < 4.0 * area.std < 0.5 * AREA_M2
    assert any("state.height_m, state.velocity_m_s" in note for note in found.notes)


@pytest.mark.parametrize("channels", [("height_m",), ("body_acceleration_m_s2",)])
def test_nothing_is_found_where_nothing_acts(body: Plant, channels: tuple[str, ...]) -> None:
    found = diagnose(drops(body, 4, *channels), body, reference=body).diagnosis
    assert found.verdict == "consistent"
    assert "reference" in found.details


def test_a_prediction_finds_its_start_in_the_first_samples(body: Plant) -> None:
    (recording, *_) = drops(body, 5, "height_m")
    predicted = api.simulate(body, recording)
    assert np.abs(predicted.channels["height_m"] - recording.channels["height_m"]).max() < 0.5


def test_a_start_that_is_told_is_taken(body: Plant) -> None:
    told = [replace(r, state={"height_m": 30.0, "velocity_m_s": 0.0}) for r in drops(body, 6, "height_m")]
    assert with_open_starts(body, told) is body
    partly = [replace(r, state={"height_m": 30.0}) for r in told]
    assert unstated_starts(body, partly) == ("velocity_m_s",)
    assert unstated_starts(body, [told[0], *partly]) == ("velocity_m_s",)


def test_a_latched_string_is_not_guessed(body: Plant) -> None:
    hop = load_plant(config_path("plant", "bb0b_hop.yaml"))
    assert unstated_starts(hop, drops(body, 7, "height_m")) == ()
