"""Bounded Levenberg-Marquardt for few unknowns and many residuals that are dear to simulate.

SciPy's bounded solvers were tried first: the trust-region reflective one takes two to three times the simulations
where the optimum lies on a bound (a nominal parameter pressed by missing physics does just that), dogbox stops
early there. Unknowns on a bound whose gradient points outward are held; the rest take a damped step, cut at the
bounds (Nocedal and Wright, Numerical Optimization, 2nd ed., ch. 10 and 16.7).

A fit that starts beside another one inherits its sensitivities. They are kept up by Broyden's rank-one update (Math.
Comput. 19 (1965) 577) and simulated anew only when they no longer bring progress; the new unknowns' own columns are
simulated at every step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Columns = NDArray[np.intp]

DAMPING = 1e-3
MOST_DAMPING = 1e8
SETTLED = 1e-2


@dataclass(frozen=True)
class Least:
    """Where a minimisation ended: unknowns, residuals, Jacobian, and whether that was simulated right there."""

    z: Float
    residuals: Float
    jacobian: Float
    fresh: bool

    @property
    def power(self) -> float:
        """The sum of squares."""
        return float(self.residuals @ self.residuals)


def minimise(
    residuals: Callable[[Float], Float],
    sensitivities: Callable[[Float, Float, Columns], Float],
    start: Float,
    low: Float,
    high: Float,
    *,
    tolerance: float,
    iterations: int,
    inherited: Float | None = None,
    own: Columns | None = None,
    rough: bool = False,
) -> Least:
    """The least sum of squares within [low, high].

    `sensitivities(z, residuals(z), columns)` are those columns of the Jacobian. Stops when a step that was hardly
    damped brings less than `tolerance`, relative to the sum of squares. With an `inherited` Jacobian only the `own`
    columns are simulated while that brings progress; a `rough` search ends where it no longer does.
    """
    every = np.arange(start.size)
    own = every if own is None else own
    z = np.clip(start, low, high)
    r = residuals(z)
    jacobian = np.zeros((r.size, z.size)) if inherited is None else inherited.copy()
    columns, fresh, damping = own if inherited is not None else every, inherited is None, DAMPING
    for _ in range(iterations):
        if columns.size:
            jacobian[:, columns] = sensitivities(z, r, columns)
        z_new, r_new, damping = _improve(residuals, jacobian, z, r, low, high, damping)
        before = float(r @ r)
        gained = before - float(r_new @ r_new)
        # a small gain under heavy damping is a short step, not the bottom
        done = gained <= 0.0 or (gained <= tolerance * before and damping <= SETTLED)
        last = done and (fresh or rough)
        if gained > 0.0:
            if not (last and fresh):  # what was just simulated is better than what one tiny step teaches
                jacobian = _updated(jacobian, z_new - z, r_new - r)
            z, r = z_new, r_new
        if last:
            return Least(z, r, jacobian, fresh)
        fresh = inherited is None or done
        columns = every if fresh else own
        damping = min(damping, DAMPING) if done else damping
    if not rough:
        jacobian, fresh = sensitivities(z, r, every), True
    return Least(z, r, jacobian, fresh)


def _updated(jacobian: Float, step: Float, change: Float) -> Float:
    """Broyden's update: the least change with which the Jacobian explains the step just made."""
    missed = change - jacobian @ step
    return np.asarray(jacobian + np.outer(missed, step / float(step @ step)))


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
