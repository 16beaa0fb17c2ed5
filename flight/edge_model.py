"""What the accelerometer must read around one end of a flight: the spring rings, and on one side the ground acts.

Several parameter vectors are evaluated side by side: stepping the contact costs hardly more for many than for one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flight.contact import Contact, Ground
from flight.ringing import Ringing, TwoMass

Array = NDArray[np.float64]

TAKE_OFF, TOUCHDOWN = -1.0, 1.0  # into the contact, time runs this way
_SOFT_STEP_S, _HARD_STEP_S = 1.5e-4, 5e-5  # of the contact: a fifth of a radian of its oscillation
_UNTOUCHED_S = -2e-6  # so close to an edge a sample counts as touched, for the derivative by the edge's time


class E(IntEnum):
    """Parameters of an edge: its time, logs of the ground's figures, error of the foot's speed; then the ringing.

    SOFT is how stiffly the ground gives way for good; what it gives back, along STIFF, comes on top of that.
    """

    TIME, STIFF, SPEED, YIELD, SOFT, OMEGA, DECAY, COSINE, SINE, OFFSET, FRICTION = range(11)


GROUND = (E.TIME, E.STIFF, E.SPEED, E.YIELD, E.SOFT)  # the first ones of `E`
_STEP = np.array((1e-6, 1e-4, 1e-5, 1e-4, 1e-4))


@dataclass(frozen=True)
class EdgeData:
    """Samples around an edge and what is known of the motion there.

    times_s, motion_m_s2 (n,): the body's specific force along the leg. `way`: TAKE_OFF or TOUCHDOWN. `hard` ground
    gives nothing away. `speed_m_s`: of the centre of mass at `speed_at_s`.
    `spring` rings as seen in flight; what the ground adds is stepped with it.
    `prior_mean`, `prior_std` (11,) in the order of `E`.
    """

    times_s: Array
    motion_m_s2: Array
    noise_m_s2: float
    way: float
    hard: bool
    robot: TwoMass
    speed_m_s: float
    speed_at_s: float
    spring: Ringing
    prior_mean: Array
    prior_std: Array

    @cached_property
    def acting(self) -> tuple[E, ...]:
        """What the samples can tell of the ground: hard ground gives nothing, one that is left has borne more."""
        hard, leaving = self.hard, self.way == TAKE_OFF
        return GROUND[:3] if hard else (*GROUND[:3], E.SOFT) if leaving else GROUND

    @cached_property
    def moved(self) -> Array:
        """What is added to a ground (1 + a, 5) for the derivatives: nothing, then a step of each that is acting."""
        return np.vstack((np.zeros(len(GROUND)), np.diag(_STEP)[list(self.acting)]))

    @cached_property
    def tau_s(self) -> Array:
        """Times (n,) from where the edge was first put."""
        return np.asarray(self.times_s - self.prior_mean[E.TIME], dtype=np.float64)

    @cached_property
    def prior_weight(self) -> Array:
        """Of the prior in the normal equations (11, 11)."""
        return np.diag(self.prior_std**-2.0)

    def ringing_of(self, p: Array) -> Ringing:
        """The free ringing of a parameter vector; its reference is where the edge was first put."""
        return Ringing(
            float(self.prior_mean[E.TIME]), *(float(p[i]) for i in (E.OMEGA, E.DECAY, E.COSINE, E.SINE))
        )


def model(data: EdgeData, points: Array) -> tuple[Array, Array]:
    """Of parameters (s, 11) the residuals (s, n) in noise sigmas, and the model's Jacobian (s, 11, n) in the same.

    What the ringing's parameters change of the foot's path into the ground is left out of the Jacobian.
    """
    tau, per_noise = data.tau_s, 1.0 / data.noise_m_s2
    p = points.T[:, :, None]
    jacobian = np.zeros((len(points), len(E), tau.size))
    fade, turn = np.exp(-p[E.DECAY] * tau) * per_noise, p[E.OMEGA] * tau
    cosine = np.multiply(fade, np.cos(turn), out=jacobian[:, E.COSINE])
    sine = np.multiply(fade, np.sin(turn), out=jacobian[:, E.SINE])
    wave = p[E.COSINE] * cosine + p[E.SINE] * sine
    np.multiply(tau, p[E.SINE] * cosine - p[E.COSINE] * sine, out=jacobian[:, E.OMEGA])
    np.multiply(-tau, wave, out=jacobian[:, E.DECAY])
    jacobian[:, E.OFFSET] = per_noise
    left = (data.motion_m_s2 - p[E.OFFSET]) * per_noise - wave
    if data.prior_std[E.FRICTION] > 1e-6:
        for index, point in enumerate(points):
            rubbed = data.ringing_of(point).half_turns(data.times_s, float(point[E.TIME])) * per_noise
            jacobian[index, E.FRICTION] = rubbed
            left[index] -= point[E.FRICTION] * rubbed
    touched = _touched(data, points)
    if data.times_s[touched].size:
        grounds = points[:, None, : len(GROUND)] + data.moved
        extra = added_by_ground(data, points, grounds, data.times_s[touched]) * per_noise
        left[:, touched] -= extra[:, :, 0].T
        extra[:, :, 1:] -= extra[:, :, :1]
        for row, name in enumerate(data.acting, start=1):
            np.divide(extra[:, :, row].T, _STEP[name], out=jacobian[:, name, touched])
    return left, jacobian


def _touched(data: EdgeData, points: Array) -> slice:
    """Samples in contact by any of the parameters (s, 11): the first before take-off, the last after touchdown."""
    if data.way == TAKE_OFF:
        return slice(0, int(np.searchsorted(data.times_s, points[:, E.TIME].max() - _UNTOUCHED_S)))
    first = np.searchsorted(data.times_s, points[:, E.TIME].min() + _UNTOUCHED_S, side="right")
    return slice(int(first), None)


def added_by_ground(data: EdgeData, points: Array, grounds: Array, times_s: Array) -> Array:
    """What grounds (s, n, 5), in the order of `GROUND`, add to the body's acceleration at times (m,): (m, s, n).

    The foot's path follows from the ringing in the parameters `points` (s, 11).
    """
    into = data.way * (times_s[:, None, None] - grounds[:, :, E.TIME])
    if times_s.size == 0 or (longest_s := float(into.max())) <= 0.0:
        return np.zeros(into.shape)
    step_s = _HARD_STEP_S if data.hard else _SOFT_STEP_S
    contact = _contact_of(data, points, grounds, math.ceil(longest_s / step_s) + 2)
    felt = contact.felt_by_body()
    place = np.maximum(into / step_s, 0.0).reshape(times_s.size, -1)
    low = place.astype(np.int64)
    place -= low
    low *= felt.shape[1]
    low += np.arange(felt.shape[1])
    before, after = felt.take(low), felt.take(low + felt.shape[1])
    return np.asarray((before + place * (after - before)).reshape(into.shape), dtype=np.float64)


def pushed(data: EdgeData, point: Array) -> tuple[Array, Array]:
    """When into the contact (steps,) [s], and how hard over its mass the ground pushes the foot (steps,) [m/s^2].

    `point` (11,). As far as there are samples.
    """
    step_s = _HARD_STEP_S if data.hard else _SOFT_STEP_S
    into_s = float((data.way * (data.times_s - point[E.TIME])).max())
    count = math.ceil(max(into_s, 0.0) / step_s) + 2
    states = _contact_of(data, point[None], point[None, None, list(GROUND)], count).stepped()
    return np.arange(count) * np.float64(step_s), states[:-1, 4, 0]


def _contact_of(data: EdgeData, points: Array, grounds: Array, steps: int) -> Contact:
    """The contact with grounds (s, n, 5), side by side."""
    step_s = _HARD_STEP_S if data.hard else _SOFT_STEP_S
    tau: Array = np.arange(steps) * np.float64(step_s)
    stiff, borne, given = np.exp(grounds.reshape(-1, len(GROUND)).T[[E.STIFF, E.YIELD, E.SOFT]])
    soft = stiff if data.hard else stiff * given / (stiff + given)
    ground = Ground(stiff, borne, soft, data.way == TAKE_OFF)
    depth = _free_depth(data, points, grounds, tau).reshape(steps, -1)
    damping = 2.0 * data.way * data.spring.decay_1_s
    return Contact(depth, step_s, ground, data.robot.leg_share, data.spring.stiffness_1_s2, damping)


def _free_depth(data: EdgeData, points: Array, grounds: Array, tau: Array) -> Array:
    """How deep below the edge's height the foot would be on its free path (steps, s, n)."""
    robot, edges_s = data.robot, grounds[:, :, E.TIME]
    speed = data.speed_m_s - robot.gravity_m_s2 * (edges_s - data.speed_at_s)
    pole = (1j * points[:, E.OMEGA] - points[:, E.DECAY])[:, None]
    phasor = (points[:, E.COSINE] - 1j * points[:, E.SINE])[:, None]
    swing = (robot.leg_share - 1.0) / robot.leg_share * phasor / pole**2
    swing = swing * np.exp(pole * (edges_s - data.prior_mean[E.TIME]))
    turned = (np.exp(tau[:, None] * (data.way * pole[:, 0])) - 1.0)[:, :, None]
    depth = (grounds[:, :, E.SPEED] - data.way * speed) * tau[:, None, None]
    depth += (0.5 * robot.gravity_m_s2 * tau**2)[:, None, None]
    depth -= swing.real * turned.real
    depth += swing.imag * turned.imag
    return np.asarray(depth, dtype=np.float64)
