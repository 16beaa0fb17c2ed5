"""What a foot that leaves or meets the ground does to the body's acceleration, by stepping the two masses.

Counted from the edge into the contact (backwards in time before take-off, forwards after touchdown), the foot first
goes on along its free path; the ground then pushes back with a force that grows with depth: stiffly along the line
on which pressed ground lets go and takes up again, more softly once the force is beyond what the ground bore before.
The push F adds F/m_l to the spring's acceleration and F/M to that of the centre of mass, and the body feels it
through spring and damper only, (m_l/M)(omega_0^2 delta + 2 lambda delta'). On hard ground the same equations bounce.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Ground:
    """Contact laws side by side, each array (n,), per leg mass: two slopes of force over depth.

    Into a crater (`leaving` False) the force grows along `stiff_1_s2` up to `yield_m_s2`, then along `soft_1_s2`,
    and falls again along `stiff_1_s2`.
    Backwards from take-off (`leaving`) it grows along `stiff_1_s2` to the deepest point, and falls again along
    `soft_1_s2`, on which the ground was loaded before.
    """

    stiff_1_s2: Array
    yield_m_s2: Array
    soft_1_s2: Array
    leaving: bool

    def push_m_s2(self, depth_m: Array, deepest_m: Array) -> Array:
        """Force over leg mass at a depth (n,); none where the foot is above the ground."""
        force = self.stiff_1_s2 * deepest_m
        if self.leaving:
            return np.maximum(force - self.soft_1_s2 * (deepest_m - depth_m), 0.0)
        more = self.yield_m_s2 + (force - self.yield_m_s2) * (self.soft_1_s2 / self.stiff_1_s2)
        return np.maximum(np.minimum(force, more) - self.stiff_1_s2 * (deepest_m - depth_m), 0.0)


def felt_by_body(
    free_depth_m: Array,
    step_s: float,
    ground: Ground,
    leg_share: float,
    stiffness_1_s2: float,
    damping_1_s: float,
) -> Array:
    """Extra acceleration of the body (steps, n) [m/s^2] at multiples of `step_s` into the contact.

    `free_depth_m` (steps, n): how deep the foot would be without ground. `damping_1_s` is 2 lambda, negative where
    the steps run backwards in time. Velocity Verlet with the damping of the half step.
    """
    steps, columns = free_depth_m.shape
    spring = np.zeros(columns)  # extra delta
    rate = np.zeros(columns)
    com = np.zeros(columns)
    com_rate = np.zeros(columns)
    deepest = np.maximum(free_depth_m[0], 0.0)
    push = ground.push_m_s2(free_depth_m[0], deepest)
    felt = np.zeros((steps, columns))
    half, body_share = 0.5 * step_s, 1.0 - leg_share
    for index in range(1, steps):
        rate += half * (push - stiffness_1_s2 * spring - damping_1_s * rate)
        com_rate += (half * leg_share) * push
        spring += step_s * rate
        com += step_s * com_rate
        depth = free_depth_m[index] - com - body_share * spring
        deepest = np.maximum(deepest, depth)
        push = ground.push_m_s2(depth, deepest)
        rate += half * (push - stiffness_1_s2 * spring - damping_1_s * rate)
        com_rate += (half * leg_share) * push
        felt[index] = stiffness_1_s2 * spring + damping_1_s * rate
    return leg_share * felt
