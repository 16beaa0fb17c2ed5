"""The push before the flight: when the lock opened, how far the body rose, and the speed it got.

The accelerometer's samples carry the push; where it is clipped, missing or slow, the spring sensor fills in, as
a = (m_l/M)(omega_0^2 delta + 2 lambda delta'), corrected by what the two differ where both speak.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flight.edge_model import E
from flight.flight_time import FlightFit
from flight.record import HopRecord
from flight.ringing import Ringing

Array = NDArray[np.float64]

_ONSET_S = 0.0025  # stretch after the opening over which the push falls as a cosine
_ONSET_ERROR_S = 3e-5  # of the opening's time: what the cosine leaves out
_JUMP_SHARE = 0.01  # of the jump at the opening: what else pulls on the body then, as the lock does
_CANDIDATES = 31
_SOFTEST_TO_FREE = (0.2, 1.05)  # square of the push's frequency over that of the free ringing


class NoPush(Exception):
    """The push cannot be followed; the message says why."""


@dataclass(frozen=True)
class Push:
    """Times (n,) from the opening to take-off, from the fire command, and the body's acceleration z'' there.

    `opening_sigma_s` is of the first time; `first_m_s2` is the jump of the acceleration at the opening.
    """

    times_s: Array
    acceleration_m_s2: Array
    opening_sigma_s: float

    @property
    def first_m_s2(self) -> float:
        return float(self.acceleration_m_s2[0])

    @property
    def gained_m_s(self) -> float:
        """Speed of the body at take-off, by integration from rest."""
        return float(_cumulative(self.times_s, self.acceleration_m_s2)[-1])

    def rise_m(self, speed_m_s: float) -> float:
        """Rise of the body until take-off, where its speed is given: integrated backwards."""
        gained = _cumulative(self.times_s, self.acceleration_m_s2)
        return float(_cumulative(self.times_s, speed_m_s - (gained[-1] - gained))[-1])


def find_push(record: HopRecord, fit: FlightFit, held_m: float, least_current_a: float = 0.0) -> Push:
    """The push of a hop; `held_m` is the spring's compression before. Raises `NoPush`.

    The lock does not open before the magnet's current has reached `least_current_a`.
    """
    end = fit.take_off.time_s
    ringing, share = fit.take_off.ringing, fit.robot.leg_share
    jump = share * ringing.stiffness_1_s2 * held_m
    bracket = _with_current(record, _opening_bracket(record, fit, jump), least_current_a)
    times, pushing = _merged(record, fit, held_m, bracket)
    inside = (times >= bracket[1]) & (times < end)
    if int(inside.sum()) < 3:
        raise NoPush("the push between the fire command and take-off is not covered by samples")
    rubbing = abs(float(fit.take_off.parameters[E.FRICTION]))
    jump_share = math.hypot(_JUMP_SHARE, rubbing / jump)
    opening, sigma = _onset(
        times[inside], pushing[inside], bracket, jump, jump_share, ringing, fit.noise_m_s2
    )
    last = float(np.interp(end, times, pushing))
    t = np.concatenate(([opening], times[inside], [end]))
    return Push(t, np.concatenate(([jump], pushing[inside], [last])), sigma)


def _opening_bracket(record: HopRecord, fit: FlightFit, jump: float) -> tuple[float, float]:
    """The last accelerometer sample before the push and the first in it."""
    times = record.times_s - record.fire_s
    pushed = record.saturated | (fit.motion_m_s2 - fit.rest_m_s2 > 0.2 * jump)
    moving = np.flatnonzero((times > 0.0) & (times < fit.take_off.time_s) & pushed)
    if moving.size == 0 or moving[0] == 0:
        raise NoPush("no push is seen between the fire command and take-off")
    return float(times[moving[0] - 1]), float(times[moving[0]])


def _with_current(
    record: HopRecord, bracket: tuple[float, float], least_current_a: float
) -> tuple[float, float]:
    """The bracket of the opening, begun no earlier than the magnet could open the lock, as its current shows."""
    times = record.magnet_times_s - record.fire_s
    enough = np.flatnonzero((times > 0.0) & (record.magnet_current_a >= least_current_a))
    if not enough.size or enough[0] == 0:
        return bracket
    earliest = float(times[enough[0] - 1])
    return (earliest, bracket[1]) if bracket[0] < earliest < bracket[1] else bracket


def _merged(
    record: HopRecord, fit: FlightFit, held_m: float, bracket: tuple[float, float]
) -> tuple[Array, Array]:
    """The body's acceleration z'' around the push by both sensors, on the times of both."""
    until = fit.take_off.time_s + 0.01
    times = record.times_s - record.fire_s
    near = (times > bracket[0] - 0.01) & (times < until)
    clipped = bool(np.any(record.saturated & near))
    usable = near & ~record.saturated
    times, pushing = times[usable], fit.motion_m_s2[usable] - fit.rest_m_s2
    spring_s = record.spring_times_s - record.fire_s
    chosen = (spring_s > bracket[1]) & (spring_s < until)
    spring_s = spring_s[chosen]
    if spring_s.size < 8:
        if clipped:
            raise NoPush("the accelerometer was saturated in the push, and no spring sensor fills in")
        return times, pushing
    ringing, robot = fit.take_off.ringing, fit.robot
    delta = record.compression_m[chosen]  # beyond the weight's own, which balances gravity
    rate = np.gradient(delta, spring_s)
    by_spring = robot.leg_share * (ringing.stiffness_1_s2 * delta + 2.0 * ringing.decay_1_s * rate)
    both = times > bracket[1]
    if both.any():
        difference = pushing[both] - np.interp(times[both], spring_s, by_spring)
        by_spring = by_spring + np.interp(spring_s, times[both], difference)
    together_s = np.concatenate((times, spring_s))
    order = np.argsort(together_s, kind="stable")
    return together_s[order], np.concatenate((pushing, by_spring))[order]


def _onset(
    times: Array,
    pushing: Array,
    bracket: tuple[float, float],
    jump: float,
    jump_share: float,
    ringing: Ringing,
    noise_m_s2: float,
) -> tuple[float, float]:
    """When the lock opened: the push starts at the known jump and falls as jump cos(w tau).

    Where the leg is free to go, w is that of the ringing; where the ground holds it, the body moves alone.
    """
    early = times < times[0] + _ONSET_S
    if int(early.sum()) < 3:
        early = np.arange(times.size) < 3
    t, seen = times[early], pushing[early]
    candidates = np.linspace(*bracket, _CANDIDATES)
    turns = np.sqrt(ringing.stiffness_1_s2 * np.linspace(*_SOFTEST_TO_FREE, _CANDIDATES))
    tau = (t - candidates[:, None])[:, None, :]
    phase = turns[:, None] * tau
    damped = (2.0 * ringing.decay_1_s / ringing.stiffness_1_s2) * turns[:, None]
    shape = np.cos(phase) - damped * np.sin(phase)
    # The cosine is flat where it starts: how early it did depends on the size of the jump, which is not quite known.
    power, matched = jump**2 * np.sum(shape**2, axis=2), jump * np.sum(seen * shape, axis=2)
    stiff = noise_m_s2**2 / jump_share**2
    size = (matched + stiff) / (power + stiff)
    errors = np.sum(seen**2) - 2.0 * size * matched + size**2 * power + stiff * (size - 1.0) ** 2
    errors = errors.min(axis=1)
    best = int(np.argmin(errors))
    variance = max(float(errors[best]) / max(t.size - 2, 1), noise_m_s2**2)
    likely = np.exp(-0.5 * (errors - errors[best]) / variance)
    mean = float(likely @ candidates / likely.sum())
    spread = math.sqrt(float(likely @ (candidates - mean) ** 2 / likely.sum()))
    grid_s = (bracket[1] - bracket[0]) / ((_CANDIDATES - 1) * math.sqrt(12.0))
    return mean, math.hypot(spread, grid_s, _ONSET_ERROR_S)


def _cumulative(t: Array, y: Array) -> Array:
    """Integral of y over t by trapezia, from the first point to each (n,)."""
    return np.concatenate(([0.0], np.cumsum(0.5 * (y[1:] + y[:-1]) * np.diff(t))))
