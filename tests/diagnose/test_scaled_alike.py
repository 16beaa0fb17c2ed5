"""A rig that swings freely tells only ratios: how sure its masses and frictions are, the tolerances say."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from diagnose_rig import NOISE_M, TEXT, friction, plant, recordings

from ground.diagnose.data import prepare
from ground.diagnose.fit import fit_plant
from ground.diagnose.problem import PRECISE_TOLERANCE, FitProblem
from ground.recordings.model import Recording
from sim_hal.plant.simulate import Plant, Run, compile_plant, load_plant

FRICTION = "coulomb_friction.F_c"


@pytest.mark.parametrize("scale", [0.96, 1.0, 1.05])
def test_what_is_scaled_alike_is_known_by_its_tolerance_alone(tmp_path: Path, scale: float) -> None:
    path = tmp_path / "lightly_damped.yaml"
    path.write_text(TEXT.replace("value: 1.5, std: 0.3", "value: 0.15, std: 0.1"), encoding="utf-8")
    given = load_plant(path)
    nominal = {name: p.value for name, p in given.parameters.items()}
    runs = let_go(given.with_values({name: scale * value for name, value in nominal.items()}), scale * 0.5)
    data = prepare(runs, given)
    wanted = given.with_effect(friction(0.5))
    fit = fit_plant(
        wanted, data.windows, data.sigmas, {FRICTION: (0.5, 0.0, 2.0)}, tolerance=1e-7, precise=True
    )
    assert abs(fit.values[FRICTION] - scale * 0.5) < 2.5 * fit.std[FRICTION]
    assert abs(fit.values["mass"] - scale * nominal["mass"]) < 2.5 * fit.std["mass"]
    # The tolerances of mass and stiffness, 5 % each, leave 3.5 % for what both have in common.
    assert fit.std["mass"] / fit.values["mass"] == pytest.approx(0.05 / math.sqrt(2.0), rel=0.3)


def let_go(truth: Plant, friction_n: float) -> list[Recording]:
    """The rig let go far out, with dry friction, until it sticks and for a while after."""
    compiled = compile_plant(truth.with_effect(friction(friction_n)))
    times = 0.02 * np.arange(1000)
    found = []
    for number, like in enumerate(recordings(truth, seed=1, samples=1000)):
        run = Run(times, {"push_n": np.zeros(1000)}, first_samples={"position_m": np.zeros(20)})
        position = compiled.run(compiled.values, run, {"q": 0.6 - 0.1 * number, "v": 0.2 * number})[:, 0]
        noise = NOISE_M * np.random.default_rng(number).standard_normal(1000)
        channels = {"push_n": run.inputs["push_n"], "position_m": position + noise}
        found.append(replace(like, times_s=times, channels=channels))
    return found


def test_what_a_known_push_tells_stays_known(tmp_path: Path) -> None:
    given = plant(tmp_path)
    data = prepare(recordings(given.with_effect(friction(0.8)), seed=2, samples=600), given)
    fit = fit_plant(
        given.with_effect(friction(0.6)),
        data.windows,
        data.sigmas,
        {FRICTION: (0.6, 0.0, 5.0)},
        tolerance=1e-7,
        precise=True,
    )
    assert abs(fit.values[FRICTION] - 0.8) < 3.0 * fit.std[FRICTION]
    assert fit.std[FRICTION] < 0.02
    assert np.isfinite(fit.jacobian).all()


def test_errors_of_columns_do_not_pass_for_knowledge(tmp_path: Path) -> None:
    given = plant(tmp_path)
    data = prepare(let_go(given, 0.0), given)
    fit = fit_plant(given, data.windows, data.sigmas, {}, tolerance=1e-7, precise=True)
    problem = FitProblem(given, data.windows, data.sigmas, {}, tolerance=PRECISE_TOLERANCE)
    alike = np.array([fit.values.get(one.name, 0.0) / one.scale for one in problem.free])
    wrong = problem.precise_sensitivities(fit.z)
    at = [one.name for one in problem.free].index("stiffness")
    wrong[:, at] *= 1.0 + 0.01 * np.random.default_rng(1).standard_normal(wrong.shape[0])
    passing, left = (float(np.linalg.norm(j @ alike)) for j in (wrong, problem.sure_of_weak(fit.z, wrong)))
    assert passing > 10.0 * np.linalg.norm(alike)  # for ten times what the tolerances tell
    assert left < 0.1 * passing
