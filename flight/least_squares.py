"""Small nonlinear least squares: Levenberg-Marquardt with a numerical Jacobian and Gaussian priors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flight.heartbeat import Heartbeat

Array = NDArray[np.float64]

_GIVE_UP_DAMPING = 1e9


@dataclass(frozen=True)
class Fit:
    """Result: parameters (n,), their covariance (n, n), residuals in sigmas (m,) without the priors' rows."""

    parameters: Array
    covariance: Array
    residuals: Array
    cost: float
    converged: bool


def fit(
    residuals: Callable[[Array], Array],
    start: Array,
    prior_mean: Array,
    prior_std: Array,
    heartbeat: Heartbeat,
    *,
    max_steps: int = 60,
    tolerance: float = 1e-6,
) -> Fit:
    """Minimise |residuals(p)|^2 + |(p - prior_mean)/prior_std|^2.

    `residuals` gives (m,) in units of their sigma; an infinite `prior_std` leaves a parameter free. The
    covariance is the inverse of J^T J with the priors' information in it. Raises `ValueError` where the start
    has no finite residuals or the problem leaves a parameter undetermined.
    """
    weight = 1.0 / prior_std  # 0 for a free parameter
    point = start.astype(np.float64).copy()

    def stacked(p: Array) -> Array:
        return np.concatenate((residuals(p), (p - prior_mean) * weight))

    value = stacked(point)
    if not np.all(np.isfinite(value)):
        raise ValueError("the residuals at the start of the fit are not finite")
    damping, converged = 1e-3, False
    for _ in range(max_steps):
        heartbeat.beat()
        jacobian = _jacobian(stacked, point, value, start, prior_std)
        normal, gradient = jacobian.T @ jacobian, jacobian.T @ value
        point, value, damping, gain = _improve(stacked, point, value, normal, gradient, damping)
        if gain <= tolerance * (1.0 + float(value @ value)):
            converged = True
            break
    jacobian = _jacobian(stacked, point, value, start, prior_std)
    covariance = _inverse(jacobian.T @ jacobian)
    data = value[: value.size - point.size]
    return Fit(point, covariance, data, float(value @ value), converged)


def _improve(
    stacked: Callable[[Array], Array],
    point: Array,
    value: Array,
    normal: Array,
    gradient: Array,
    damping: float,
) -> tuple[Array, Array, float, float]:
    """One accepted step (or none once the damping is hopeless), and how much it lowered the cost."""
    cost = float(value @ value)
    while damping < _GIVE_UP_DAMPING:
        # Scaled to a unit diagonal: parameters of very different units, or without effect, stay solvable.
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-30))
        lifted = normal / np.outer(scale, scale) + damping * np.eye(point.size)
        trial = point - np.linalg.solve(lifted, gradient / scale) / scale
        with np.errstate(over="ignore", invalid="ignore"):  # a step too far is refused below
            trial_value = stacked(trial)
            trial_cost = float(trial_value @ trial_value)
        if np.isfinite(trial_cost) and trial_cost <= cost:
            return trial, trial_value, max(damping * 0.2, 1e-12), cost - trial_cost
        damping *= 5.0
    return point, value, 1e-3, 0.0


def _jacobian(
    stacked: Callable[[Array], Array], point: Array, value: Array, start: Array, prior_std: Array
) -> Array:
    """Forward differences; each step a small share of the parameter's size or of its prior's width."""
    columns = []
    for index in range(point.size):
        scale = max(abs(point[index]), abs(start[index]))
        if np.isfinite(prior_std[index]):
            scale = min(scale, prior_std[index]) if scale > 0.0 else prior_std[index]
        step = 1e-6 * (scale if scale > 0.0 else 1.0)
        moved = point.copy()
        moved[index] += step
        columns.append((stacked(moved) - value) / step)
    return np.column_stack(columns)


def _inverse(normal: Array) -> Array:
    """Inverse of a symmetric positive matrix, scaled first so that units do not spoil its condition."""
    scale = np.sqrt(np.diag(normal))
    if np.any(scale == 0.0) or not np.all(np.isfinite(scale)):
        raise ValueError("the data leave a parameter of the fit undetermined")
    unit = normal / np.outer(scale, scale)
    try:
        return np.asarray(np.linalg.inv(unit) / np.outer(scale, scale), dtype=np.float64)
    except np.linalg.LinAlgError as error:
        raise ValueError("the data leave a parameter of the fit undetermined") from error
