"""A rig that moves so slowly that its forces balance: each is large, what is left for its mass next to nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from diagnose_rig import plant as oscillator

from ground.diagnose.data import prepare
from ground.diagnose.fit import fit_plant
from ground.diagnose.pipeline import diagnose
from ground.diagnose.problem import FitProblem
from ground.diagnose.scales import find_scales
from ground.recordings.model import Recording, SensorSpec
from sim_hal.plant.expressions import parse, summands, to_text
from sim_hal.plant.simulate import EffectUse, Parameter, Plant, Run, compile_plant

NOISE_M = 2e-5
FRICTION_N = 2.0


def press(folder: Path) -> Plant:
    """The oscillator with a spring and a damper so strong that its mass hardly counts."""
    stiff = {"stiffness": (5000.0, 250.0), "damping": (20.0, 5.0)}
    return oscillator(folder).with_values(
        {n: v for n, (v, _) in stiff.items()}, {n: s for n, (_, s) in stiff.items()}
    )


def pressed(truth: Plant, seed: int) -> list[Recording]:
    """Pushes of up to 50 N, a few seconds long; its parameters drawn within their tolerances."""
    generator = np.random.default_rng(seed)
    drawn = {n: generator.normal(p.value, p.std) for n, p in truth.parameters.items()}
    compiled, times = compile_plant(truth.with_values(drawn)), 0.02 * np.arange(350)
    found = []
    for number in range(3):
        push = sum(generator.uniform(10.0, 25.0) * np.sin(2 * np.pi * f * times) for f in (0.15, 0.23))
        run = Run(times, {"push_n": push}, first_samples={"position_m": np.zeros(20)})
        position = compiled.run(compiled.values, run, {"q": 0.0, "v": 0.0})[:, 0]
        channels = {"push_n": push, "position_m": position + NOISE_M * generator.standard_normal(times.size)}
        noise = {"position_m": SensorSpec(noise_std=NOISE_M)}
        found.append(Recording(times, channels, run=f"r{number}", rig="press", kind="bench", sensors=noise))
    return found


def test_what_a_slow_rig_lacks_is_found_though_the_net_force_is_small(tmp_path: Path) -> None:
    given = press(tmp_path)
    use = EffectUse("coulomb_friction", "force_balance", None, {"F_c": Parameter(FRICTION_N, 0.0, "N")})
    (found,) = diagnose(pressed(given.with_effect(use), seed=1), given).diagnosis.findings
    assert found.physics_id == "coulomb_friction"
    assert abs(found.parameters["F_c"].value - FRICTION_N) < 4.0 * found.parameters["F_c"].std


def test_a_slow_rig_that_lacks_nothing(tmp_path: Path) -> None:
    given = press(tmp_path)
    assert diagnose(pressed(given, seed=2), given).diagnosis.verdict == "consistent"


def test_the_typical_force_is_the_largest_that_acts(tmp_path: Path) -> None:
    given = press(tmp_path)
    runs = pressed(given, seed=3)
    data = prepare(runs, given)
    refit = fit_plant(given, data.windows, data.sigmas, {})
    pushes = np.concatenate([recording.channels["push_n"] for recording in data.fitted])
    largest = float(np.percentile(np.abs(pushes), 95.0))
    assert find_scales(refit, data.windows)["force_balance"]["F"] == pytest.approx(largest, rel=0.1)


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("a", ["a"]),
        ("-a + b - c", ["a", "b", "c"]),
        ("(a - k * x) / m", ["a / m", "k * x / m"]),
        ("g * (sin(x + y) - (a + b) * c)", ["g * sin(x + y)", "g * (a * c)", "g * (b * c)"]),
        ("max(a + b, c) * d", ["max(a + b, c) * d"]),
    ],
)
def test_what_a_sum_is_multiplied_with_goes_with_each_part(text: str, parts: list[str]) -> None:
    assert [to_text(part) for part in summands(parse(text))] == parts


def test_a_window_that_stuck_at_a_false_start_starts_anew(tmp_path: Path) -> None:
    """With a friction still far too large a window may seem to begin with another speed, and never come back."""
    given = press(tmp_path)
    data = prepare(pressed(given, seed=4), given)
    problem = FitProblem(given, data.windows, data.sigmas, {})
    z = problem.settle_initial_states()
    own = np.array([one.segment == 1 for one in problem.free])
    assert own.any() and problem.anew(z, problem.residuals(z)) is None
    lost = np.where(own, z + 50.0, z)
    again = problem.anew(lost, problem.residuals(lost))
    assert again is not None
    np.testing.assert_array_equal(again[own], 0.0)
    np.testing.assert_array_equal(again[~own], z[~own])
