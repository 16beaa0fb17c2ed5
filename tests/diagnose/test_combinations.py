"""Of two parameters that only their product or ratio shows, the combination is told and the two are not."""

from __future__ import annotations

import numpy as np
import pytest

from ground.diagnose.combinations import told_combinations, untold
from ground.diagnose.fit import Fit
from ground.diagnose.problem import Free
from ground.diagnose.result import Estimate
from ground.diagnose.segments import Segment
from ground.recordings.model import Recording
from hal.config import config_path
from sim_hal.plant.run import Run
from sim_hal.plant.simulate import load_plant

VALUES = {"a": 4.0, "b": 0.5}
SAMPLES = 2400


def fitted(power: float, own: float) -> tuple[Fit, list[Segment]]:
    """A fit whose residuals answer log a + power * log b, and each by itself `own` times as much."""
    random = np.random.default_rng(5)
    cause, other, third = random.standard_normal((3, SAMPLES))
    slope_a = (cause + own * other) / VALUES["a"]
    slope_b = (power * cause + own * third) / VALUES["b"]
    free = tuple(Free(f"e.{name}", value, value, 0.0, 100.0, prior=False) for name, value in VALUES.items())
    jacobian = np.column_stack([slope_a * VALUES["a"], slope_b * VALUES["b"]])
    plant = load_plant(config_path("plant", "bb0b_hop.yaml"))
    residuals = random.standard_normal(SAMPLES)
    values = {f"e.{name}": value for name, value in VALUES.items()}
    fit = Fit(plant, free, values, {}, np.zeros(2), residuals, jacobian, ({},))
    times = np.arange(SAMPLES) / 100.0
    recording = Recording(times, {"position_m": residuals}, run="r", rig="x", kind="hop", sensors={})
    segment = Segment("r", Run(times, {}), residuals[:, None], recording, {})
    return fit, [segment]


def estimates(fit: Fit, segments: list[Segment]) -> dict[str, Estimate]:
    covariance = fit.covariance_of(list(fit.values), segments)
    stds = np.sqrt(np.diag(covariance))
    return {
        name: Estimate(value, float(std), unit)
        for (name, value), std, unit in zip(VALUES.items(), stds, ("N", "m"), strict=True)
    }


@pytest.mark.parametrize(("power", "said"), [(1.0, "a * b = 2 ±"), (-1.0, "a / b = 8 ±")])
def test_what_only_a_combination_shows_is_told_as_one(power: float, said: str) -> None:
    fit, segments = fitted(power, own=1e-3)
    parameters = estimates(fit, segments)
    assert all(untold(estimate) for estimate in parameters.values())
    (told,) = told_combinations("e", parameters, fit, segments)
    assert told.startswith(said)
    sigma = float(told.split("± ")[1].split()[0]) / float(told.split("= ")[1].split()[0])
    assert sigma == pytest.approx(1.0 / np.sqrt(SAMPLES), rel=0.4)


def test_what_is_told_by_itself_needs_no_combination() -> None:
    fit, segments = fitted(1.0, own=1.0)
    assert told_combinations("e", estimates(fit, segments), fit, segments) == []
