"""Traps that real recordings set, each with a planted truth: a late input, a loop, a clock that drifts ..."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ground.diagnose.pipeline import diagnose
from ground.diagnose.result import Diagnosis
from ground.recordings.model import Recording, SensorSpec
from sim_hal.plant.simulate import EffectUse, Parameter, Plant, Simulator, compile_plant, load_plant
from sim_hal.plant.simulate import Run as PlantRun

STEP_S = 0.01
SAMPLES = 240
NOISE_M = 1e-4

CART = """
format: 1
name: cart
kind: equations
inputs: {{push_n: {{unit: N, interpolation: hold}}}}
states:
  q: {{unit: m, initial: {start}}}
  v: {{unit: m/s, initial: {speed}}}
parameters:
  mass: {{value: 2.0, std: 0.1, unit: kg}}
  damping: {{value: 3.0, std: 0.6, unit: N*s/m}}
equations:
  kinematics: {{state: q, rate: "v"}}
  force_balance: {{state: v, rate: "(push_n - damping * v) / mass", balance: true, per_force: "1 / mass",
                  velocity: v, position: q}}
outputs:
  position_m: {{value: "q"}}
"""


def cart(folder: Path, start: str = "position_m", speed: str = "fit") -> Plant:
    """A driven cart whose nominal plant has mass and damping, as its first author would write it."""
    path = folder / "cart.yaml"
    path.write_text(CART.format(start=start, speed=speed), encoding="utf-8")
    return load_plant(path)


def use(
    physics_id: str, equation: str = "force_balance", channel: str | None = None, **values: float
) -> EffectUse:
    units = {"F_c": "N", "F_o": "N", "delay": "s", "skew": "1", "k_e": "N/m", "x_e": "m"}
    return EffectUse(
        physics_id, equation, channel, {name: Parameter(v, 0.0, units[name]) for name, v in values.items()}
    )


def push(generator: np.random.Generator, count: int = SAMPLES) -> np.ndarray:
    """A push that is steady for a while, then another: rich, and with edges."""
    return np.repeat(generator.uniform(-6.0, 6.0, count // 20 + 1), 20)[:count]


def recorded(
    truth: Plant, pushes: list[np.ndarray], seed: int, driven: list[np.ndarray] | None = None
) -> list[Recording]:
    """Runs of the true rig; it is driven by `driven` where that is not what was recorded as its push."""
    generator = np.random.default_rng(seed)
    compiled = compile_plant(truth)
    found = []
    for number, recorded_push in enumerate(pushes):
        times = STEP_S * np.arange(recorded_push.size)
        acting = driven[number] if driven else recorded_push
        run = PlantRun(times, {"push_n": acting}, first_samples={"position_m": np.zeros(20)})
        position = compiled.run(compiled.values, run, {"q": 0.0, "v": 0.0})[:, 0]
        noisy = position + NOISE_M * generator.standard_normal(times.size)
        found.append(recording(number, times, recorded_push, noisy, SensorSpec(noise_std=NOISE_M)))
    return found


def recording(
    number: int, times: np.ndarray, force: np.ndarray, position: np.ndarray, sensor: SensorSpec
) -> Recording:
    channels = {"push_n": force, "position_m": position}
    return Recording(
        times, channels, run=f"run_{number}", rig="cart", kind="bench", sensors={"position_m": sensor}
    )


def pushes(seed: int, count: int = 3) -> list[np.ndarray]:
    generator = np.random.default_rng(seed)
    return [push(generator) for _ in range(count)]


def answer(recordings: list[Recording], given: Plant) -> Diagnosis:
    return diagnose(recordings, given).diagnosis


def test_an_input_that_acts_a_sample_late_is_found_as_a_delay(tmp_path: Path) -> None:
    """The recorded push acted one sample later: seen from the push, the reading is late."""
    given, recorded_pushes = cart(tmp_path), pushes(1)
    late = [np.concatenate([one[:1], one[:-1]]) for one in recorded_pushes]
    found = answer(recorded(given, recorded_pushes, 1, driven=late), given)
    assert found.verdict == "mismatch"
    assert found.findings[0].physics_id == "sensor_delay"
    delay = found.findings[0].parameters["delay"]
    assert abs(delay.value - STEP_S) < 0.3 * STEP_S


def closed_loop(truth: Plant, seed: int, kp: float = 400.0, kd: float = 40.0) -> list[Recording]:
    """A controller that keeps the cart on its reference, from noisy readings: input and noise correlate."""
    generator = np.random.default_rng(seed)
    found = []
    for number in range(3):
        times = STEP_S * np.arange(SAMPLES)
        wanted = 0.1 * np.sin(2 * np.pi * (0.8 + 0.4 * number) * times)
        robot = Simulator(truth)
        force, position, last = np.zeros(SAMPLES), np.zeros(SAMPLES), 0.0
        for k in range(SAMPLES):
            position[k] = robot.outputs()["position_m"] + NOISE_M * generator.standard_normal()
            error = wanted[k] - position[k]
            force[k] = kp * error + kd * (error - last) / STEP_S
            last = error
            robot.advance(STEP_S * (k + 1), {"push_n": float(force[k])})
        found.append(recording(number, times, force, position, SensorSpec(noise_std=NOISE_M)))
    return found


def test_friction_that_a_controller_compensates_is_found_from_the_force_it_needs(tmp_path: Path) -> None:
    robot, given = cart(tmp_path, "0.0", "0.0"), cart(tmp_path)
    found = answer(closed_loop(robot.with_effect(use("coulomb_friction", F_c=2.0)), 2), given)
    assert found.findings[0].physics_id == "coulomb_friction"
    level = found.findings[0].parameters["F_c"]
    assert abs(level.value - 2.0) < max(4.0 * level.std, 0.1)


def test_a_controller_alone_is_taken_for_nothing(tmp_path: Path) -> None:
    found = answer(closed_loop(cart(tmp_path, "0.0", "0.0"), 3), cart(tmp_path))
    assert found.verdict == "consistent", [f.statement for f in found.findings]


def test_on_one_way_motion_dry_friction_and_a_constant_force_share_the_probability(tmp_path: Path) -> None:
    """Only their sum can be told there, and the answer says so."""
    given = cart(tmp_path)
    truth = given.with_effect(use("coulomb_friction", F_c=1.5)).with_effect(
        use("asymmetric_friction", F_o=0.5)
    )
    forward = [np.abs(one) + 4.0 for one in pushes(4)]
    found = answer(recorded(truth, forward, 4), given)
    names = {found.findings[0].physics_id, *(a.physics_id for a in found.findings[0].alternatives)}
    assert {"coulomb_friction", "asymmetric_friction"} <= names
    assert len(found.findings) == 1
    (size,) = [p.value for p in found.findings[0].parameters.values()]
    assert size == pytest.approx(2.0, abs=0.15)
    assert found.next_experiment is not None


def test_moving_both_ways_tells_dry_friction_from_a_constant_force(tmp_path: Path) -> None:
    """A tilted rig: gravity's part along the rail is the constant force."""
    given = cart(tmp_path)
    truth = given.with_effect(use("coulomb_friction", F_c=1.5)).with_effect(
        use("asymmetric_friction", F_o=0.7)
    )
    found = answer(recorded(truth, pushes(5), 5), given)
    sizes = {f.physics_id: next(iter(f.parameters.values())) for f in found.findings}
    assert set(sizes) == {"coulomb_friction", "asymmetric_friction"}
    assert sizes["coulomb_friction"].value == pytest.approx(
        1.5, abs=max(0.1, 4.0 * sizes["coulomb_friction"].std)
    )
    assert sizes["asymmetric_friction"].value == pytest.approx(0.7, abs=0.1)


def coarse(recordings: list[Recording], step_m: float) -> list[Recording]:
    """The same read by a coarse encoder."""
    found = []
    for one in recordings:
        position = step_m * np.round(one.channels["position_m"] / step_m)
        spec = {"position_m": SensorSpec(resolution=step_m)}
        found.append(replace(one, channels={**one.channels, "position_m": position}, sensors=spec))
    return found


@pytest.mark.parametrize("level_n", [0.0, 1.5])
def test_a_coarse_encoder_is_no_physics_and_hides_none(tmp_path: Path, level_n: float) -> None:
    given = cart(tmp_path)
    truth = given.with_effect(use("coulomb_friction", F_c=level_n)) if level_n else given
    found = answer(coarse(recorded(truth, pushes(6), 6), 5e-3), given)
    assert [f.physics_id for f in found.findings] == (["coulomb_friction"] if level_n else [])


def test_a_clock_that_runs_slow_is_found(tmp_path: Path) -> None:
    given = cart(tmp_path, "0.0", "0.0")  # of known start: no window hides how the lateness grows
    truth = given.with_effect(use("clock_skew", "sensor", "position_m", skew=-0.02))
    found = answer(recorded(truth, pushes(7), 7), given)
    assert found.findings[0].physics_id == "clock_skew"
    assert found.findings[0].parameters["skew"].value == pytest.approx(-0.02, abs=4e-3)


def test_what_the_runs_never_reach_is_not_claimed_and_said_to_be_untold(tmp_path: Path) -> None:
    """A stop beyond the travel of all runs: nothing is found, and the answer says that a stop could not have been."""
    given = cart(tmp_path)
    truth = given.with_effect(use("end_stop", k_e=5000.0, x_e=50.0))
    found = answer(recorded(truth, pushes(8), 8), given)
    assert found.verdict == "consistent"
    assert found.findings == ()


def test_a_rig_whose_position_is_a_voltage_is_diagnosed_too(tmp_path: Path) -> None:
    """An electronic oscillator: no newton anywhere, a cubic spring planted."""
    path = tmp_path / "box.yaml"
    path.write_text(BOX, encoding="utf-8")
    given = load_plant(path)
    spring = EffectUse("progressive_spring", "force_balance", None, {"k_3": Parameter(8.0, 0.0, "V**-2")})
    recordings = []
    compiled = compile_plant(given.with_effect(spring))
    for number, generator in enumerate(np.random.default_rng(9).spawn(2)):
        times = 2e-3 * np.arange(SAMPLES // 2)
        drive = sum(
            0.05 * np.sin(2 * np.pi * f * times + generator.uniform(0.0, 6.28)) for f in (7.0, 19.0, 31.0)
        )
        run = PlantRun(times, {"drive_v": drive}, first_samples={"position_v": np.zeros(20)})
        reading = compiled.run(compiled.values, run, {"y": 0.0, "w": 0.0})[:, 0]
        reading = reading + 1e-4 * generator.standard_normal(times.size)
        channels = {"drive_v": drive, "position_v": reading}
        recordings.append(Recording(times, channels, run=f"run_{number}", rig="box", kind="bench"))
    found = answer(recordings, given)
    assert found.findings[0].physics_id == "progressive_spring"
    stiffening = found.findings[0].parameters["k_3"]
    assert abs(stiffening.value - 8.0) < max(4.0 * stiffening.std, 0.8)


BOX = """
format: 1
name: box
kind: equations
inputs: {drive_v: V}
states:
  y: {unit: V, initial: position_v}
  w: {unit: V/s, initial: fit}
parameters:
  mass: {value: 2.0e-5, std: 2.0e-6, unit: s^2}
  damping: {value: 1.0e-3, std: 2.0e-4, unit: s}
  stiffness: {value: 1.0, std: 0.1, unit: '1'}
equations:
  kinematics: {state: y, rate: "w"}
  force_balance: {state: w, rate: "(drive_v - damping * w - stiffness * y) / mass", balance: true,
                  per_force: "1 / mass", velocity: w, position: y}
outputs:
  position_v: {value: "y"}
"""
