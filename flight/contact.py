"""What a foot that leaves or meets the ground does to the body's acceleration, by stepping the two masses.

Counted from the edge into the contact (backwards in time before take-off, forwards after touchdown), the foot first
goes on along its free path; the ground then pushes back with a force that grows with depth: stiffly along the line
on which pressed ground lets go and takes up again, more softly once the force is beyond what the ground bore before.
The push F adds F/m_l to the spring's acceleration and F/M to that of the centre of mass, and the body feels it
through spring and damper only, (m_l/M)(omega_0^2 delta + 2 lambda delta'). On hard ground the same equations bounce.
"""

from __future__ import annotations

import math
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

    def line(self) -> tuple[Array, Array, Array]:
        """Force over leg mass is slope * depth less taken * deepest - borne: slope, taken, borne (n,).

        Where the foot comes back, ground takes nothing off before it bears more than it did: there never below zero.
        """
        between = self.stiff_1_s2 - self.soft_1_s2
        if self.leaving:
            return self.soft_1_s2, -between, np.zeros_like(between)
        return self.stiff_1_s2, between, self.yield_m_s2 * between / self.stiff_1_s2


@dataclass(frozen=True)
class Contact:
    """Feet that would go so deep on their free paths, the grounds they meet, and the robot above them.

    `free_depth_m` (steps, n): how deep each foot would be without ground, at multiples of `step_s` into the contact.
    `leg_share`: m_l/M. `stiffness_1_s2` is omega_0^2, `damping_1_s` 2 lambda, negative where the steps run backwards
    in time.
    """

    free_depth_m: Array
    step_s: float
    ground: Ground
    leg_share: float
    stiffness_1_s2: float
    damping_1_s: float

    def felt_by_body(self) -> Array:
        """Extra acceleration of the body (steps, n) [m/s^2]."""
        states = self.stepped()
        # Halfway through the impulse.
        rate = states[:-1, 1] + 0.5 * self.step_s * states[:-1, 5]
        felt = self.stiffness_1_s2 * states[:-1, 0] + self.damping_1_s * rate
        return np.asarray(self.leg_share * felt, dtype=np.float64)

    def stepped(self) -> Array:
        """What the ground does to the two masses (steps + 1, 6, n).

        Spring and centre of mass move exactly between the steps; at each step the ground's push gives its impulse.
        Rows: extra delta and its rate, extra height of the centre of mass and its rate, extra height of the foot,
        which is com + (m_b/M) delta; push over leg mass.
        """
        columns = self.free_depth_m.shape[1]
        states, move = np.zeros((len(self.free_depth_m) + 1, 6, columns)), self._move()
        slope, taken, borne = self.ground.line()
        remembers, leaving = bool(taken.any()), self.ground.leaving
        deepest, depth, less = np.maximum(self.free_depth_m[0], 0.0), np.empty(columns), np.empty(columns)
        for free_m, state, after in zip(self.free_depth_m, states, states[1:, :5], strict=False):
            push = state[5]
            np.subtract(free_m, state[4], out=depth)
            np.multiply(slope, depth, out=push)
            if remembers:
                np.maximum(deepest, depth, out=deepest)
                np.multiply(taken, deepest, out=less)
                if not leaving:
                    less -= borne
                    np.maximum(less, 0.0, out=less)
                push -= less
            np.maximum(push, 0.0, out=push)
            np.matmul(move, state, out=after)
        return states

    def _move(self) -> Array:
        """One step (5, 6): from a state with its push to the state after it."""
        move = np.zeros((5, 6))
        move[:4, :4] = _free_step(self.step_s, self.stiffness_1_s2, self.damping_1_s)
        move[:4, 5] = move[:4, :4] @ (self.step_s * np.array((0.0, 1.0, 0.0, self.leg_share)))
        move[4] = np.array((1.0 - self.leg_share, 0.0, 1.0, 0.0)) @ move[:4]
        return move


def _free_step(step_s: float, stiffness_1_s2: float, damping_1_s: float) -> Array:
    """One step (4, 4) of the damped spring and of uniform motion."""
    half = 0.5 * damping_1_s
    omega = math.sqrt(max(stiffness_1_s2 - half**2, 1e-12))
    fade, cosine, sine = math.exp(-half * step_s), math.cos(omega * step_s), math.sin(omega * step_s) / omega
    step = np.eye(4)
    step[:2, :2] = fade * np.array(
        ((cosine + half * sine, sine), (-stiffness_1_s2 * sine, cosine - half * sine))
    )
    step[2, 3] = step_s
    return step
