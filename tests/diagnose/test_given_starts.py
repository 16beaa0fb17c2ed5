"""One recording of a rig whose start is given: what is held out of it is predicted from that start."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from diagnose_rig import NOISE_M, TEXT, friction

from ground.diagnose.pipeline import diagnose
from ground.recordings.model import Recording, SensorSpec
from sim_hal.plant.simulate import Plant, Run, compile_plant, load_plant


def let_go(folder: Path) -> Plant:
    """The rig as its author describes it who lets it go from rest, 0.2 m away."""
    path = folder / "let_go.yaml"
    text = TEXT.replace("initial: position_m", "initial: 0.2").replace("initial: fit", "initial: 0.0")
    path.write_text(text, encoding="utf-8")
    return load_plant(path)


def swing(truth: Plant, seed: int) -> Recording:
    compiled, times = compile_plant(truth), 0.01 * np.arange(800)
    position = compiled.run(compiled.values, Run(times, {"push_n": 0.0 * times}))[:, 0]
    noise = NOISE_M * np.random.default_rng(seed).standard_normal(times.size)
    sensors = {"position_m": SensorSpec(noise_std=NOISE_M)}
    channels = {"push_n": 0.0 * times, "position_m": position + noise}
    return Recording(times, channels, run="swing", rig="oscillator", kind="bench", sensors=sensors)


def test_friction_is_found_and_the_end_of_the_swing_predicted(tmp_path: Path) -> None:
    given = let_go(tmp_path)
    truth = replace(given, effects=(friction(0.5),))
    found = diagnose([swing(truth, 1)], given).diagnosis
    assert found.verdict == "mismatch"
    assert [one.physics_id for one in found.findings] == ["coulomb_friction"]
    fit = found.fit["position_m"]
    assert fit.extended_rms < 1.1 * NOISE_M < 0.2 * fit.refit_rms


def test_nothing_is_found_where_nothing_is(tmp_path: Path) -> None:
    given = let_go(tmp_path)
    found = diagnose([swing(given, 2)], given).diagnosis
    assert found.verdict == "consistent"
    assert not found.findings
    assert found.fit["position_m"].refit_rms < 1.1 * NOISE_M
