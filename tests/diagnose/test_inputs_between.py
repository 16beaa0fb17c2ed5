"""What an input does between its samples: planted ways are found, and the right one stays."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from diagnose_rig import NOISE_M, TEXT

from ground.diagnose.pipeline import Outcome, diagnose
from ground.recordings.model import Recording, SensorSpec
from sim_hal.plant.simulate import Plant, Run, compile_plant, load_plant

SAMPLES, STEP_S = 200, 0.02


def oscillator(folder: Path, stated: str | None = None) -> Plant:
    entry = "{unit: N}" if stated is None else f"{{unit: N, interpolation: {stated}}}"
    path = folder / "oscillator.yaml"
    path.write_text(
        TEXT.replace("{push_n: N}", f"{{push_n: {entry}}}").replace("value: 50.0", "value: 5000.0"), "utf-8"
    )
    return load_plant(path)


def outcome(given: Plant, truth: Plant) -> Outcome:
    """Runs of a rig that is driven up to a third of the sample rate, near its resonance at 8 Hz."""
    generator = np.random.default_rng(4)
    compiled = compile_plant(truth)
    times = STEP_S * np.arange(SAMPLES)
    runs = []
    for number in range(3):
        waves = [(generator.uniform(20.0, 60.0), f, generator.uniform(0, 6.28)) for f in (2, 5, 8, 11, 14)]
        push = sum(a * np.sin(2 * np.pi * f * times + phase) for a, f, phase in waves)
        run = Run(times, {"push_n": push}, first_samples={"position_m": np.zeros(20)})
        clean = compiled.run(compiled.values, run, {"q": 0.0, "v": 0.0})[:, 0]
        channels = {"push_n": push, "position_m": clean + NOISE_M * generator.standard_normal(SAMPLES)}
        sensors = {"position_m": SensorSpec(noise_std=NOISE_M)}
        runs.append(
            Recording(times, channels, run=f"run_{number}", rig="oscillator", kind="bench", sensors=sensors)
        )
    return diagnose(runs, given)


@pytest.mark.parametrize(("true_way", "stated"), [("hold", "linear"), ("linear", None), ("cubic", None)])
def test_the_way_that_predicts_is_found_and_no_physics_claimed(
    tmp_path: Path, true_way: str, stated: str | None
) -> None:
    given = oscillator(tmp_path, stated)
    found = outcome(given, given.with_interpolation(true_way))
    inputs = found.plant.structure.inputs
    assert inputs["push_n"].interpolation == true_way
    assert found.diagnosis.findings == ()
    told = [note for note in found.diagnosis.notes if f"interpolation: {true_way}" in note]
    assert bool(told) == (true_way != "linear")
