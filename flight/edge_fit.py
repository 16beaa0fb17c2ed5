"""One end of a flight, fitted: the spring rings freely on one side of the edge, the ground acts on the other."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flight.edge_model import GROUND, E, EdgeData, added_by_ground, model
from flight.heartbeat import Heartbeat
from flight.ringing import Ringing

Array = NDArray[np.float64]

_MAX_STEPS = 25
_ENOUGH = 0.02  # of the cost: a step that gains less ends the fit
_ENOUGH_SHARE = 0.02  # of what a fit that explains little costs beyond one that explains all
_GIVE_UP_DAMPING = 1e3
_HOPELESS = (2, 50.0)  # after so many steps, a fit so much worse than the best is left alone
_MOST_MOVE_S, _FURTHEST_S = 2e-3, 0.012  # of an edge: in one step, and from where it was first put
_THROWN_M_S = 0.2
_SAME_S = 3e-5  # so close, two fits are one
_SOIL_LOG = 14.2  # of stiffness over leg mass [1/s^2]: soils stay below
_LEAST_M_S, _LEAST_SHARE = 1e-4, 1e-9  # sigma of a foot's speed; of that sigma, what goes the right way
_MOST_LOG = 50.0  # of one weight over another
_ROUGH = (0.1, 0.03)  # share of what soft and hard ground adds that a start may miss


@dataclass(frozen=True)
class Edge:
    """A fitted edge: parameters and covariance by `E`, residuals (n,) in noise sigmas, cost with priors."""

    data: EdgeData
    parameters: Array
    covariance: Array
    residuals: Array
    cost: float

    @property
    def time_s(self) -> float:
        return float(self.parameters[E.TIME])

    @property
    def cost_per_sample(self) -> float:
        return self.cost / self.residuals.size

    @cached_property
    def ringing(self) -> Ringing:
        return self.data.ringing_of(self.parameters)

    @property
    def is_soil(self) -> bool:
        """Whether the ground is too soft for steel, by two sigma, and throws the foot as pressed soil does."""
        stiff = float(self.parameters[E.STIFF]) + 2.0 * math.sqrt(self.covariance[E.STIFF, E.STIFF])
        return stiff < _SOIL_LOG and self.foot_speed_m_s > _THROWN_M_S

    @property
    def evidence(self) -> float:
        """Twice the negative logarithm of how likely the samples are, but for a constant: with the peak's volume.

        At what height the ground is, nobody knows: the foot's path crosses it as likely as it is steep there.
        """
        z, sigma = self.foot_speed_sigmas, self._foot_speed_sigma_m_s
        share = 0.5 * math.erfc(-z / math.sqrt(2.0))
        forwards = math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi) + z * share  # mean of what is above zero
        steep = 2.0 * math.log(sigma * max(forwards, _LEAST_SHARE))
        return self.cost - float(np.linalg.slogdet(self.covariance)[1]) - steep

    @cached_property
    def foot_speed_sigmas(self) -> float:
        """The foot's speed at the edge over what the fit leaves open of it."""
        return self.foot_speed_m_s / self._foot_speed_sigma_m_s

    @cached_property
    def _foot_speed_sigma_m_s(self) -> float:
        robot = self.data.robot
        swing = self.ringing.phasor(self.time_s).real
        rising = -robot.gravity_m_s2 - (1.0 - robot.leg_share) / robot.leg_share * swing
        slope, of = -self.data.way * rising, self.covariance
        square = slope**2 * of[E.TIME, E.TIME] + 2.0 * slope * of[E.TIME, E.SPEED] + of[E.SPEED, E.SPEED]
        return max(math.sqrt(max(square, 0.0)), _LEAST_M_S)

    @cached_property
    def foot_speed_m_s(self) -> float:
        """Upward speed of the foot where it leaves the ground, or downward where it comes back."""
        data = self.data
        com = data.speed_m_s - data.robot.gravity_m_s2 * (self.time_s - data.speed_at_s)
        rate = self.ringing.compression(self.time_s, data.robot)[1]
        foot = com + (1.0 - data.robot.leg_share) * rate
        return -data.way * foot + float(self.parameters[E.SPEED])

    def pull(self, name: E) -> float:
        """How far the fit drew a parameter away from what was known of it, in that knowledge's sigmas."""
        return abs(
            float(self.parameters[name] - self.data.prior_mean[name]) / float(self.data.prior_std[name])
        )

    def misfits(self) -> tuple[float, float]:
        """Root mean square residual in noise sigmas: in flight, in contact."""
        contact = self.data.way * (self.data.times_s - self.time_s) > 0.0
        squares = self.residuals**2
        return tuple(
            math.sqrt(float(np.mean(squares[part]))) if part.any() else 0.0 for part in (~contact, contact)
        )  # type: ignore[return-value]


def fit_edges(data: EdgeData, starts: Array, heartbeat: Heartbeat) -> list[Edge]:
    """Levenberg-Marquardt from all `starts` (s, 11) at once; those that lead nowhere are left out."""
    points = starts.copy()
    damping, running = np.full(len(points), 1e-3), np.ones(len(points), dtype=np.bool_)
    with np.errstate(all="ignore"):  # what overflows is refused
        costs, left, normal, gradient = _looked_at(data, points)
        running &= np.isfinite(costs)
        for step in range(_MAX_STEPS):
            if step >= _HOPELESS[0]:
                running &= costs < costs.min() + _HOPELESS[1]
            now = np.flatnonzero(running)
            if not now.size:
                break
            heartbeat.beat()
            trial = points[now] + _moves(data, points[now], normal[now], gradient[now], damping[now])
            tried = _looked_at(data, trial)
            gains = costs[now] - tried[0]
            good = gains >= 0.0
            for own, new in zip((points, costs, left, normal, gradient), (trial, *tried), strict=True):
                own[now[good]] = new[good]
            damping[now] *= np.where(good, 0.1, 10.0)
            enough = _ENOUGH + _ENOUGH_SHARE * np.maximum(costs[now] - 2.0 * data.times_s.size, 0.0)
            running[now] = np.where(good, gains > enough, damping[now] < _GIVE_UP_DAMPING)
    kept = np.flatnonzero(np.isfinite(costs))
    scale = np.sqrt(normal[kept].diagonal(axis1=1, axis2=2))
    square = scale[:, :, None] * scale[:, None, :]
    covariance = np.linalg.inv(normal[kept] / square) / square
    return [
        Edge(data, points[index], covariance[row], left[index], float(costs[index]))
        for row, index in enumerate(kept.tolist())
    ]


def _looked_at(data: EdgeData, points: Array) -> tuple[Array, Array, Array, Array]:
    """Costs (s,), infinite where a model is; residuals (s, n); normal equations (s, 11, 11) and gradient (s, 11)."""
    left, jacobian = model(data, points)
    off = points - data.prior_mean
    pull = off @ data.prior_weight
    normal = jacobian @ jacobian.swapaxes(1, 2)
    normal += data.prior_weight
    gradient = (jacobian @ left[:, :, None])[:, :, 0] - pull
    costs = (left[:, None, :] @ left[:, :, None])[:, 0, 0] + (off * pull).sum(axis=1)
    finite = np.isfinite(costs + normal.trace(axis1=1, axis2=2))
    return np.where(finite, costs, np.inf), left, normal, gradient


def _moves(data: EdgeData, points: Array, normal: Array, gradient: Array, damping: Array) -> Array:
    """Damped steps (s, 11), each parameter in its own scale."""
    scale = np.sqrt(normal.diagonal(axis1=1, axis2=2))
    lifted = normal / (scale[:, :, None] * scale[:, None, :])
    lifted[:, range(len(E)), range(len(E))] += damping[:, None]
    moves = np.linalg.solve(lifted, (gradient / scale)[..., None])[..., 0] / scale
    off_s = points[:, E.TIME] - data.prior_mean[E.TIME]
    limited = np.minimum(np.maximum(moves[:, E.TIME], -_MOST_MOVE_S), _MOST_MOVE_S)
    moves[:, E.TIME] = np.minimum(np.maximum(off_s + limited, -_FURTHEST_S), _FURTHEST_S) - off_s
    return np.asarray(moves, dtype=np.float64)


def starts(data: EdgeData, tried: Mapping[E, Sequence[float]], most: int, apart_s: float) -> Array:
    """The most promising starts (s, 11): all combinations of what is `tried` for parameters of the ground."""
    p = data.prior_mean
    ringing = data.ringing_of(p)
    axes = np.meshgrid(*(tried.get(name, (p[name],)) for name in GROUND), indexing="ij")
    grid = np.stack(axes, axis=-1).reshape(-1, len(GROUND))
    edges_s = grid[:, E.TIME]
    outer = data.way * (data.times_s - (edges_s.min() if data.way > 0.0 else edges_s.max())) > -1e-3
    times = data.times_s[outer]
    left = data.motion_m_s2[outer] - ringing.acceleration_m_s2(times) - p[E.OFFSET]
    if p[E.FRICTION]:
        left = left - p[E.FRICTION] * ringing.half_turns(times, float(p[E.TIME]))
    rough = _ROUGH[data.hard]
    with np.errstate(all="ignore"):
        added = added_by_ground(data, p[None], grid[None], times)[:, 0]
        known = data.noise_m_s2**2 + (rough * left[:, None]) ** 2
        misses = (left[:, None] - added) ** 2 / (known + (rough * added) ** 2)
    order = np.argsort(np.nan_to_num(misses.sum(axis=0), nan=np.inf))
    found: list[Array] = []
    while order.size and len(found) < most:
        ground = grid[order[0]]
        found.append(np.concatenate((ground, p[len(ground) :])))
        order = order[np.abs(edges_s[order] - ground[E.TIME]) > apart_s]
    return np.array(found)


def mixed(edges: Sequence[Edge], costs: Sequence[float], temper: float, choices: int | None = None) -> Edge:
    """The best of several fits, its variance widened by the others as far as they are as likely.

    `temper`: by which costs count less, as the models are not all of the truth. `choices`: so many of the first fits
    may be the best, all where not given.
    """
    best_cost, chosen = min(zip(costs[:choices], range(len(costs)), strict=False))
    best = edges[chosen]
    seen_s: list[float] = []
    weights: list[float] = []
    squares: list[float] = []
    order = [chosen, *np.argsort(costs, kind="stable").tolist()]
    for index in order:  # fits that ended at one place count once
        at_s = edges[index].time_s
        if all(abs(at_s - other) > _SAME_S for other in seen_s):
            seen_s.append(at_s)
            weights.append(math.exp(min(-0.5 / temper * (costs[index] - best_cost), _MOST_LOG)))
            squares.append((at_s - best.time_s) ** 2)
    covariance = best.covariance.copy()
    covariance[E.TIME, E.TIME] += float(np.dot(weights, squares)) / sum(weights)
    return replace(best, covariance=covariance)
