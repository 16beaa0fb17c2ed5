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
from functools import lru_cache

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

    def line(self) -> tuple[Array, Array, Array, Array]:
        """Force over leg mass is slope * depth - taken * deepest, but never less than zero.

        Slope, taken, above, least (n,): both depths count from `above` the ground, and the deepest is never less than
        `least`. Into a crater that is where the soft line would begin, and where it meets the stiff one.
        """
        between, none = self.stiff_1_s2 - self.soft_1_s2, np.zeros_like(self.stiff_1_s2)
        if self.leaving:
            return self.soft_1_s2, -between, none, none
        least = self.yield_m_s2 / self.soft_1_s2
        return self.stiff_1_s2, between, least - self.yield_m_s2 / self.stiff_1_s2, least


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
        delta, rate, *_, push = self.stepped()[:-1].swapaxes(0, 1)
        # Halfway through the impulse.
        by_rate = self.leg_share * self.damping_1_s
        felt = self.leg_share * self.stiffness_1_s2 * delta + by_rate * rate
        felt += 0.5 * self.step_s * by_rate * push
        return np.asarray(felt, dtype=np.float64)

    def stepped(self) -> Array:
        """What the ground does to the two masses (steps + 1, 5, n).

        Spring and foot move exactly between the steps; at each step the ground's push gives its impulse.
        Rows: extra delta and its rate, extra height of the foot and its rate; push over leg mass.
        """
        slope, taken, above, least = self.ground.line()
        move = _move(self.step_s, self.leg_share, self.stiffness_1_s2, self.damping_1_s)
        free, columns = self.free_depth_m + above, self.free_depth_m.shape[1]
        states, depth, less, zero = np.zeros((len(free) + 1, 5, columns)), *np.zeros((3, columns))
        deepest, remembers = np.maximum(free[0], least), bool(taken.any())
        steps = zip(free, states[:, 2], states[:, 4], states, states[1:, :4], strict=False)
        for free_m, foot_m, push, state, after in steps:
            np.subtract(free_m, foot_m, out=depth)
            np.multiply(slope, depth, out=push)
            if remembers:
                np.maximum(deepest, depth, out=deepest)
                np.multiply(taken, deepest, out=less)
                np.subtract(push, less, out=push)
            np.maximum(push, zero, out=push)
            np.dot(move, state, out=after)
        return states


@lru_cache(maxsize=32)
def _move(step_s: float, leg_share: float, stiffness_1_s2: float, damping_1_s: float) -> Array:
    """One step (4, 5) of delta, foot = com + (m_b/M) delta and their rates, from a state with its push."""
    foot = np.eye(4)  # of delta and centre of mass
    foot[2, 0] = foot[3, 1] = 1.0 - leg_share
    com = 2.0 * np.eye(4) - foot  # the other way
    move = np.empty((4, 5))
    move[:, :4] = foot @ _free_step(step_s, stiffness_1_s2, damping_1_s) @ com
    move[:, 4] = move[:, :4] @ (step_s * np.array((0.0, 1.0, 0.0, 1.0)))
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
