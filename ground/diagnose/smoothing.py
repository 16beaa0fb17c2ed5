"""An unknown force in one balance equation, estimated from recordings by smoothing.

The plant gets one more state, the missing force, which wanders as a random walk of intensity q [force^2/s]. An
extended Kalman filter with Rauch-Tung-Striebel smoothing, linear in the number of samples, gives the force with
its standard deviation at each sample, and the likelihood by which equations (and intensities) are compared: the
equation whose unknown force makes the recording likeliest is the deficient one (Kristensen, Madsen and
Jorgensen, Computers and Chemical Engineering 28, 2004, 1431-1449).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

Transition = Callable[[int, Float], Float]
"""(sample number, states (k, n)) -> states one sample later (k, n), each row on its own."""
Measurement = Callable[[int, Float], Float]
"""(sample number, states (k, n)) -> outputs (k, m)."""


@dataclass(frozen=True)
class Smoothed:
    """`force` and `force_std` (samples,), `states` (samples, n) without the force, and the log-likelihood."""

    force: Float
    force_std: Float
    states: Float
    log_likelihood: float


@dataclass(frozen=True)
class StateSpace:
    """A plant with its missing force as last state, seen from sample to sample."""

    transition: Transition
    measurement: Measurement
    times_s: Float
    observed: Float
    noise_std: Float
    start: Float
    start_std: Float
    perturbation: Float


def smooth(space: StateSpace, intensity: float) -> Smoothed:
    """Filter forward, smooth backward. `intensity` is the random walk's q for the missing force."""
    passed = filtered(space, intensity)
    mean, covariance = passed.mean[-1], passed.covariance[-1]
    count, size = passed.mean.shape
    states = np.empty((count, size))
    variance = np.empty(count)
    states[-1], variance[-1] = mean, covariance[-1, -1]
    for k in range(count - 2, -1, -1):
        predicted = passed.predicted_covariance[k + 1]
        gain = np.linalg.solve(predicted, passed.slope[k] @ passed.covariance[k]).T
        mean = passed.mean[k] + gain @ (mean - passed.predicted[k + 1])
        covariance = passed.covariance[k] + gain @ (covariance - predicted) @ gain.T
        states[k], variance[k] = mean, covariance[-1, -1]
    std = np.sqrt(np.maximum(variance, 0.0))
    return Smoothed(states[:, -1], std, states[:, :-1], passed.log_likelihood)


@dataclass(frozen=True)
class Update:
    """What the measurements of a sample changed: gain (n, m), sensitivity (m, n), innovation (m,) and its spread."""

    gain: Float
    sensitivity: Float
    innovation: Float
    spread: Float


@dataclass(frozen=True)
class Passed:
    """The filter's way: states before (`predicted`) and after each sample, and how they moved to the next one.

    `updates` has None where nothing was measured.
    """

    mean: Float
    covariance: Float
    predicted: Float
    predicted_covariance: Float
    slope: Float
    updates: tuple[Update | None, ...]
    log_likelihood: float


def filtered(space: StateSpace, intensity: float) -> Passed:
    """The filter alone, forward. `intensity` as in `smooth`."""
    count, size = space.times_s.size, space.start.size
    mean, predicted = np.empty((count, size)), np.empty((count, size))
    covariance, predicted_covariance = np.empty((count, size, size)), np.empty((count, size, size))
    slope = np.empty((count, size, size))
    x, p = space.start.copy(), np.diag(space.start_std**2)
    log_likelihood, updates = 0.0, list[Update | None]()
    for k in range(count):
        predicted[k], predicted_covariance[k] = x, p
        x, p, gained, update = _update(space, k, x, p)
        log_likelihood += gained
        updates.append(update)
        mean[k], covariance[k] = x, p
        if k + 1 < count:
            x, slope[k] = _linearised(partial(space.transition, k), x, space.perturbation)
            p = slope[k] @ p @ slope[k].T
            p[-1, -1] += intensity * (space.times_s[k + 1] - space.times_s[k])
            p = 0.5 * (p + p.T) + np.diag(1e-12 * space.perturbation**2)
    return Passed(mean, covariance, predicted, predicted_covariance, slope, tuple(updates), log_likelihood)


def _update(space: StateSpace, k: int, x: Float, p: Float) -> tuple[Float, Float, float, Update | None]:
    """Take in the measurements of sample k (those that are there)."""
    seen = np.isfinite(space.observed[k])
    if not seen.any():
        return x, p, 0.0, None
    output, sensitivity = _linearised(partial(space.measurement, k), x, space.perturbation)
    h = sensitivity[seen]
    innovation = space.observed[k][seen] - output[seen]
    spread = h @ p @ h.T + np.diag(space.noise_std[seen] ** 2)
    gain = np.linalg.solve(spread, h @ p).T
    keep = np.eye(x.size) - gain @ h
    p = keep @ p @ keep.T + gain @ np.diag(space.noise_std[seen] ** 2) @ gain.T
    _, log_determinant = np.linalg.slogdet(spread)
    distance = float(innovation @ np.linalg.solve(spread, innovation))
    gained = -0.5 * (distance + log_determinant + innovation.size * math.log(2.0 * math.pi))
    return x + gain @ innovation, p, gained, Update(gain, h, innovation, spread)


def _linearised(function: Callable[[Float], Float], x: Float, step: Float) -> tuple[Float, Float]:
    """Value (m,) at x and derivative (m, n), by one-sided differences of the perturbation's size."""
    values = function(np.vstack([x, x + np.diag(step)]))
    return values[0], (values[1:] - values[0]).T / step
