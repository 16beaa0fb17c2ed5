"""One end of a flight, fitted: the spring rings freely on one side of the edge, the ground acts on the other."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from flight.contact import Ground, felt_by_body
from flight.heartbeat import Heartbeat
from flight.ringing import Ringing, TwoMass

Array = NDArray[np.float64]

TAKE_OFF, TOUCHDOWN = -1.0, 1.0  # into the contact, time runs this way
_MAX_STEPS = 20
_SOFT_STEP_S, _HARD_STEP_S = 1e-4, 5e-5  # of the contact: a fifth of a radian of its oscillation
_ROUGH = (0.1, 0.03)  # share of what soft and hard ground adds that a start may miss
_APART_S = 4e-4  # of two starts


class E(IntEnum):
    """Parameters of an edge: its time, logs of the ground's figures, error of the foot's speed; then the ringing."""

    TIME, STIFF, SPEED, YIELD, SOFT, OMEGA, DECAY, COSINE, SINE, OFFSET, FRICTION = range(11)


_GROUND = (E.TIME, E.STIFF, E.SPEED, E.YIELD, E.SOFT)
_STEP = np.array((1e-6, 1e-4, 1e-5, 1e-4, 1e-4))


@dataclass(frozen=True)
class EdgeData:
    """Samples around an edge and what is known of the motion there.

    times_s, motion_m_s2 (n,): the body's specific force along the leg. `way`: TAKE_OFF or TOUCHDOWN. `hard` ground
    gives nothing away. `speed_m_s`: of the centre of mass at `speed_at_s`.
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
    prior_mean: Array
    prior_std: Array


@dataclass(frozen=True)
class Edge:
    """A fitted edge: parameters and covariance by `E`, residuals (n,) in noise sigmas, cost with priors."""

    data: EdgeData
    parameters: Array
    covariance: Array
    residuals: Array
    cost: float
    converged: bool

    @property
    def time_s(self) -> float:
        return float(self.parameters[E.TIME])

    @property
    def ringing(self) -> Ringing:
        return ringing_of(self.parameters, self.data)

    @property
    def foot_speed_m_s(self) -> float:
        """Upward speed of the foot where it leaves the ground, or downward where it comes back."""
        data = self.data
        com = data.speed_m_s - data.robot.gravity_m_s2 * (self.time_s - data.speed_at_s)
        rate = self.ringing.compression(self.time_s, data.robot)[1]
        foot = com + (1.0 - data.robot.leg_share) * rate
        return -data.way * foot + float(self.parameters[E.SPEED])

    def misfits(self) -> tuple[float, float]:
        """Root mean square residual in noise sigmas: in flight, in contact."""
        contact = self.data.way * (self.data.times_s - self.time_s) > 0.0
        squares = self.residuals**2
        return tuple(
            math.sqrt(float(np.mean(squares[part]))) if part.any() else 0.0 for part in (~contact, contact)
        )  # type: ignore[return-value]


def ringing_of(p: Array, data: EdgeData) -> Ringing:
    """The free ringing of a parameter vector; its reference is where the edge was first put."""
    return Ringing(
        float(data.prior_mean[E.TIME]), *(float(p[i]) for i in (E.OMEGA, E.DECAY, E.COSINE, E.SINE))
    )


def fit_edge(data: EdgeData, start: Array, heartbeat: Heartbeat) -> Edge:
    """Levenberg-Marquardt from `start` (11,). Raises `ValueError` where the fit leads nowhere."""
    weight = 1.0 / data.prior_std
    point = start.copy()
    left, jacobian = _model(data, point)
    cost = _cost(left, (point - data.prior_mean) * weight)
    if not math.isfinite(cost):
        raise ValueError("the residuals at the start of the fit are not finite")
    damping, converged = 1e-3, False
    for _ in range(_MAX_STEPS):
        heartbeat.beat()
        normal = jacobian.T @ jacobian + np.diag(weight**2)
        gradient = jacobian.T @ left - (point - data.prior_mean) * weight**2
        scale = np.sqrt(np.diag(normal))
        lifted = normal / np.outer(scale, scale) + damping * np.eye(point.size)
        trial = point + np.linalg.solve(lifted, gradient / scale) / scale
        with np.errstate(all="ignore"):  # a step too far is refused below
            trial_left, trial_jacobian = _model(data, trial)
            trial_cost = _cost(trial_left, (trial - data.prior_mean) * weight)
        if math.isfinite(trial_cost) and trial_cost <= cost:
            gain = cost - trial_cost
            point, left, jacobian, cost = trial, trial_left, trial_jacobian, trial_cost
            damping = max(damping * 0.1, 1e-9)
            if gain < 0.01 + 1e-3 * cost:
                converged = True
                break
        else:
            damping *= 10.0
            if damping > 1e8:
                converged = True
                break
    normal = jacobian.T @ jacobian + np.diag(weight**2)
    scale = np.sqrt(np.diag(normal))
    covariance = np.linalg.inv(normal / np.outer(scale, scale)) / np.outer(scale, scale)
    return Edge(data, point, covariance, left, cost, converged)


def _cost(left: Array, off: Array) -> float:
    return float(left @ left + off @ off)


def _model(data: EdgeData, p: Array) -> tuple[Array, Array]:
    """Residuals (n,) in noise sigmas, and the model's Jacobian (n, 11) in the same unit."""
    ringing = ringing_of(p, data)
    tau = data.times_s - ringing.reference_s
    fade = np.exp(-ringing.decay_1_s * tau)
    cosine, sine = fade * np.cos(ringing.omega_rad_s * tau), fade * np.sin(ringing.omega_rad_s * tau)
    wave = p[E.COSINE] * cosine + p[E.SINE] * sine
    jacobian = np.zeros((tau.size, len(E)))
    jacobian[:, E.OMEGA] = tau * (p[E.SINE] * cosine - p[E.COSINE] * sine)
    jacobian[:, E.DECAY] = -tau * wave
    jacobian[:, E.COSINE], jacobian[:, E.SINE], jacobian[:, E.OFFSET] = cosine, sine, 1.0
    rubbed = ringing.half_turns(data.times_s, float(p[E.TIME]))
    jacobian[:, E.FRICTION] = rubbed
    into = data.way * (data.times_s - p[E.TIME])
    touched = into > -2e-6
    extra = _contact(data, p, ringing, data.times_s[touched])
    predicted = wave + p[E.OFFSET] + p[E.FRICTION] * rubbed
    predicted[touched] += extra[:, 0]
    jacobian[np.ix_(touched, _GROUND)] = (extra[:, 1:] - extra[:, :1]) / _STEP
    return (data.motion_m_s2 - predicted) / data.noise_m_s2, jacobian / data.noise_m_s2


def _contact(data: EdgeData, p: Array, ringing: Ringing, times_s: Array) -> Array:
    """What the ground adds at times (m,): columns (m, 6) for the parameters, and each ground parameter moved."""
    moved = np.repeat(p[None, list(_GROUND)], 6, axis=0)
    moved[1:] += np.diag(_STEP)
    return _added(data, ringing, moved, times_s)


def _added(data: EdgeData, ringing: Ringing, grounds: Array, times_s: Array) -> Array:
    """What each ground (n, 5), parameters as in `_GROUND`, adds to the body's acceleration at times (m,): (m, n)."""
    into = data.way * (times_s[:, None] - grounds[:, 0])
    if times_s.size == 0 or float(into.max()) <= 0.0:
        return np.zeros(into.shape)
    step_s = _HARD_STEP_S if data.hard else _SOFT_STEP_S
    tau: Array = np.arange(math.ceil(float(into.max()) / step_s) + 1) * np.float64(step_s)
    stiff = np.exp(grounds[:, E.STIFF])
    soft = stiff if data.hard else np.minimum(np.exp(grounds[:, E.SOFT]), stiff)
    ground = Ground(stiff, np.exp(grounds[:, E.YIELD]), soft, data.way == TAKE_OFF)
    depth = _free_depth(data, ringing, tau, grounds[:, 0]) + grounds[:, E.SPEED] * tau[:, None]
    damping = 2.0 * data.way * ringing.decay_1_s
    felt = felt_by_body(depth, step_s, ground, data.robot.leg_share, ringing.stiffness_1_s2, damping)
    return np.column_stack([np.interp(into[:, i], tau, felt[:, i], left=0.0) for i in range(len(grounds))])


def starts(
    data: EdgeData, edges_s: Array, stiff_logs: tuple[float, ...], speeds: tuple[float, ...], most: int
) -> list[Array]:
    """The most promising starts (11,) for the fit: all edges, stiffnesses and foot speeds (in sigmas) are tried."""
    p = data.prior_mean
    grid = np.array(
        [(e, k, v * data.prior_std[E.SPEED]) for e in edges_s for k in stiff_logs for v in speeds]
    )
    grounds = np.column_stack((grid, np.tile(p[[E.YIELD, E.SOFT]], (len(grid), 1))))
    ringing = ringing_of(p, data)
    outer = data.way * (data.times_s - (edges_s.min() if data.way > 0.0 else edges_s.max())) > -1e-3
    times = data.times_s[outer]
    left = data.motion_m_s2[outer] - ringing.acceleration_m_s2(times) - p[E.OFFSET]
    left = left - p[E.FRICTION] * ringing.half_turns(times, float(p[E.TIME]))
    rough = _ROUGH[data.hard]
    with np.errstate(all="ignore"):
        added = _added(data, ringing, grounds, times)
        misses = (left[:, None] - added) ** 2 / (
            data.noise_m_s2**2 + (rough * added) ** 2 + (rough * left[:, None]) ** 2
        )
    order = np.argsort(np.nan_to_num(misses.sum(axis=0), nan=np.inf))
    found: list[Array] = []
    for index in order.tolist():
        start = p.copy()
        start[list(_GROUND)] = grounds[index]
        if all(abs(start[E.TIME] - other[E.TIME]) > _APART_S for other in found):
            found.append(start)
        if len(found) == most:
            break
    return found


def _free_depth(data: EdgeData, ringing: Ringing, tau: Array, edge_s: Array) -> Array:
    """How deep below the edge's height the foot would be on its free path (steps, n)."""
    robot = data.robot
    body_share = 1.0 - robot.leg_share
    speed = data.speed_m_s - robot.gravity_m_s2 * (edge_s - data.speed_at_s)
    rise = data.way * speed * tau[:, None] - 0.5 * robot.gravity_m_s2 * tau[:, None] ** 2
    pole = ringing.pole
    delta = np.array([ringing.phasor(float(t)) for t in edge_s]) / (-robot.leg_share * pole**2)
    turned = np.exp(pole * data.way * tau)[:, None] - 1.0
    return np.asarray(-(rise + body_share * (delta * turned).real), dtype=np.float64)
