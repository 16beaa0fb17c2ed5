"""The small fitter against closed forms: linear problems, priors, and what it must refuse."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flight.heartbeat import Heartbeat, Stalled
from flight.least_squares import fit

FREE = np.full(2, np.inf)
ORIGIN = np.zeros(2)


def line(seed: int, samples: int = 12) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    design = np.column_stack((np.ones(samples), rng.uniform(-2.0, 2.0, samples)))
    return design, design @ (3.0, -0.5) + rng.normal(size=samples)


@given(st.integers(0, 1000), st.floats(-3.0, 3.0))
def test_a_line_is_fitted_as_the_normal_equations_say(seed: int, log_unit: float) -> None:
    """Also where the parameters' units are far apart."""
    design, seen = line(seed)
    design = design * (1.0, 10.0**log_unit)
    found = fit(lambda p: seen - design @ p, np.array((1.0, 1.0)), ORIGIN, FREE, Heartbeat())
    normal = design.T @ design
    expected = np.linalg.solve(normal, design.T @ seen)
    np.testing.assert_allclose(found.parameters, expected, rtol=1e-5, atol=1e-5 / 10.0**log_unit)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(normal), rtol=1e-4)
    np.testing.assert_allclose(found.residuals, seen - design @ expected, atol=1e-4)
    assert found.cost == pytest.approx(float(np.sum((seen - design @ expected) ** 2)), rel=1e-6)
    assert found.converged


@given(st.integers(0, 1000), st.floats(0.05, 5.0))
def test_a_prior_pulls_by_its_information(seed: int, std: float) -> None:
    design, seen = line(seed)
    mean, width = np.array((1.0, 2.0)), np.array((std, np.inf))
    found = fit(lambda p: seen - design @ p, mean, mean, width, Heartbeat())
    normal = design.T @ design + np.diag((1.0 / std**2, 0.0))
    expected = np.linalg.solve(normal, design.T @ seen + np.array((1.0 / std**2, 0.0)) * mean)
    np.testing.assert_allclose(found.parameters, expected, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(normal), rtol=1e-4)
    assert found.residuals.size == seen.size
    pulled = float(np.sum((seen - design @ expected) ** 2)) + float((expected[0] - 1.0) / std) ** 2
    assert found.cost == pytest.approx(pulled, rel=1e-6)


def test_a_parameter_that_only_its_prior_knows_keeps_it() -> None:
    found = fit(
        lambda p: np.array((p[0] - 2.0,)), np.array((1.0, 7.0)), np.array((0.0, 7.0)), np.array((np.inf, 0.25)),
        Heartbeat(),
    )  # fmt: skip
    np.testing.assert_allclose(found.parameters, (2.0, 7.0))
    np.testing.assert_allclose(found.covariance, np.diag((1.0, 0.0625)), atol=1e-9)


def test_a_curved_valley_is_followed_to_its_bottom() -> None:
    """Rosenbrock's function from its usual start: steps that raise the cost must be taken back."""
    calls = 0

    def residuals(p: np.ndarray) -> np.ndarray:
        nonlocal calls
        calls += 1
        return np.array((10.0 * (p[1] - p[0] ** 2), 1.0 - p[0]))

    found = fit(residuals, np.array((-1.2, 1.0)), ORIGIN, FREE, Heartbeat(), tolerance=1e-14)
    np.testing.assert_allclose(found.parameters, (1.0, 1.0), atol=1e-4)
    assert found.converged and found.cost < 1e-9
    assert calls < 200


def test_a_start_at_zero_and_residuals_that_overflow_far_away_do_no_harm() -> None:
    found = fit(
        lambda p: np.exp(np.array((p[0], 2.0 * p[0]))) - np.array((np.e**2, np.e**4)),
        np.zeros(1), np.zeros(1), np.full(1, np.inf), Heartbeat(),
    )  # fmt: skip
    assert found.parameters[0] == pytest.approx(2.0, abs=1e-5)


def test_steps_are_limited_told_to_the_watchdog_and_not_called_converged() -> None:
    beats = []
    found = fit(
        lambda p: np.array((10.0 * (p[1] - p[0] ** 2), 1.0 - p[0])),
        np.array((-1.2, 1.0)), ORIGIN, FREE, Heartbeat(lambda: beats.append(1)), max_steps=3,
    )  # fmt: skip
    assert (found.converged, len(beats)) == (False, 3)
    with pytest.raises(Stalled):
        fit(lambda p: p - 3.0, np.ones(2), ORIGIN, FREE, Heartbeat(most=0))


def test_the_start_is_left_as_it_was() -> None:
    start = np.array((1.0, 1.0))
    fit(lambda p: p - 3.0, start, ORIGIN, FREE, Heartbeat())
    np.testing.assert_array_equal(start, (1.0, 1.0))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_start_without_finite_residuals_is_refused(bad: float) -> None:
    with pytest.raises(ValueError, match=r"^the residuals at the start of the fit are not finite$"):
        fit(lambda p: np.array((bad, p[0], p[1])), np.ones(2), ORIGIN, FREE, Heartbeat())


@pytest.mark.parametrize("design", [((1.0, 0.0), (2.0, 0.0)), ((1.0, 1.0), (2.0, 2.0))])
def test_what_the_data_leave_undetermined_is_refused(design: tuple[tuple[float, float], ...]) -> None:
    """One parameter without effect, and two that act alike (where rounding leaves the matrix regular by chance,
    the covariance is huge instead)."""
    matrix = np.array(design)
    try:
        found = fit(lambda p: matrix @ p - 1.0, np.ones(2), ORIGIN, FREE, Heartbeat())
    except ValueError as error:
        assert str(error) == "the data leave a parameter of the fit undetermined"
    else:
        assert np.abs(found.covariance).max() > 1e6
