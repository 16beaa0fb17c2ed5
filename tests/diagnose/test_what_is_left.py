"""What is left when all is named: a fault that takes half of it is no finding; a fine sensor tells of it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import diagnose_rig
import numpy as np
import pytest

from ground.diagnose.candidates import effect_candidates
from ground.diagnose.chosen import Chosen, Named
from ground.diagnose.data import prepare
from ground.diagnose.findings import accounted, beyond, unexplained, verdict_of
from ground.diagnose.fit import fit_plant
from ground.diagnose.locate import LocateTask, locate_in
from ground.diagnose.scales import find_scales
from ground.recordings.model import Recording, SensorSpec
from sim_hal.plant.simulate import EffectUse, Parameter, Plant, Run, compile_plant, load_plant

CUP = """
format: 1
name: cup
kind: equations
states:
  T: {unit: K, initial: cup_k}
parameters:
  C: {value: 900, std: 45, unit: J/K}
  hA: {value: 0.6, std: 0.2, unit: W/K}
  T_a: {value: 294.0, std: 1.0, unit: K}
equations:
  heat: {state: T, rate: "-hA*(T - T_a)/C", balance: true, per_force: "1/C"}
outputs:
  cup_k: {value: T}
"""
RADIATES = "-(hA*(T - T_a) + 3.0e-9*W*(T**4 - T_a**4))/C"
SWELLS = """
format: 1
name: swelling
kind: equations
states:
  v: {unit: m/s, initial: speed_m_s}
parameters:
  m: {value: 1.0, std: 0.05, unit: kg}
  k: {value: 0.1, std: 0.01, unit: N*s^3/m^3}
equations:
  push: {state: v, rate: "k * v**3 / m", balance: true, per_force: "1 / m", velocity: v}
outputs:
  speed_m_s: {value: v}
"""


def loaded(folder: Path, text: str, name: str = "rig") -> Plant:
    path = folder / f"{name}.yaml"
    path.write_text(text, encoding="utf-8")
    return load_plant(path)


@pytest.mark.parametrize("radiates", [False, True])
def test_a_drift_is_less_sure_where_it_takes_but_a_part_of_what_radiation_does(
    tmp_path: Path, radiates: bool
) -> None:
    given = loaded(tmp_path, CUP)
    drift = EffectUse("sensor_drift", "sensor", "cup_k", {"drift": Parameter(-3e-4, math.inf, "K/s")})
    text = CUP.replace("-hA*(T - T_a)/C", RADIATES) if radiates else CUP
    text = text.replace("  T_a:", "  W: {value: 1.0, std: 0.0, unit: W/K^4}\n  T_a:") if radiates else text
    truth = loaded(tmp_path, text, "truth")
    compiled = compile_plant(truth if radiates else truth.with_effect(drift))
    times = 20.0 * np.arange(270)
    runs = []
    for number in range(3):
        run = Run(times, first_samples={"cup_k": np.zeros(9)})
        clean = compiled.run(compiled.values, run, {"T": 363.0 - 14.0 * number})[:, 0]
        read = clean + 0.05 * np.random.default_rng(number).standard_normal(times.size)
        spec = {"cup_k": SensorSpec(noise_std=0.05)}
        runs.append(
            Recording(times, {"cup_k": read}, run=f"r{number}", rig="cup", kind="equations", sensors=spec)
        )
    data = prepare(runs, given)
    refit = fit_plant(given, data.windows, data.sigmas, {})
    ranges = {"cup_k.sensor_drift.drift": (-3e-4, -1.0, 1.0)}
    fit = fit_plant(given.with_effect(drift), data.windows, data.sigmas, ranges)
    scales = find_scales(refit, data.windows)
    candidate = next(c for c in effect_candidates(given, scales) if c.physics_id == "sensor_drift")
    named = Named(fit, (Chosen(candidate, 1.0, (), {}, ((candidate, 0.6),)),), (), ())
    assert fit.chi2 < 0.5 * refit.chi2
    assert (accounted(fit, refit, data.windows) < 0.8) == radiates
    assert verdict_of(named, refit, data.windows, np.ones(1)) == ("undecidable" if radiates else "mismatch")


@pytest.mark.parametrize(("level_n", "there"), [(0.0, False), (0.05, True)])
def test_a_sensor_much_finer_than_any_model_still_says_that_something_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, level_n: float, there: bool
) -> None:
    """An error no larger than a model may have, but tens of sigmas of the sensor, and no noise: not consistent."""
    monkeypatch.setattr(diagnose_rig, "NOISE_M", 1e-6)
    given = diagnose_rig.plant(tmp_path)
    truth = given.with_effect(diagnose_rig.friction(level_n)) if level_n else given
    data = prepare(diagnose_rig.recordings(truth, 5, samples=900), given)
    refit = fit_plant(given, data.windows, data.sigmas, {}, tolerance=1e-6)
    assert not unexplained(refit, data.windows)
    assert accounted(refit, refit, data.windows) == 1.0
    assert beyond(refit, data.windows, data.finer(("position_m",))) == there
    assert not beyond(refit, data.windows, np.ones(1))


@pytest.mark.parametrize(("typical_n", "told"), [(0.1, True), (1e9, False)])
def test_where_the_filter_leaves_what_the_rig_can_bear_no_force_is_told(
    tmp_path: Path, typical_n: float, told: bool
) -> None:
    """Looking for meganewtons throws the equations into the infinite: no answer, and no end of the rest."""
    given = loaded(tmp_path, SWELLS)
    compiled = compile_plant(given)
    times = 0.02 * np.arange(200)
    run = Run(times, first_samples={"speed_m_s": np.zeros(9)})
    clean = compiled.run(compiled.values, run, {"v": 0.5})[:, 0]
    noise = 1e-3 * np.random.default_rng(1).standard_normal(times.size)
    spec = {"speed_m_s": SensorSpec(noise_std=1e-3)}
    one = Recording(times, {"speed_m_s": clean + noise}, run="r", rig="s", kind="equations", sensors=spec)
    data = prepare([one, replace(one, run="again")], given)
    refit = fit_plant(given, data.windows, data.sigmas, {})
    task = LocateTask(refit, data.windows, data.whole[0], data.sigmas, "push", typical_n)
    assert (locate_in(task) is not None) == told
