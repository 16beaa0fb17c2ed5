"""A foot that has left the ground and comes down once more, while the body's push on the spring is not yet over.

Its path after it left has a lowest point near the height at which it left. That height is known to some micrometres
only; but a foot that touches there is thrown up again, and the spring rings differently from then on, which a few
samples before and many after tell. Both together give the odds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flight.edge_fit import Edge
from flight.edge_model import E, EdgeData, model

Array = NDArray[np.float64]

_STEP_S, _STEPS = 2e-4, 126  # of the foot's path after it left, over 25 ms
_PATH_M = 1e-5  # what the path may be wrong by beside its speed
_FAR_SIGMAS = 6.0  # from the ground: such a lowest point is clear of it
_FEW = 3.0  # samples between leaving and touching: with fewer, a kick rests on what the contact's model got right
_SPEEDS = 2000  # of touching, over which the odds are summed
_LEFT_OUT = 0.025  # a 95 % interval leaves a moment out that is less likely


@dataclass(frozen=True)
class Graze:
    """`after_s`: from the first leaving to the second, if the foot touches; `odds` that it does."""

    after_s: float
    odds: float

    @property
    def words(self) -> str:
        when = f"{self.after_s * 1e3:.0f} ms after it left"
        return f"the foot may have touched again, {when} (probability {self.odds:.2f})"


@dataclass(frozen=True)
class _Lowest:
    """The lowest point of the foot's path: when after the edge, how high above it, curved how much upwards."""

    after_s: float
    height_m: float
    curve_m_s2: float


def graze(edge: Edge) -> Graze | None:
    """Whether the foot touches once more after a take-off. None where its path keeps clear of the ground."""
    lowest = _lowest(edge)
    if lowest is None:
        return None
    speed_std = math.sqrt(edge.covariance[E.SPEED, E.SPEED])
    sigma_m = math.hypot(_PATH_M, speed_std * lowest.after_s)
    if lowest.height_m > _FAR_SIGMAS * sigma_m:
        return None
    kick, kick_sigma, shift = _kick(edge, edge.time_s + lowest.after_s)
    most = math.sqrt(2.0 * lowest.curve_m_s2 * (_FAR_SIGMAS * sigma_m + abs(lowest.height_m)))
    speeds: Array = np.linspace(0.0, most, _SPEEDS)
    # On a spring of the ground's stiffness; what the free path would have turned of itself is no kick.
    omega = math.exp(0.5 * float(edge.parameters[E.STIFF]))
    held_s = 2.0 / omega * np.arctan(speeds * omega / lowest.curve_m_s2)
    kicks = 2.0 * speeds - lowest.curve_m_s2 * held_s
    # A kick that was there moves what the samples say of the foot's speed before, and with it the lowest point.
    slower = kicks * shift
    expected = lowest.height_m + slower * lowest.after_s - 0.5 * slower**2 / lowest.curve_m_s2
    path = ((-0.5 * speeds**2 / lowest.curve_m_s2) - expected) / sigma_m
    seen = (kicks - kick) / kick_sigma
    logs = -0.5 * (path**2 + seen**2)
    clear = math.log(max(0.5 * math.erfc(-lowest.height_m / sigma_m / math.sqrt(2.0)), 1e-300))
    clear -= 0.5 * (kick / kick_sigma) ** 2
    highest = max(float(logs.max()), clear)
    weights = np.exp(logs - highest) * speeds
    touching = (
        float(weights.sum()) * float(speeds[1]) / lowest.curve_m_s2 / sigma_m / math.sqrt(2.0 * math.pi)
    )
    away_s = held_s - (speeds + slower) / lowest.curve_m_s2
    later_s = float(weights @ away_s / weights.sum()) if touching > 0.0 else 0.0
    return Graze(lowest.after_s + later_s, touching / (touching + math.exp(clear - highest)))


def undecided(again: Graze | None, reach_s: float) -> str:
    """Why the take-off is one of two moments, further apart than an interval may reach; empty where it is one.

    A value and its sigma cannot say that: either moment would be a wrong number.
    """
    if again is None or again.after_s <= reach_s or not _LEFT_OUT < again.odds < 1.0 - _LEFT_OUT:
        return ""
    return again.words


def _lowest(edge: Edge) -> _Lowest | None:
    """The first lowest point of the foot's free path after it left, by a parabola through three looks."""
    data, ringing = edge.data, edge.ringing
    tau = np.arange(0.0, _STEPS) * _STEP_S
    away = -ringing.phasor(edge.time_s) / (data.robot.leg_share * ringing.pole**2)
    swung = (away * (np.exp(ringing.pole * tau) - 1.0)).real
    com = data.speed_m_s - data.robot.gravity_m_s2 * (edge.time_s - data.speed_at_s)
    speed = com + float(edge.parameters[E.SPEED])
    height = speed * tau - 0.5 * data.robot.gravity_m_s2 * tau**2 + (1.0 - data.robot.leg_share) * swung
    low = np.flatnonzero((height[1:-1] < height[:-2]) & (height[1:-1] <= height[2:])) + 1
    if not low.size:
        return None
    at = int(low[0])
    bend = float(height[at + 1] - 2.0 * height[at] + height[at - 1])
    slope = 0.5 * float(height[at + 1] - height[at - 1])
    return _Lowest(
        float(tau[at]) - slope / bend * _STEP_S,
        float(height[at]) - 0.5 * slope**2 / bend,
        bend / _STEP_S**2,
    )


def _kick(edge: Edge, at_s: float) -> tuple[float, float, float]:
    """Change of the foot's speed [m/s] that the samples show at a time, its sigma, and d(foot's speed)/d(kick)."""
    data = edge.data
    left, jacobian = (each[0] for each in model(data, edge.parameters[None]))
    column = _unit_kick(data, edge, at_s) / data.noise_m_s2
    covariance = np.linalg.inv(jacobian @ jacobian.T + np.diag(data.prior_std**-2.0))
    moved = covariance @ (jacobian @ column)
    information = float(column @ column - (jacobian @ column) @ moved)
    between = int(np.sum((data.times_s > edge.time_s) & (data.times_s < at_s)))
    temper = 1.0 + (_FEW / max(between, 1)) ** 2
    sigma = max(1.0, edge.misfits()[0]) * math.sqrt(temper / max(information, 1e-12))
    return float(column @ left) / max(information, 1e-12), sigma, -float(moved[E.SPEED])


def _unit_kick(data: EdgeData, edge: Edge, at_s: float) -> Array:
    """What a change of the foot's speed by 1 m/s at a time makes the samples before it read less (n,) [m/s^2]."""
    omega, decay = float(edge.parameters[E.OMEGA]), float(edge.parameters[E.DECAY])
    tau = np.minimum(data.times_s - at_s, 0.0)
    swing, turn = (
        np.exp(-decay * tau) * np.sin(omega * tau) / omega,
        np.exp(-decay * tau) * np.cos(omega * tau),
    )
    rate = turn - decay * swing
    felt = data.robot.leg_share * ((omega**2 + decay**2) * swing + 2.0 * decay * rate)
    return np.asarray(np.where(data.times_s < at_s, -felt, 0.0), dtype=np.float64)
