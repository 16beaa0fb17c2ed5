"""Where in a hop's accelerometer record the robot flies: the stretch in which the spring rings freely."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flight.heartbeat import Heartbeat
from flight.least_squares import fit
from flight.ringing import Ringing

Array = NDArray[np.float64]

SEED_S = 0.025  # first stretch to be explained: half a period of the ringing
BLOCK_S = 0.003  # step by which the stretch grows
_SEED_STEP_S = 0.002
_SEARCH_S = 0.06  # the foot may touch again for this long after first leaving the ground
_PEAK_S = 0.12  # the release comes within this time after the magnet is energised
_LINE_STD = (0.5, 5.0)  # sensor bias [m/s^2] and slow forces [m/s^3] that a line may explain
_REFIT_GROWTH = 1.15
_SURPRISE = 6.0  # rms of a block, in sigmas, that the ringing did not predict
_EXPLAINED = 2.5  # rms of that block, once the ringing was fitted to it too, that is no contact


class NoFlight(Exception):
    """The record shows no flight; the message says what is missing."""


@dataclass(frozen=True)
class Stretch:
    """Samples [first, stop) explained by one ringing plus a straight line; rms of what is left [m/s^2]."""

    first: int
    stop: int
    ringing: Ringing
    offset_m_s2: float
    slope_m_s3: float
    rms_m_s2: float


@dataclass(frozen=True)
class _Expectation:
    omega_rad_s: float
    omega_std: float
    decay_1_s: float
    noise_m_s2: float
    heartbeat: Heartbeat


def find_flight(
    times_s: Array,
    motion_m_s2: Array,
    fire_s: float,
    weightless_m_s2: float,
    noise_m_s2: float,
    omega_rad_s: float,
    omega_std: float,
    decay_1_s: float,
    heartbeat: Heartbeat,
) -> Stretch:
    """The longest stretch of free ringing after the release.

    `motion_m_s2` (n,) is the body's specific force along the leg; `weightless_m_s2` is its value at which
    the leg's contact force vanishes on firm ground, -(m_l/m_b) g. Raises `NoFlight`.
    """
    expected = _Expectation(omega_rad_s, omega_std, decay_1_s, noise_m_s2, heartbeat)
    left = _first_release(times_s, motion_m_s2, fire_s, weightless_m_s2)
    seed = _best_seed(times_s, motion_m_s2, left, expected)
    noise = max(noise_m_s2, seed.rms_m_s2)
    forward = _grow(times_s, motion_m_s2, seed, expected, noise, +1)
    if forward.stop >= times_s.size:
        raise NoFlight("the record ends before the robot has touched down")
    return _grow(times_s, motion_m_s2, forward, expected, noise, -1)


def _first_release(times_s: Array, motion: Array, fire_s: float, weightless: float) -> int:
    window = np.flatnonzero((times_s >= fire_s) & (times_s < fire_s + _PEAK_S))
    if window.size == 0:
        raise NoFlight("no accelerometer samples after the fire command")
    peak = window[int(np.argmax(motion[window]))]
    after = np.flatnonzero(motion[peak:] < weightless)
    if after.size == 0:
        raise NoFlight("the leg was never pulled off the ground")
    return int(peak + after[0])


def _best_seed(times_s: Array, motion: Array, left: int, expected: _Expectation) -> Stretch:
    """The earliest half period that rings about as cleanly as the cleanest one."""
    starts = np.arange(times_s[left], times_s[left] + _SEARCH_S, _SEED_STEP_S)
    seeds = []
    for start_s in starts:
        first, stop = (int(i) for i in np.searchsorted(times_s, (start_s, start_s + SEED_S)))
        if stop < times_s.size and stop - first > 8:
            seeds.append(_explain(times_s, motion, first, stop, expected))
    if not seeds:
        raise NoFlight("the record ends right after the release")
    cleanest = min(seed.rms_m_s2 for seed in seeds)
    return next(seed for seed in seeds if seed.rms_m_s2 <= 1.5 * cleanest)


def _explain(
    times_s: Array, motion: Array, first: int, stop: int, expected: _Expectation, warm: Stretch | None = None
) -> Stretch:
    """Least squares of ringing and a line over samples [first, stop)."""
    t, y = times_s[first:stop], motion[first:stop]
    reference = float(t[0])
    omega, decay = expected.omega_rad_s, expected.decay_1_s
    if warm is not None:
        omega, decay = warm.ringing.omega_rad_s, warm.ringing.decay_1_s
    start = np.array((omega, decay, *_linear(t - reference, y, omega, decay)))
    mean = np.array((expected.omega_rad_s, expected.decay_1_s, 0.0, 0.0, 0.0, 0.0))
    std = np.array((expected.omega_std, expected.decay_1_s, np.inf, np.inf, *_LINE_STD))
    noise = expected.noise_m_s2

    def errors(p: Array) -> Array:
        ringing = Ringing(reference, float(p[0]), float(p[1]), float(p[2]), float(p[3]))
        left = y - ringing.acceleration_m_s2(t) - p[4] - p[5] * (t - reference)
        return np.asarray(left / noise, dtype=np.float64)

    solved = fit(errors, start, mean, std, expected.heartbeat, max_steps=6)
    ringing = Ringing(reference, *(float(value) for value in solved.parameters[:4]))
    rms = float(np.sqrt(np.mean(solved.residuals**2))) * noise
    return Stretch(first, stop, ringing, float(solved.parameters[4]), float(solved.parameters[5]), rms)


def _linear(tau: Array, y: Array, omega: float, decay: float) -> Array:
    """Amplitudes and line (4,) for a given pole: where the full fit starts."""
    fade = np.exp(-decay * tau)
    wave = (fade * np.cos(omega * tau), fade * np.sin(omega * tau), np.ones_like(tau), tau)
    columns = np.column_stack(wave)
    ridge = np.diag((0.0, 0.0, 0.1, 0.1))
    return np.asarray(np.linalg.solve(columns.T @ columns + ridge, columns.T @ y), dtype=np.float64)


def explained(stretch: Stretch, times_s: Array) -> Array:
    """The stretch's model at any times (n,)."""
    tau = times_s - stretch.ringing.reference_s
    line = stretch.offset_m_s2 + stretch.slope_m_s3 * tau
    return np.asarray(stretch.ringing.acceleration_m_s2(times_s) + line, dtype=np.float64)


def _grow(
    times_s: Array, motion: Array, stretch: Stretch, expected: _Expectation, noise: float, way: int
) -> Stretch:
    """Extend the stretch block by block, forwards or backwards, while its ringing predicts what comes."""
    block = max(3, round(BLOCK_S / float(np.median(np.diff(times_s)))))
    model = stretch  # refitted only now and then: it predicts well for a while
    while True:
        first, stop = (
            (stretch.stop, min(stretch.stop + block, times_s.size))
            if way > 0
            else (max(stretch.first - block, 0), stretch.first)
        )
        if stop - first < 3:
            return replace(model, first=stretch.first, stop=stretch.stop)
        longer = replace(stretch, first=min(first, stretch.first), stop=max(stop, stretch.stop))
        allowed = max(noise, model.rms_m_s2)
        error = motion[first:stop] - explained(model, times_s[first:stop])
        surprised = _rms(error) > _SURPRISE * allowed
        if surprised or longer.stop - longer.first > _REFIT_GROWTH * (model.stop - model.first):
            model = _explain(times_s, motion, longer.first, longer.stop, expected, model)
            error_after = motion[first:stop] - explained(model, times_s[first:stop])
            if surprised and _rms(error_after) > _EXPLAINED * allowed:
                model = _explain(times_s, motion, stretch.first, stretch.stop, expected, model)
                return _to_the_sample(model, error, _SURPRISE * allowed, way)
        stretch = longer


def _to_the_sample(stretch: Stretch, error: Array, allowed: float, way: int) -> Stretch:
    """Within a surprising block, the samples next to the stretch may still belong to it."""
    strange = np.abs(error if way > 0 else error[::-1]) > allowed
    still = int(np.argmax(strange)) if np.any(strange) else 0
    if way > 0:
        return replace(stretch, stop=stretch.stop + still)
    return replace(stretch, first=stretch.first - still)


def _rms(error: Array) -> float:
    return float(np.sqrt(np.mean(error**2)))
