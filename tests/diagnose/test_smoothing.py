"""The missing force, found where it was put."""

from __future__ import annotations

import numpy as np
import pytest

from ground.diagnose.smoothing import StateSpace, smooth

MASS_KG, STEP_S, COUNT = 2.0, 0.01, 400


def cart(force: np.ndarray, noise_m: float, seed: int) -> StateSpace:
    """A cart that is pushed by a force nobody told of, its position measured."""
    q, v, truth = 0.0, 0.0, []
    for push in force:
        truth.append(q)
        q, v = q + v * STEP_S + 0.5 * push / MASS_KG * STEP_S**2, v + push / MASS_KG * STEP_S
    observed = np.array(truth)[:, None] + noise_m * np.random.default_rng(seed).standard_normal((COUNT, 1))
    a = np.array([[1.0, STEP_S, 0.5 * STEP_S**2 / MASS_KG], [0.0, 1.0, STEP_S / MASS_KG], [0.0, 0.0, 1.0]])
    return StateSpace(
        transition=lambda k, x: x @ a.T,
        measurement=lambda k, x: x[:, :1],
        times_s=STEP_S * np.arange(COUNT),
        observed=observed,
        noise_std=np.array([noise_m]),
        start=np.zeros(3),
        start_std=np.array([noise_m, 1e-3, 5.0]),
        perturbation=np.array([1e-3, 1e-3, 1e-2]),
    )


def random_walk(intensity: float, seed: int) -> np.ndarray:
    steps = np.random.default_rng(seed).standard_normal(COUNT) * np.sqrt(intensity * STEP_S)
    return np.cumsum(steps)


def test_the_force_is_recovered_within_its_own_sigma() -> None:
    """Over many draws from the smoother's own prior, 95 % intervals hold the truth 95 % of the time."""
    inside = []
    for seed in range(20):
        force = random_walk(25.0, 100 + seed)
        found = smooth(cart(force, 1e-4, seed), 25.0)
        inside.append(np.abs(found.force - force) < 1.96 * found.force_std)
    assert 0.92 <= np.mean(inside) <= 0.98


def test_no_force_is_no_finding() -> None:
    found = smooth(cart(np.zeros(COUNT), 1e-4, 5), 1e-6)
    assert np.abs(found.force).max() < 4.0 * found.force_std.max()
    assert found.force_std[COUNT // 2] < 0.05


def test_the_true_intensity_is_the_likeliest() -> None:
    space = cart(random_walk(25.0, 9), 1e-4, 9)
    likelihood = {q: smooth(space, q).log_likelihood for q in (0.25, 25.0, 2500.0)}
    assert max(likelihood, key=likelihood.__getitem__) == 25.0


def test_samples_that_are_missing_only_widen_the_estimate() -> None:
    space = cart(random_walk(25.0, 3), 1e-4, 3)
    whole = smooth(space, 25.0)
    space.observed[150:200] = np.nan
    holed = smooth(space, 25.0)
    assert np.isfinite(holed.force).all()
    assert holed.force_std[175] > 2.0 * whole.force_std[175]
    assert holed.force_std[20] == pytest.approx(whole.force_std[20], rel=1e-3)
