"""A sensor that lags a moving rig does so from the first sample on, not from when the window begins."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from diagnose_rig import NOISE_M, plant, recordings
from pushed_mass import pushed_mass

from ground.diagnose.pipeline import diagnose
from sim_hal.plant.simulate import EffectUse, Parameter, Plant, Run, compile_plant


def slow(given: Plant, channel: str, tau_s: float) -> Plant:
    """The plant with a first-order sensor in a channel."""
    own = {"tau": Parameter(tau_s, 0.0, "s"), "share": Parameter(1.0, 0.0, "1")}
    return given.with_effect(EffectUse("sensor_bandwidth", None, channel, own))


def test_a_slow_sensor_lags_what_moves_steadily_by_its_time_constant(tmp_path: Path) -> None:
    compiled = compile_plant(slow(pushed_mass(tmp_path), "position_m", 0.3))
    times = np.linspace(5.0, 7.0, 50)
    run = Run(times, {"push_n": np.zeros(50)}, origin_s=0.0)
    found = compiled.run(compiled.values, run, {"q": 1.0, "v": 2.0})
    assert found[:, compiled.output_names.index("position_m")] == pytest.approx(
        1.0 + 2.0 * (times - 5.3), abs=1e-9
    )


@pytest.mark.parametrize(("tau_s", "seed"), [(0.03, 1), (0.1, 2)])
def test_a_slow_sensor_is_told_from_a_late_one_in_windows(tmp_path: Path, tau_s: float, seed: int) -> None:
    given = plant(tmp_path)
    runs = recordings(slow(given, "position_m", tau_s), seed, count=4, samples=500)
    found = diagnose(runs, given).diagnosis
    (first,) = found.findings
    assert (found.verdict, first.physics_id) == ("mismatch", "sensor_bandwidth")
    assert first.probability > 0.95
    assert first.parameters["tau"].std < 0.1 * tau_s
    assert abs(first.parameters["tau"].value - tau_s) < 4.0 * first.parameters["tau"].std
    assert found.fit["position_m"].extended_rms < 1.3 * NOISE_M
