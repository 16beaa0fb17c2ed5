"""Where in a hop's accelerometer record the robot flies: windows in which the spring rings about free fall."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flight.ringing import TwoMass
from flight.settings import FlightSettings

Array = NDArray[np.float64]

SHORTEST_S = 0.03  # of a flight that counts
_WINDOW_PERIODS = (
    0.6  # of the ringing: long enough to tell it from a push, short enough to end close to an edge
)
_SHAPES = 5  # a constant, and a ringing whose amplitude and phase may drift
_PUSH_OVER = 0.5  # body's specific force, in g, below which the push is over
_PEAK_S = 0.15  # release and push are over within this time after the magnet is energised
_SEARCH_S = 0.02  # after the push the foot leaves the ground for good within this time
_SIGMAS, _AMPLITUDE_SHARE, _GRAVITY_SHARE = 8.0, 0.03, 0.05  # what a window in flight may leave unexplained
_FIRST_AMPLITUDE_SHARE = 0.015
_NOT_FALLING, _SIGMAS_OF_LEVEL, _LEVEL_SHARE = 0.4, 4.0, 0.1  # mean of a window that is no free fall
_MAYBE = 2.0  # how much worse a few windows within a flight may fit


class NoFlight(Exception):
    """The record shows no flight; the message says what is missing."""


@dataclass(frozen=True)
class Expectation:
    """How this robot should ring, before its record was seen."""

    robot: TwoMass
    leg_mass_kg: float
    omega_rad_s: float
    omega_std: float
    decay_1_s: float
    decay_std: float

    @staticmethod
    def of(settings: FlightSettings) -> Expectation:
        rig = settings.rig
        total_kg = rig.body_mass_kg + rig.leg_mass_kg
        share = rig.leg_mass_kg / total_kg
        stiffness = rig.spring_stiffness_n_m / (rig.body_mass_kg * share)
        decay = 0.5 * rig.spring_damping_n_s_m / (rig.body_mass_kg * share)
        omega = math.sqrt(stiffness - decay**2)
        return Expectation(
            TwoMass(share, rig.gravity_m_s2),
            rig.leg_mass_kg,
            omega,
            0.5 * omega * math.hypot(rig.spring_stiffness_std_share, rig.mass_std_share),
            decay,
            rig.spring_damping_std_share * decay,
        )


@dataclass(frozen=True)
class Windows:
    """Sliding least squares of `_SHAPES` over `width` samples of an even grid; arrays (n,) by first sample."""

    step_s: float
    width: int
    starts_s: Array
    level_m_s2: Array
    amplitude_m_s2: Array
    rms_m_s2: Array
    level_per_noise: float


@dataclass(frozen=True)
class Stretch:
    """A flight as the windows show it: it lies about between these times."""

    first_s: float
    last_s: float


def evened(times_s: Array, values: Array) -> tuple[float, Array, Array]:
    """Samples on an even grid: step, times, values; what is missing is interpolated by cubics through four.

    Grid points lie on the samples as far as these are evenly spaced.
    """
    step = float(np.median(np.diff(times_s)))
    place = np.concatenate(([0], np.cumsum(np.maximum(1, np.round(np.diff(times_s) / step).astype(int)))))
    step = float((times_s[-1] - times_s[0]) / place[-1])
    grid = times_s[0] + step * np.arange(place[-1] + 1)
    filled = np.interp(grid, times_s, values)
    present = np.zeros(grid.size, dtype=np.bool_)
    present[place] = True
    filled[place] = values
    gaps = np.flatnonzero(~present)
    after = np.searchsorted(place, gaps)
    inside = (after >= 2) & (after <= place.size - 2)
    gaps, after = gaps[inside], after[inside]
    four = place[after[:, None] + np.arange(-2, 2)]
    x, known = gaps[:, None] - four, filled[four]
    weights = np.ones_like(x, dtype=np.float64)
    for i in range(4):
        for j in range(4):
            if i != j:
                weights[:, i] *= x[:, j] / (four[:, i] - four[:, j])
    filled[gaps] = np.sum(weights * known, axis=1)
    return step, grid, filled


def slide(step_s: float, times_s: Array, values: Array, pole: complex, periods: float) -> Windows:
    """Least squares of a drifting ringing about a level in all windows of so many periods.

    `pole` of the ringing: -decay + i omega.
    """
    width = max(_SHAPES + 3, round(periods * 2.0 * math.pi / pole.imag / step_s))
    if width >= values.size:
        raise NoFlight("the record is too short to hold a flight")
    tau = (np.arange(width) - 0.5 * (width - 1)) * step_s
    wave = np.exp(pole * tau)
    cosine, sine = wave.real, wave.imag
    drift = tau / (0.5 * width * step_s)
    shapes = np.column_stack((np.ones(width), cosine, sine, drift * cosine, drift * sine))
    basis, triangle = np.linalg.qr(shapes)
    # Shape by shape: a product of matrices this large would be spread over all of the board's cores.
    found = np.array([np.correlate(values, shape) for shape in basis.T])
    coefficients = np.linalg.solve(triangle, found)
    power = np.correlate(values**2, np.ones(width))
    left = np.maximum(power - np.sum(found**2, axis=0), 0.0)
    return Windows(
        step_s,
        width,
        times_s[: left.size],
        coefficients[0],
        np.hypot(coefficients[1], coefficients[2]),
        np.sqrt(left / (width - _SHAPES)),
        float(np.linalg.norm(np.linalg.inv(triangle)[0])),
    )


def find_flight(times_s: Array, motion_m_s2: Array, expected: Expectation, noise_m_s2: float) -> Stretch:
    """The first flight after the release.

    `times_s` (n,) counts from the fire command; `motion_m_s2` (n,) is the body's specific force along the leg.
    Raises `NoFlight`.
    """
    step, times, motion = evened(times_s, motion_m_s2)
    begin = _push_over(times, motion, expected)
    windows = slide(step, times, motion, complex(-expected.decay_1_s, expected.omega_rad_s), _WINDOW_PERIODS)
    soon = slice(begin, begin + 2 * windows.width)
    first_amplitude = (
        float(np.median(windows.amplitude_m_s2[soon])) if begin < windows.level_m_s2.size else 0.0
    )
    falling, allowed = _falling(windows, expected.robot.gravity_m_s2, noise_m_s2, first_amplitude)
    falling[: max(begin - 1, 0)] = False
    first, last = _first_run(falling, math.ceil(SHORTEST_S / step) - windows.width, begin, step)
    maybe = windows.rms_m_s2 < np.maximum(_MAYBE * allowed, _MAYBE * _FIRST_AMPLITUDE_SHARE * first_amplitude)
    last = _without_glitches(
        falling, maybe & ~_landing(windows, motion, expected, first_amplitude), last, windows.width
    )
    stop = last + windows.width
    if stop >= motion.size - 3:
        raise NoFlight("the record ends before the robot has touched down")
    return Stretch(float(times[first]), float(times[stop - 1]))


def falls_s(
    times_s: Array, motion_m_s2: Array, expected: Expectation, noise_m_s2: float
) -> list[tuple[float, float]]:
    """Begin and end of all stretches in which the spring rings about free fall. Arguments as of `find_flight`."""
    step, times, motion = evened(times_s, motion_m_s2)
    pole = complex(-expected.decay_1_s, expected.omega_rad_s)
    windows = slide(step, times, motion, pole, _WINDOW_PERIODS)
    falling, _ = _falling(windows, expected.robot.gravity_m_s2, noise_m_s2, 0.0)
    return [(float(times[a]), float(times[b - 1 + windows.width - 1])) for a, b in _runs(falling)]


def _runs(true: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and one past the last of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], true.astype(np.int8), [0]))))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _falling(
    windows: Windows, gravity_m_s2: float, noise_m_s2: float, first_amplitude_m_s2: float
) -> tuple[NDArray[np.bool_], Array]:
    """Windows (n,) in which the spring rings about free fall, and what each may leave unexplained."""
    allowed = np.maximum(_SIGMAS * noise_m_s2, _AMPLITUDE_SHARE * windows.amplitude_m_s2)
    allowed = np.maximum(
        allowed, _GRAVITY_SHARE * gravity_m_s2 + _FIRST_AMPLITUDE_SHARE * first_amplitude_m_s2
    )
    still = _NOT_FALLING * gravity_m_s2 + _SIGMAS_OF_LEVEL * windows.level_per_noise * noise_m_s2
    off = still + _LEVEL_SHARE * windows.amplitude_m_s2 + 2.0 * _FIRST_AMPLITUDE_SHARE * first_amplitude_m_s2
    return (windows.rms_m_s2 < allowed) & (np.abs(windows.level_m_s2) < off), allowed


def _landing(
    windows: Windows, motion: Array, expected: Expectation, first_amplitude_m_s2: float
) -> NDArray[np.bool_]:
    """Windows (n,) over which the ground throws the body back: faster than ringing, or a biased sensor, could tell.

    A soft landing lasts as long as a turn of the ringing and may fit it nearly as well as a mechanism that sticks.
    """
    span = 2 * windows.width
    speed = np.cumsum(motion) * windows.step_s
    count, half = windows.level_m_s2.size, windows.width // 2
    first = np.clip(np.arange(count) + half - windows.width, 0, speed.size - 1)
    after = np.clip(first + span, 0, speed.size - 1)
    rung = 2.0 * first_amplitude_m_s2 / expected.omega_rad_s  # it only decays before the landing
    fallen = _NOT_FALLING * expected.robot.gravity_m_s2 * (after - first) * windows.step_s
    return np.asarray(speed[after] - speed[first] > rung + fallen)


def _without_glitches(falling: NDArray[np.bool_], maybe: NDArray[np.bool_], last: int, width: int) -> int:
    """The last window of a flight in which a few windows may fit less well: a mechanism that sticks and slips."""
    while True:
        again = np.flatnonzero(falling[last + 1 : last + 1 + 2 * width])
        if not again.size or not maybe[last + 1 : last + 1 + int(again[0])].all():
            return last
        last += 1 + int(again[0])
        stop = np.flatnonzero(~falling[last:])
        last = last + int(stop[0]) - 1 if stop.size else falling.size - 1


def _push_over(times_s: Array, motion: Array, expected: Expectation) -> int:
    """The first sample at which the spring, after the release, hardly pushes the body any more.

    Take-off is near: a little later on firm ground, where the leg must first be pulled up.
    """
    window = np.flatnonzero((times_s >= 0.0) & (times_s < _PEAK_S))
    if window.size == 0:
        raise NoFlight("no accelerometer samples after the fire command")
    gravity = expected.robot.gravity_m_s2
    pushing = np.flatnonzero(motion[window] > 2.0 * gravity)
    if pushing.size == 0:
        raise NoFlight("no push is seen after the fire command")
    peak = window[int(pushing[0])]
    after = np.flatnonzero(motion[peak:] < _PUSH_OVER * gravity)
    if after.size == 0 or times_s[peak + after[0]] > _PEAK_S:
        raise NoFlight("the robot was never pulled off the ground")
    return int(peak + after[0])


def _first_run(falling: NDArray[np.bool_], least: int, begin: int, step_s: float) -> tuple[int, int]:
    """First and last window of the first run of at least `least` windows; it must begin soon after the push."""
    for first, stop in _runs(falling):
        if (first - begin) * step_s > _SEARCH_S:
            break
        if stop - first >= max(least, 1):
            return first, stop - 1
    raise NoFlight("the robot was not seen to fly after the push")
