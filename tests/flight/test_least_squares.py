"""The small fitter against closed forms: linear problems, priors, and what it must refuse."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flight.heartbeat import Heartbeat, Stalled
from flight.least_squares import _jacobian, fit

FREE = np.full(2, np.inf)
ORIGIN = np.zeros(2)


def line(seed: int, samples: int = 12) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    design = np.column_stack((np.ones(samples), rng.uniform(-2.0, 2.0, samples)))
    return design, design @ (3.0, -0.5) + rng.normal(size=samples)


@given(st.integers(0, 1000), st.floats(-9.0, 9.0))
def test_a_line_is_fitted_as_the_normal_equations_say(seed: int, log_unit: float) -> None:
    """Also where the parameters' units are far apart."""
    design, seen = line(seed)
    design = design * (1.0, 10.0**log_unit)
    start = np.array((1.0, 1.0 / 10.0**log_unit))
    found = fit(lambda p: seen - design @ p, start, ORIGIN, FREE, Heartbeat())
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


def test_residuals_that_overflow_far_away_do_no_harm() -> None:
    """From far down the flat side of an exponential the first steps lead to infinity, less infinity."""
    found = fit(
        lambda p: np.array((np.exp(p[0]) - 1.0, np.exp(2.0 * p[0]) - np.exp(p[0]))),
        np.array((-8.0,)), np.zeros(1), np.full(1, np.inf), Heartbeat(), tolerance=1e-12,
    )  # fmt: skip
    assert found.parameters[0] == pytest.approx(0.0, abs=1e-4)


def test_where_no_step_helps_the_fit_is_over() -> None:
    found = fit(lambda p: 1.0 + np.abs(p), np.zeros(1), np.zeros(1), np.full(1, np.inf), Heartbeat(most=2))
    assert (found.converged, found.cost, found.parameters[0]) == (True, 1.0, 0.0)


def test_at_no_tolerance_it_is_over_when_nothing_is_gained() -> None:
    assert fit(lambda p: p - 3.0, np.ones(2), ORIGIN, FREE, Heartbeat(), tolerance=0.0).converged


def test_what_is_left_over_is_the_measure_of_a_gain() -> None:
    """Beside residuals that no parameter can lower, small gains are not worth their steps."""
    beats = []
    found = fit(
        lambda p: np.array((10.0 * (p[1] - p[0] ** 2), 1.0 - p[0], 1000.0)),
        np.array((-1.2, 1.0)), ORIGIN, FREE, Heartbeat(lambda: beats.append(1)), tolerance=1e-5,
    )  # fmt: skip
    assert found.converged
    assert len(beats) <= 3


@pytest.mark.parametrize(
    ("point", "start", "prior_std", "step"),
    [
        (2.0, 1.0, np.inf, 2e-6),
        (0.5, 3.0, np.inf, 3e-6),
        (0.5, 0.25, np.inf, 0.5e-6),
        (-0.5, 0.25, 8.0, 0.5e-6),
        (4.0, 1.0, 0.5, 0.5e-6),
        (4.0, 1.0, 1e6, 4e-6),
        (0.0, 0.0, 0.25, 0.25e-6),
        (0.0, 0.0, np.inf, 1e-6),
    ],
)
def test_a_derivative_s_step_is_a_small_share_of_the_parameter_s_size_or_of_its_prior_s_width(
    point: float, start: float, prior_std: float, step: float
) -> None:
    seen: list[float] = []

    def stacked(p: np.ndarray) -> np.ndarray:
        seen.append(float(p[0]) - point)
        return 2.0 * p

    at = np.array((point,))
    found = _jacobian(stacked, at, 2.0 * at, np.array((start,)), np.array((prior_std,)))
    assert seen == [pytest.approx(step, rel=1e-8)]
    np.testing.assert_allclose(found, [[2.0]], rtol=1e-8)


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
