"""What is far larger or far smaller than such a thing ever is must not win by a hair, nor be claimed at all."""

from __future__ import annotations

from pathlib import Path

import diagnose_rig
import numpy as np
import pytest

from ground.diagnose.accept import identified
from ground.diagnose.candidates import EffectCandidate, effect_candidates, ranges_of
from ground.diagnose.data import prepare
from ground.diagnose.fit import fit_plant
from ground.diagnose.pipeline import diagnose
from ground.diagnose.result import Diagnosis
from ground.diagnose.scales import find_scales
from ground.recordings.model import Recording, SensorSpec
from sim_hal.plant.simulate import EffectUse, Parameter, Plant, Run, compile_plant, load_plant

NOISE = 0.15
WHEEL = """
format: 1
name: flywheel
kind: equations
inputs: {drive_n_m: N*m}
states:
  w: {unit: rad/s, initial: speed_rad_s}
parameters:
  inertia: {value: 0.05, std: 0.0, unit: kg*m^2}
  b: {value: 1.0e-4, std: 5.0e-5, unit: N*m*s}
equations:
  spin: {state: w, rate: "(drive_n_m - b * w) / inertia", balance: true, per_force: "1 / inertia", velocity: w}
outputs:
  speed_rad_s: {value: "w"}
"""


def wheel(folder: Path) -> Plant:
    path = folder / "wheel.yaml"
    path.write_text(WHEEL, encoding="utf-8")
    return load_plant(path)


def diagnosed(truth: Plant, given: Plant, drives_n_m: list[float]) -> Diagnosis:
    """A run for each drive: it acts one way and then the other; without any, the wheel coasts from its speed."""
    compiled = compile_plant(truth)
    times = 0.25 * np.arange(400)
    found = []
    for number, drive in enumerate(drives_n_m):
        torque = drive * np.sign(np.sin(2.0 * np.pi * times / 40.0))
        run = Run(times, {"drive_n_m": torque}, first_samples={"speed_rad_s": np.zeros(9)})
        clean = compiled.run(compiled.values, run, {"w": 0.0 if drive else 300.0})[:, 0]
        noise = NOISE * np.random.default_rng(number).standard_normal(times.size)
        channels = {"drive_n_m": torque, "speed_rad_s": clean + noise}
        sensors = {"speed_rad_s": SensorSpec(noise_std=NOISE)}
        found.append(
            Recording(times, channels, run=f"run{number}", rig="w", kind="equations", sensors=sensors)
        )
    return diagnose(found, given).diagnosis


def test_a_coast_down_is_rather_slowed_than_misread_by_far_more_than_sensors_do(tmp_path: Path) -> None:
    """One way only, dry friction is all but a drift by a tenth, and the very same as a bias beyond the speed."""
    given = wheel(tmp_path)
    dry = EffectUse("coulomb_friction", "spin", None, {"F_c": Parameter(0.03, 0.0, "N*m")})
    (found,) = diagnosed(given.with_effect(dry), given, [0.0]).findings
    assert found.kind == "physics"
    others = {other.physics_id: other.probability for other in found.alternatives}
    assert others["asymmetric_friction"] == pytest.approx(found.probability)
    assert all(p < 0.1 * found.probability for name, p in others.items() if name.startswith("sensor"))


@pytest.mark.parametrize("drift", [0.0, 0.05, 1.0])
def test_a_drift_is_still_found_be_it_usual_or_a_broken_sensors(tmp_path: Path, drift: float) -> None:
    given = wheel(tmp_path)
    use = EffectUse("sensor_drift", "sensor", "speed_rad_s", {"drift": Parameter(drift, 0.0, "s**-2")})
    result = diagnosed(given.with_effect(use) if drift else given, given, [0.5, 0.8, 0.3])
    assert [f.physics_id for f in result.findings] == (["sensor_drift"] if drift else [])
    for found in result.findings:
        assert found.parameters["drift"].value == pytest.approx(drift, rel=0.1)


@pytest.mark.parametrize(("samples", "told"), [(0.02, False), (0.5, True)])
def test_a_clock_must_be_off_by_more_than_time_stamps_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, samples: float, told: bool
) -> None:
    """All but free of noise, the readings show a clock that gains a fiftieth of a sample in all: nobody's finding."""
    monkeypatch.setattr(diagnose_rig, "NOISE_M", 2e-5)
    given = diagnose_rig.plant(tmp_path)
    skew = Parameter(samples * 0.01 / 9.0, 0.0, "1")
    truth = given.with_effect(EffectUse("clock_skew", "sensor", "position_m", {"skew": skew}))
    data = prepare(diagnose_rig.recordings(truth, 5, samples=900), given)
    refit = fit_plant(given, data.windows, data.sigmas, {}, tolerance=1e-6)
    scales = find_scales(refit, data.windows)
    candidate = next(c for c in effect_candidates(given, scales) if c.physics_id == "clock_skew")
    assert isinstance(candidate, EffectCandidate)
    plant = candidate.joined(given)
    fit = fit_plant(plant, data.windows, data.sigmas, ranges_of(plant, scales), tolerance=1e-6, near=refit)
    (name,) = candidate.strengths()
    assert abs(fit.values[name]) > 3.0 * fit.std[name]
    assert fit.chi2 < refit.chi2
    assert identified(candidate, fit, data.windows, fit.chi2) == told
