"""A ripple is read at full rate: period and both parts as planted, however quick; where none is, none is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ground.diagnose.data import prepare
from ground.diagnose.fit import fit_plant
from ground.diagnose.locate import locate
from ground.diagnose.periods import with_periods
from ground.diagnose.pipeline import diagnose
from ground.diagnose.ripple import Ripple
from ground.diagnose.scales import find_scales
from ground.diagnose.workers import Workers
from ground.recordings.model import Recording, SensorSpec
from sim_hal.plant.simulate import EffectUse, Parameter, Plant, Run, compile_plant, load_plant

NOISE_RAD = 1e-3
SAMPLES, STEP_S = 1500, 0.002

TEXT = """
format: 1
name: motor
kind: equations
inputs: {current_a: A}
states:
  q: {unit: rad, initial: angle_rad}
  w: {unit: rad/s, initial: fit}
parameters:
  inertia: {value: 2.0e-4, std: 1.0e-5, unit: kg*m^2}
  torque_constant: {value: 0.05, std: 0.001, unit: N*m/A}
  viscous: {value: 4.0e-4, std: 1.0e-4, unit: N*m*s/rad}
effects:
  - {physics_id: coulomb_friction, equation: torque, parameters: {F_c: {value: 0.004, std: 0.001, unit: N*m}}}
equations:
  kinematics: {state: q, rate: "w"}
  torque: {state: w, rate: "(torque_constant * current_a - viscous * w) / inertia", balance: true,
           per_force: "1 / inertia", velocity: w, position: q}
outputs:
  angle_rad: {value: "q"}
sensors:
  angle_rad: {noise_std: 1.0e-3}
"""


@pytest.fixture
def motor(tmp_path: Path) -> Plant:
    path = tmp_path / "motor.yaml"
    path.write_text(TEXT, encoding="utf-8")
    return load_plant(path)


def cogging(sine: float, cosine: float, teeth: int) -> EffectUse:
    parts = {"F_sin": Parameter(sine, 0.0, "N*m"), "F_cos": Parameter(cosine, 0.0, "N*m")}
    return EffectUse(
        "torque_ripple", "torque", None, {**parts, "period": Parameter(2.0 * np.pi / teeth, 0.0, "rad")}
    )


def runs(truth: Plant, seed: int, count: int = 3) -> list[Recording]:
    """Swings of the motor over several turns, driven by three sines."""
    generator, times = np.random.default_rng(seed), STEP_S * np.arange(SAMPLES)
    compiled, found = compile_plant(truth), []
    for number in range(count):
        current = sum(
            generator.uniform(0.25, 0.55) * np.sin(2.0 * np.pi * f * times + generator.uniform(0.0, 6.28))
            for f in (0.4, 0.9, 1.6)
        )
        run = Run(times, {"current_a": current}, first_samples={"angle_rad": np.zeros(20)})
        angle = compiled.run(compiled.values, run, {"q": 0.0, "w": 0.0})[:, 0]
        found.append(
            Recording(
                times,
                {"current_a": current, "angle_rad": angle + NOISE_RAD * generator.standard_normal(SAMPLES)},
                run=f"run_{number}",
                rig="motor",
                kind="equations",
                sensors={"angle_rad": SensorSpec(noise_std=NOISE_RAD)},
            )
        )
    return found


def ripple_seen(given: Plant, recordings: list[Recording]) -> tuple[Ripple | None, dict[str, float]]:
    """What is said of a ripple, and the scales that a search begins with."""
    data = prepare(recordings, given)
    refit = fit_plant(given, data.windows, data.sigmas, {})
    scales = find_scales(refit, data.windows)
    with Workers(data.windows, data.sigmas, scales, 1) as workers:
        (force,) = locate(refit, data.windows, data.whole[0], data.sigmas, scales, workers)
    return force.ripple, with_periods(scales, [force])["torque"]


@pytest.mark.parametrize(("teeth", "seed"), [(2, 1), (7, 4), (12, 3)])
def test_a_planted_ripple_is_read_with_its_parts(motor: Plant, teeth: int, seed: int) -> None:
    truth = motor.with_effect(cogging(-0.003, 0.002, teeth))
    ripple, scales = ripple_seen(motor, runs(truth, seed))
    assert ripple is not None
    assert ripple.period == pytest.approx(2.0 * np.pi / teeth, rel=0.01)
    assert abs(complex(ripple.sine, ripple.cosine) - (-0.003 + 0.002j)) < 0.4 * abs(-0.003 + 0.002j)
    assert (scales["P"], scales["A_sin"], scales["A_cos"]) == (ripple.period, ripple.sine, ripple.cosine)


@pytest.mark.parametrize("seed", [1, 2, 3, 6])
def test_where_there_is_none_none_is_said(motor: Plant, seed: int) -> None:
    ripple, scales = ripple_seen(motor, runs(motor, seed))
    assert ripple is None
    assert scales["A_sin"] == scales["A_cos"] == pytest.approx(0.02 * scales["F"])


def test_a_part_that_is_next_to_nothing_can_still_grow(motor: Plant) -> None:
    truth = motor.with_effect(cogging(0.0, -0.004, 7))
    ripple, scales = ripple_seen(motor, runs(truth, 4))
    assert ripple is not None
    assert abs(scales["A_sin"]) >= 0.1 * np.hypot(ripple.sine, ripple.cosine)


def test_the_teeth_of_a_motor_are_named(motor: Plant) -> None:
    """Too quick for a force that was smoothed, and too strong for a search that begins without it."""
    answer = diagnose(runs(motor.with_effect(cogging(-0.003, 0.002, 7)), 5, count=2), motor).diagnosis
    assert [finding.physics_id for finding in answer.findings] == ["torque_ripple"]
    told = answer.findings[0].parameters
    assert told["period"].value == pytest.approx(2.0 * np.pi / 7.0, rel=1e-3)
    for name, true in (("F_sin", -0.003), ("F_cos", 0.002)):
        assert abs(told[name].value - true) < 4.0 * told[name].std
        assert told[name].std < 3e-4
