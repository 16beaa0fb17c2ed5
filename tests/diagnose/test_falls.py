"""What falls freely: at terminal speed the air carries all of the weight, and nothing else can rub on it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from diagnose_rig import plant as oscillator
from diagnose_rig import recordings

from ground.diagnose.accept import significance
from ground.diagnose.candidates import EffectCandidate, effect_candidates, ranges_of
from ground.diagnose.data import prepare
from ground.diagnose.fit import fit_plant
from ground.diagnose.pipeline import diagnose
from ground.diagnose.scales import find_scales
from ground.recordings.model import Recording
from hal.config import config_path
from sim_hal.plant.simulate import EffectUse, Parameter, Plant, Run, compile_plant, load_plant

DRAG_N_S_M = 0.018
NOISE_M = 0.03


def ball() -> Plant:
    return load_plant(config_path("plant", "ball_drop.yaml")).with_values({"mass": 0.03})


def falls(truth: Plant, seed: int, count: int = 2) -> list[Recording]:
    """Falls of 45 m filmed at 15 frames a second, the last part of them at terminal speed."""
    generator, compiled = np.random.default_rng(seed), compile_plant(truth)
    found = []
    for number in range(count):
        times = np.arange(45) / 15.0
        run = Run(times, {}, first_samples={"height_m": np.full(3, 45.0)})
        start = {"z": 45.0, "v": generator.normal(0.0, 0.5)}
        heights = compiled.run(compiled.values, run, start)[:, 0]
        noisy = heights + NOISE_M * generator.standard_normal(times.size)
        found.append(Recording(times, {"height_m": noisy}, run=f"fall_{number}", rig="ball", kind="drop"))
    return found


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_air_is_found_in_falls_to_terminal_speed(seed: int) -> None:
    """The drag comes up to the weight: the largest force there is, over the largest speed."""
    given = ball()
    drag = EffectUse("aerodynamic_drag_linear", "ballistic", None, {"d": Parameter(DRAG_N_S_M, 0.0, "N*s/m")})
    found = diagnose(falls(given.with_effect(drag), seed), given).diagnosis.findings[0]
    assert found.physics_id == "aerodynamic_drag_linear"
    assert abs(found.parameters["d"].value - DRAG_N_S_M) < 4.0 * found.parameters["d"].std


def test_a_fall_without_air_lacks_nothing() -> None:
    given = ball()
    assert diagnose(falls(given, seed=4), given).diagnosis.verdict == "consistent"


def test_nothing_solid_rubs_on_what_falls_freely() -> None:
    given = ball()
    data = prepare(falls(given, seed=5), given)
    refit = fit_plant(given, data.windows, data.sigmas, {})
    offered = effect_candidates(given, find_scales(refit, data.windows))
    in_the_air = {c.physics_id for c in offered if c.kind == "physics"}
    assert in_the_air == {"aerodynamic_drag_linear", "aerodynamic_drag_quadratic", "buoyancy"}


@pytest.mark.parametrize(("clipped_at_m", "there"), [(0.04, True), (None, False)])
def test_a_limit_that_no_reading_comes_to_is_no_saturation(
    tmp_path: Path, clipped_at_m: float | None, there: bool
) -> None:
    """It acts as a whole, so what tells it from nothing is that its limit is told."""
    given = oscillator(tmp_path)
    runs = recordings(given, seed=6)
    if clipped_at_m is not None:
        runs = [
            replace(r, channels={n: np.clip(c, -clipped_at_m, clipped_at_m) if n == "position_m" else c
                                 for n, c in r.channels.items()})
            for r in runs
        ]  # fmt: skip
    data = prepare(runs, given)
    refit = fit_plant(given, data.windows, data.sigmas, {})
    scales = find_scales(refit, data.windows)
    candidate = next(c for c in effect_candidates(refit.plant, scales) if c.physics_id == "sensor_saturation")
    assert isinstance(candidate, EffectCandidate)
    larger = candidate.joined(refit.plant, candidate.starts - 1)
    fit = fit_plant(larger, data.windows, data.sigmas, ranges_of(larger, scales))
    sigmas = significance(candidate, fit, data.windows, fit.chi2)
    assert (sigmas > 3.0) == there and not math.isnan(sigmas)
