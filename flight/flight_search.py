"""Where in a hop's accelerometer record the robot flies: the stretch in which the spring rings freely."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flight.heartbeat import Heartbeat
from flight.least_squares import fit
from flight.ringing import Ringing, TwoMass
from flight.settings import FlightSettings

Array = NDArray[np.float64]

SEED_S = 0.025  # first stretch to be explained: half a period of the ringing
BLOCK_S = 0.003  # step by which the stretch grows
_SEED_STEP_S = 0.002
_SEARCH_S = 0.06  # the foot may touch again for this long after first leaving the ground
_PUSH_OVER = 0.5  # body's specific force, in g, below which the push is over
_PEAK_S = 0.12  # release and push are over within this time after the magnet is energised
_LINE_STD = (0.5, 5.0)  # sensor bias [m/s^2] and slow forces [m/s^3] that a line may explain
_REFIT_GROWTH = 1.15
_LANDING_SAMPLES = 10  # needed after touchdown to tell it from the end of the record
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
class Expectation:
    """How this robot should ring, before its record was seen."""

    robot: TwoMass
    leg_mass_kg: float
    omega_rad_s: float
    omega_std: float
    decay_1_s: float
    decay_std: float
    noise_m_s2: float

    @staticmethod
    def of(settings: FlightSettings) -> Expectation:
        rig = settings.rig
        total_kg = rig.body_mass_kg + rig.leg_mass_kg
        share = rig.leg_mass_kg / total_kg
        stiffness = rig.spring_stiffness_n_m / (rig.body_mass_kg * share)
        decay = 0.5 * rig.spring_damping_n_s_m / (rig.body_mass_kg * share)
        omega = math.sqrt(stiffness - decay**2)
        return Expectation(
            TwoMass(share, rig.body_mass_kg / rig.leg_mass_kg, rig.gravity_m_s2),
            rig.leg_mass_kg,
            omega,
            0.5 * omega * math.hypot(rig.spring_stiffness_std_share, rig.mass_std_share),
            decay,
            rig.spring_damping_std_share * decay,
            settings.sensors.accelerometer_noise_m_s2 / rig.sensor_gain,
        )


def find_flight(times_s: Array, motion_m_s2: Array, expected: Expectation, heartbeat: Heartbeat) -> Stretch:
    """The longest stretch of free ringing after the release.

    `times_s` (n,) counts from the fire command; `motion_m_s2` (n,) is the body's specific force along the
    leg. Raises `NoFlight`.
    """
    search = _Search(times_s, motion_m_s2, expected, heartbeat)
    left = search.first_release()
    seed = search.best_seed(left)
    noise = max(expected.noise_m_s2, seed.rms_m_s2)
    forward = search.grow(seed, noise, +1)
    if times_s.size - forward.stop < _LANDING_SAMPLES:
        raise NoFlight("the record ends before the robot has touched down")
    return search.grow(forward, noise, -1)


def explained(stretch: Stretch, times_s: Array) -> Array:
    """The stretch's model at any times (n,)."""
    tau = times_s - stretch.ringing.reference_s
    line = stretch.offset_m_s2 + stretch.slope_m_s3 * tau
    return np.asarray(stretch.ringing.acceleration_m_s2(times_s) + line, dtype=np.float64)


@dataclass(frozen=True)
class _Search:
    times_s: Array
    motion: Array
    expected: Expectation
    heartbeat: Heartbeat

    def first_release(self) -> int:
        """The first sample at which the spring, after the release, hardly pushes the body any more.

        Take-off is near: a little later on firm ground, where the leg must first be pulled up.
        """
        window = np.flatnonzero((self.times_s >= 0.0) & (self.times_s < _PEAK_S))
        if window.size == 0:
            raise NoFlight("no accelerometer samples after the fire command")
        peak = window[int(np.argmax(self.motion[window]))]
        gravity = self.expected.robot.gravity_m_s2
        if self.motion[peak] < 2.0 * gravity:
            raise NoFlight("no push is seen after the fire command")
        after = np.flatnonzero(self.motion[peak:] < _PUSH_OVER * gravity)
        if after.size == 0 or self.times_s[peak + after[0]] > _PEAK_S:
            raise NoFlight("the robot was never pulled off the ground")
        return int(peak + after[0])

    def best_seed(self, left: int) -> Stretch:
        """The earliest half period that rings about as cleanly as the cleanest one."""
        begin_s, seeds = self.times_s[left], []
        for start_s in np.arange(begin_s, begin_s + _SEARCH_S, _SEED_STEP_S):
            first, stop = (int(i) for i in np.searchsorted(self.times_s, (start_s, start_s + SEED_S)))
            if stop < self.times_s.size and stop - first > 8:
                seeds.append(self.explain(first, stop))
        if not seeds:
            raise NoFlight("the record ends right after the release")
        cleanest = min(seed.rms_m_s2 for seed in seeds)
        return next(seed for seed in seeds if seed.rms_m_s2 <= 1.5 * cleanest)

    def explain(self, first: int, stop: int, warm: Stretch | None = None) -> Stretch:
        """Least squares of ringing and a line over samples [first, stop)."""
        t, y, expected = self.times_s[first:stop], self.motion[first:stop], self.expected
        reference = float(t[0])
        omega, decay = expected.omega_rad_s, expected.decay_1_s
        if warm is not None:
            omega, decay = warm.ringing.omega_rad_s, warm.ringing.decay_1_s
        start = np.array((omega, decay, *_linear(t - reference, y, omega, decay)))
        mean = np.array((expected.omega_rad_s, expected.decay_1_s, 0.0, 0.0, 0.0, 0.0))
        std = np.array((expected.omega_std, expected.decay_1_s, np.inf, np.inf, *_LINE_STD))

        def errors(p: Array) -> Array:
            ringing = Ringing(reference, float(p[0]), float(p[1]), float(p[2]), float(p[3]))
            left = y - ringing.acceleration_m_s2(t) - p[4] - p[5] * (t - reference)
            return np.asarray(left / expected.noise_m_s2, dtype=np.float64)

        solved = fit(errors, start, mean, std, self.heartbeat, max_steps=6)
        ringing = Ringing(reference, *(float(value) for value in solved.parameters[:4]))
        offset, slope = (float(value) for value in solved.parameters[4:])
        return Stretch(first, stop, ringing, offset, slope, _rms(solved.residuals) * expected.noise_m_s2)

    def grow(self, stretch: Stretch, noise: float, way: int) -> Stretch:
        """Extend the stretch block by block, forwards or backwards, while its ringing predicts what comes."""
        block = max(3, round(BLOCK_S / float(np.median(np.diff(self.times_s)))))
        model = stretch  # refitted only now and then: it predicts well for a while
        while True:
            if way > 0:
                first, stop = stretch.stop, min(stretch.stop + block, self.times_s.size)
            else:
                first, stop = max(stretch.first - block, 0), stretch.first
            if stop - first < 3:
                return replace(model, first=stretch.first, stop=stretch.stop)
            longer = replace(stretch, first=min(first, stretch.first), stop=max(stop, stretch.stop))
            allowed = max(noise, model.rms_m_s2)
            error = self._error(model, first, stop)
            surprised = _rms(error) > _SURPRISE * allowed
            if surprised or longer.stop - longer.first > _REFIT_GROWTH * (model.stop - model.first):
                model = self.explain(longer.first, longer.stop, model)
                if surprised and _rms(self._error(model, first, stop)) > _EXPLAINED * allowed:
                    model = self.explain(stretch.first, stretch.stop, model)
                    return _to_the_sample(model, error, _SURPRISE * allowed, way)
            stretch = longer

    def _error(self, model: Stretch, first: int, stop: int) -> Array:
        block = slice(first, stop)
        return np.asarray(self.motion[block] - explained(model, self.times_s[block]), dtype=np.float64)


def _linear(tau: Array, y: Array, omega: float, decay: float) -> Array:
    """Amplitudes and line (4,) for a given pole: where the full fit starts."""
    fade = np.exp(-decay * tau)
    wave = (fade * np.cos(omega * tau), fade * np.sin(omega * tau), np.ones_like(tau), tau)
    columns = np.column_stack(wave)
    ridge = np.diag((0.0, 0.0, 0.1, 0.1))
    return np.asarray(np.linalg.solve(columns.T @ columns + ridge, columns.T @ y), dtype=np.float64)


def _to_the_sample(stretch: Stretch, error: Array, allowed: float, way: int) -> Stretch:
    """Within a surprising block, the samples next to the stretch may still belong to it."""
    strange = np.abs(error if way > 0 else error[::-1]) > allowed
    still = int(np.argmax(strange)) if np.any(strange) else 0
    if way > 0:
        return replace(stretch, stop=stretch.stop + still)
    return replace(stretch, first=stretch.first - still)


def _rms(error: Array) -> float:
    return float(np.sqrt(np.mean(error**2)))
