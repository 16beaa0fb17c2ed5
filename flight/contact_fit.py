"""One flight and its two ends as a least-squares problem: free ringing, the ground letting go, touching it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from flight import ringing as model
from flight.flight_search import Expectation, Stretch
from flight.heartbeat import Heartbeat
from flight.least_squares import Fit, fit
from flight.ringing import Ringing
from flight.settings import GroundSettings

Array = NDArray[np.float64]

_BEFORE_S = 0.005  # stretch before take-off that is modelled
_AFTER_S = 0.0018  # stretch after touchdown that is modelled: less than it takes to sink past an old crater
_STIFFEST = 14.0  # log of stiffness over leg mass [1/s^2]: the series' limit; stiffer ground is hard
_END_STD_S = 4e-3  # how far the search may have missed take-off and touchdown
_BEND_STD = 0.7  # change of the contact force's rate over the stretch before take-off, as a share of it
_REBOUND_STD = 0.3  # by how much a foot on hard ground may bounce otherwise than fully


class P(IntEnum):
    """Where the parameters stand."""

    TAKE_OFF, TOUCHDOWN, OMEGA, DECAY, COSINE, SINE, OFFSET, SLOPE, RAMP, BEND, GROUND, GROUND_2 = range(12)


def fit_contact(
    times_s: Array,
    motion_m_s2: Array,
    stretch: Stretch,
    expected: Expectation,
    ground: GroundSettings,
    heartbeat: Heartbeat,
    *,
    hard: bool,
    earlier_s: float,
) -> ContactFit:
    """Fit one contact model. `earlier_s`: by how much touchdown may precede the first sample that shows it.

    Raises `ValueError` where the fit leads nowhere.
    """
    problem = ContactProblem(times_s, motion_m_s2, stretch, expected, ground, hard, earlier_s)
    return ContactFit(
        problem, fit(problem.residuals, problem.start, problem.prior_mean, problem.prior_std, heartbeat)
    )


@dataclass(frozen=True)
class ContactFit:
    """A contact model fitted to a flight."""

    problem: ContactProblem
    fit: Fit

    @property
    def ringing(self) -> Ringing:
        return self.problem.ringing(self.fit.parameters)

    def misfits(self) -> tuple[float, float, float]:
        """Root mean square residual in sigmas before take-off, in flight and after touchdown."""
        times, (take_off, touchdown) = self.problem.times, self.fit.parameters[:2]
        parts = (times < take_off, (times >= take_off) & (times <= touchdown), times > touchdown)
        squares = [self.fit.residuals[part] ** 2 for part in parts]
        before, flying, after = (math.sqrt(float(np.mean(s))) if s.size else 0.0 for s in squares)
        return before, flying, after

    def samples_per_error(self) -> float:
        """Integrated autocorrelation of the residuals in flight: 1 for white noise, more for a misfit."""
        times, (take_off, touchdown) = self.problem.times, self.fit.parameters[:2]
        left = self.fit.residuals[(times >= take_off) & (times <= touchdown)]
        left = left - np.mean(left) if left.size else left
        power = float(left @ left)
        total = 1.0
        for lag in range(1, left.size // 3):
            correlation = float(left[lag:] @ left[:-lag]) / power
            if correlation < 2.0 / math.sqrt(left.size):
                break
            total += 2.0 * correlation
        return total


class ContactProblem:
    """Residuals of one contact model; parameters in the order of `P`.

    RAMP is the log of the take-off ramp over leg mass, BEND its relative change. The ground: soft: log of
    stiffness over leg mass, damping over leg mass; hard: log of contact frequency, share of the rebound.
    """

    def __init__(
        self,
        times_s: Array,
        motion_m_s2: Array,
        stretch: Stretch,
        expected: Expectation,
        ground: GroundSettings,
        hard: bool,
        earlier_s: float,
    ) -> None:
        self.expected, self.hard = expected, hard
        self.reference_s = stretch.ringing.reference_s
        first, last = float(times_s[stretch.first]), float(times_s[stretch.stop - 1])
        # The samples are the same for all contact models, so that their fits can be compared.
        chosen = (times_s > first - _BEFORE_S) & (times_s < last + _AFTER_S)
        self.times, self.motion = times_s[chosen], motion_m_s2[chosen]
        self.prior_mean, self.prior_std = self._prior(stretch, ground, first, last - earlier_s)
        self.start = self.prior_mean.copy()
        self.start[[P.OMEGA, P.DECAY]] = stretch.ringing.omega_rad_s, stretch.ringing.decay_1_s

    def _prior(
        self, stretch: Stretch, ground: GroundSettings, left_s: float, landed_s: float
    ) -> tuple[Array, Array]:
        expected, ring, free = self.expected, stretch.ringing, math.inf
        leg_kg, log_std = expected.leg_mass_kg, ground.stiffness_log_std
        if self.hard:
            contact = (0.5 * math.log(ground.hard_stiffness_n_m / leg_kg), 0.5 * log_std)
            second = (1.0, _REBOUND_STD)
        else:
            contact = (math.log(ground.soft_stiffness_n_m / leg_kg), log_std)
            second = (0.0, ground.damping_std_n_s_m / leg_kg)
        prior = {
            P.TAKE_OFF: (left_s, _END_STD_S),
            P.TOUCHDOWN: (landed_s, _END_STD_S),
            P.OMEGA: (expected.omega_rad_s, 2.0 * expected.omega_std),
            P.DECAY: (expected.decay_1_s, 2.0 * expected.decay_std),
            P.COSINE: (ring.cosine_m_s2, free),
            P.SINE: (ring.sine_m_s2, free),
            P.OFFSET: (stretch.offset_m_s2, free),
            P.SLOPE: (stretch.slope_m_s3, free),
            P.RAMP: (math.log(ground.release_rate_n_s / leg_kg), log_std),
            P.BEND: (0.0, _BEND_STD),
            P.GROUND: contact,
            P.GROUND_2: second,
        }
        table = np.array([prior[index] for index in P], dtype=np.float64)
        return table[:, 0], table[:, 1]

    def ringing(self, p: Array) -> Ringing:
        return Ringing(self.reference_s, *(float(value) for value in p[P.OMEGA : P.OFFSET]))

    def residuals(self, p: Array) -> Array:
        """(m,) in sigmas of the accelerometer's noise."""
        ringing, robot, t = self.ringing(p), self.expected.robot, self.times
        predicted = ringing.acceleration_m_s2(t) + p[P.OFFSET] + p[P.SLOPE] * (t - self.reference_s)
        before, after = t < p[P.TAKE_OFF], t > p[P.TOUCHDOWN]
        ramp = math.exp(p[P.RAMP])
        predicted[before] += model.before_take_off(
            p[P.TAKE_OFF] - t[before], ramp, ramp * p[P.BEND] / _BEFORE_S, ringing, robot
        )
        predicted[after] += self._contact(p, ringing)(t[after] - p[P.TOUCHDOWN])
        return np.asarray((self.motion - predicted) / self.expected.noise_m_s2, dtype=np.float64)

    def _contact(self, p: Array, ringing: Ringing) -> Callable[[Array], Array]:
        robot, touchdown = self.expected.robot, float(p[P.TOUCHDOWN])
        rate = ringing.compression(touchdown, robot)[1]
        # The foot comes down with the centre of mass, and the spring's ringing on top of it.
        falling = 0.5 * robot.gravity_m_s2 * (touchdown - float(p[P.TAKE_OFF]))
        impact = falling - (1.0 - robot.leg_share) * rate
        if self.hard:
            frequency, rebound = math.exp(p[P.GROUND]), float(p[P.GROUND_2])
            return lambda tau: rebound * model.after_hard_touchdown(tau, impact, frequency, ringing, robot)
        stiffness = math.exp(min(p[P.GROUND], _STIFFEST))
        return lambda tau: model.after_soft_touchdown(
            tau, touchdown, impact, stiffness, float(p[P.GROUND_2]), ringing, robot
        )
