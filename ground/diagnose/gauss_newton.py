"""Bounded Levenberg-Marquardt for few unknowns and many residuals that are dear to simulate.

SciPy's bounded solvers were tried first: the trust-region reflective one takes two to three times the simulations
where the optimum lies on a bound (a nominal parameter pressed by missing physics does just that), dogbox stops
early there. Unknowns on a bound whose gradient points outward are held; the rest take a damped step, cut at the
bounds (Nocedal and Wright, Numerical Optimization, 2nd ed., ch. 10 and 16.7).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

DAMPING = 1e-3
MOST_DAMPING = 1e8
SETTLED = 1e-2


def minimise(
    residuals: Callable[[Float], Float],
    sensitivities: Callable[[Float, Float], Float],
    start: Float,
    low: Float,
    high: Float,
    *,
    tolerance: float,
    iterations: int,
) -> tuple[Float, Float, Float]:
    """Unknowns, residuals and their Jacobian at the least sum of squares within [low, high].

    `sensitivities(z, residuals(z))` is the Jacobian. Stops when a step that was
    hardly damped brings less than `tolerance`, relative to the sum of squares.
    """
    z = np.clip(start, low, high)
    r = residuals(z)
    jacobian = sensitivities(z, r)
    damping = DAMPING
    for _ in range(iterations):
        z_new, r_new, damping = _improve(residuals, jacobian, z, r, low, high, damping)
        gained = float(r @ r) - float(r_new @ r_new)
        if gained <= 0.0:
            break
        before, z, r = float(r @ r), z_new, r_new
        jacobian = sensitivities(z, r)
        if gained <= tolerance * before and damping <= SETTLED:
            break  # a small gain under heavy damping is a short step, not the bottom
    return z, r, jacobian


def _improve(
    residuals: Callable[[Float], Float],
    jacobian: Float,
    z: Float,
    r: Float,
    low: Float,
    high: Float,
    damping: float,
) -> tuple[Float, Float, float]:
    """A step that lowers the sum of squares, with ever more damping; the old point when there is none."""
    gradient = jacobian.T @ r
    information = jacobian.T @ jacobian
    held = ((z <= low) & (gradient > 0.0)) | ((z >= high) & (gradient < 0.0))
    free = np.flatnonzero(~held)
    power = float(r @ r)
    while damping < MOST_DAMPING and free.size:
        size = np.diag(information)[free]
        damped = information[np.ix_(free, free)] + np.diag(
            damping * np.maximum(size, 1e-12 * size.max() + 1e-300)
        )
        moved = z.copy()
        moved[free] -= np.linalg.lstsq(damped, gradient[free], rcond=None)[0]
        moved = np.clip(moved, low, high)
        there = residuals(moved)
        if float(there @ there) < power:
            return moved, there, max(damping / 10.0, 1e-9)
        damping *= 10.0
    return z, r, damping
