"""A drift counts from the recording's start, not from that of each window it is cut into."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from diagnose_rig import NOISE_M, friction, plant, recordings

from ground.diagnose.data import prepare
from ground.diagnose.fit import Fit, fit_plant
from ground.diagnose.problem import FitProblem
from ground.diagnose.segments import segment_of, split_last_part
from ground.recordings.model import Recording
from sim_hal.plant.simulate import EffectUse, Parameter, Plant, compile_plant

DRIFT_M_S = 0.002
RANGES = {"position_m.sensor_drift.drift": (1e-3, -0.05, 0.05)}


def drifting(given: Plant, drift_m_s: float = 0.0) -> Plant:
    drift = {"drift": Parameter(drift_m_s, 0.0, "m/s")}
    return given.with_effect(EffectUse("sensor_drift", "sensor", "position_m", drift))


def fitted(given: Plant, truth: Plant, seed: int) -> tuple[Fit, list[Recording]]:
    """The rig with a drift to fit, on windows of recordings of the true one."""
    runs = recordings(truth, seed, count=2, samples=800)
    data = prepare(runs, given)
    assert len(data.windows) > len(runs)
    return fit_plant(drifting(given), data.windows, data.sigmas, RANGES), runs


@pytest.mark.parametrize("drift_m_s", [DRIFT_M_S, -DRIFT_M_S])
def test_windows_tell_a_drift_and_it_means_the_same_in_a_whole_run(tmp_path: Path, drift_m_s: float) -> None:
    given = plant(tmp_path)
    fit, runs = fitted(given, drifting(given, drift_m_s), seed=3)
    name = next(iter(RANGES))
    assert abs(fit.values[name] - drift_m_s) < 4.0 * fit.std[name] < 0.1 * abs(drift_m_s)
    whole = compile_plant(fit.plant.with_values(fit.values))
    for run in runs:
        segment = segment_of(run, whole.plant, whole)
        problem = FitProblem(fit.plant, [segment], np.array([NOISE_M]), {}, frozen=fit.values)
        assert np.mean(problem.residuals(problem.settle_initial_states()) ** 2) < 1.3


@pytest.mark.parametrize("level_n", [0.0, 0.3])
def test_no_drift_is_seen_where_there_is_none_be_there_dry_friction_or_not(
    tmp_path: Path, level_n: float
) -> None:
    given = plant(tmp_path)
    truth = given.with_effect(friction(level_n)) if level_n else given
    fit, _ = fitted(given, truth, seed=4)
    name = next(iter(RANGES))
    assert abs(fit.values[name]) < max(4.0 * fit.std[name], 0.05 * DRIFT_M_S)


def test_what_is_held_out_of_a_recording_keeps_its_origin(tmp_path: Path) -> None:
    one = recordings(plant(tmp_path), 5, count=1)[0]
    late = replace(one, times_s=one.times_s + 7.0)
    first, last = split_last_part(late, 0.25)
    assert one.origin_s is None
    assert first.began_s == last.began_s == late.times_s[0]
    assert split_last_part(last, 0.5)[1].began_s == late.times_s[0]
