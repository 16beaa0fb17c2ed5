"""What the accelerometer must read around one end of a flight: the spring rings, and on one side the ground acts.

Several parameter vectors are evaluated side by side: stepping the contact costs hardly more for many than for one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

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

    def ringing_of(self, p: Array) -> Ringing:
        """The free ringing of a parameter vector; its reference is where the edge was first put."""
        return Ringing(
            float(self.prior_mean[E.TIME]), *(float(p[i]) for i in (E.OMEGA, E.DECAY, E.COSINE, E.SINE))
        )


def model(data: EdgeData, points: Array) -> tuple[Array, Array]:
    """Of parameters (s, 11) the residuals (s, n) in noise sigmas, and the model's Jacobian (s, n, 11) in the same."""
    tau = data.times_s - data.prior_mean[E.TIME]
    p = points[:, :, None]
    fade = np.exp(-p[:, E.DECAY] * tau)
    cosine, sine = fade * np.cos(p[:, E.OMEGA] * tau), fade * np.sin(p[:, E.OMEGA] * tau)
    wave = p[:, E.COSINE] * cosine + p[:, E.SINE] * sine
    jacobian = np.zeros((*wave.shape, len(E)))
    jacobian[..., E.OMEGA] = tau * (p[:, E.SINE] * cosine - p[:, E.COSINE] * sine)
    jacobian[..., E.DECAY] = -tau * wave
    jacobian[..., E.COSINE], jacobian[..., E.SINE], jacobian[..., E.OFFSET] = cosine, sine, 1.0
    predicted = wave + p[:, E.OFFSET]
    if data.prior_std[E.FRICTION] > 1e-6:
        for index, point in enumerate(points):
            rubbed = data.ringing_of(point).half_turns(data.times_s, float(point[E.TIME]))
            jacobian[index, :, E.FRICTION] = rubbed
            predicted[index] += point[E.FRICTION] * rubbed
    touched = np.flatnonzero(np.any(data.way * (data.times_s - p[:, E.TIME]) > _UNTOUCHED_S, axis=0))
    if touched.size:
        extra = _contact(data, points, data.times_s[touched])
        predicted[:, touched] += extra[:, :, 0]
        jacobian[:, touched, : len(GROUND)] = (extra[:, :, 1:] - extra[:, :, :1]) / _STEP
    return (data.motion_m_s2 - predicted) / data.noise_m_s2, jacobian / data.noise_m_s2


def _contact(data: EdgeData, points: Array, times_s: Array) -> Array:
    """What the ground adds at times (m,): (s, m, 6) for the parameters, and each ground parameter moved."""
    moved = np.repeat(points[:, None, list(GROUND)], 6, axis=1)
    moved[:, 1:] += np.diag(_STEP)
    return added_by_ground(data, points, moved, times_s).swapaxes(0, 1)


def added_by_ground(data: EdgeData, points: Array, grounds: Array, times_s: Array) -> Array:
    """What grounds (s, n, 5), in the order of `GROUND`, add to the body's acceleration at times (m,): (m, s, n).

    The foot's path follows from the ringing in the parameters `points` (s, 11).
    """
    into = data.way * (times_s[:, None, None] - grounds[:, :, E.TIME])
    if times_s.size == 0 or float(into.max()) <= 0.0:
        return np.zeros(into.shape)
    step_s = _HARD_STEP_S if data.hard else _SOFT_STEP_S
    contact = _contact_of(data, points, grounds, math.ceil(float(into.max()) / step_s) + 2)
    felt = contact.felt_by_body()
    place = np.maximum(into / step_s, 0.0).reshape(times_s.size, -1)
    low = place.astype(np.int64)
    share, column = place - low, np.arange(felt.shape[1])
    felt = (1.0 - share) * felt[low, column] + share * felt[low + 1, column]
    return np.asarray(felt.reshape(into.shape), dtype=np.float64)


def pushed(data: EdgeData, point: Array) -> tuple[Array, Array]:
    """When into the contact (steps,) [s], and how hard over its mass the ground pushes the foot (steps,) [m/s^2].

    `point` (11,). As far as there are samples.
    """
    step_s = _HARD_STEP_S if data.hard else _SOFT_STEP_S
    into_s = float((data.way * (data.times_s - point[E.TIME])).max())
    count = math.ceil(max(into_s, 0.0) / step_s) + 2
    states = _contact_of(data, point[None], point[None, None, list(GROUND)], count).stepped()
    return np.arange(count) * np.float64(step_s), states[:-1, 5, 0]


def _contact_of(data: EdgeData, points: Array, grounds: Array, steps: int) -> Contact:
    """The contact with grounds (s, n, 5), side by side."""
    step_s = _HARD_STEP_S if data.hard else _SOFT_STEP_S
    tau: Array = np.arange(steps) * np.float64(step_s)
    stiff = np.exp(grounds[:, :, E.STIFF]).ravel()
    given = np.exp(grounds[:, :, E.SOFT]).ravel()
    soft = stiff if data.hard else stiff * given / (stiff + given)
    ground = Ground(stiff, np.exp(grounds[:, :, E.YIELD]).ravel(), soft, data.way == TAKE_OFF)
    depth = _free_depth(data, points, grounds, tau).reshape(steps, -1)
    damping = 2.0 * data.way * data.spring.decay_1_s
    return Contact(depth, step_s, ground, data.robot.leg_share, data.spring.stiffness_1_s2, damping)


def _free_depth(data: EdgeData, points: Array, grounds: Array, tau: Array) -> Array:
    """How deep below the edge's height the foot would be on its free path (steps, s, n)."""
    robot, edges_s, tau = data.robot, grounds[:, :, E.TIME], tau[:, None, None]
    speed = data.speed_m_s - robot.gravity_m_s2 * (edges_s - data.speed_at_s)
    rise = (data.way * speed - grounds[:, :, E.SPEED]) * tau - 0.5 * robot.gravity_m_s2 * tau**2
    pole = (1j * points[:, E.OMEGA] - points[:, E.DECAY])[:, None]
    phasor = (points[:, E.COSINE] - 1j * points[:, E.SINE])[:, None]
    there = phasor * np.exp(pole * (edges_s - data.prior_mean[E.TIME])) / (-robot.leg_share * pole**2)
    turned = np.exp(pole * data.way * tau) - 1.0
    swung = there.real * turned.real - there.imag * turned.imag
    return np.asarray(-(rise + (1.0 - robot.leg_share) * swung), dtype=np.float64)
