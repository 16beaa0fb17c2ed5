"""Time of flight from the accelerometer: take-off and touchdown with their uncertainty, and a verdict.

Free fall alone shows nothing on this robot: its spring rings at about 22 Hz through the whole flight. So the
ringing is fitted, together with what the ground did to it just before take-off and just after touchdown
(`flight.ringing`); both instants are parameters of that fit, and their covariance comes out of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flight import ringing as model
from flight.flight_search import NoFlight, Stretch, find_flight
from flight.heartbeat import Heartbeat, Stalled
from flight.least_squares import Fit, fit
from flight.record import HopRecord
from flight.ringing import Ringing, TwoMass
from flight.settings import FlightSettings

Array = NDArray[np.float64]

# Starts of the fit for touchdown, before the first sample that shows it: soft ground shows late.
_TOUCHDOWN_STARTS_S = (-0.0003, 0.0008)
_BEFORE_S = 0.005  # stretch before take-off that is modelled
_AFTER_S = 0.0018  # stretch after touchdown that is modelled: less than it takes to sink past an old crater
_STIFFEST = 14.0  # log of stiffness over leg mass [1/s^2]: the series' limit; stiffer ground is hard
_END_STD_S = 4e-3  # how far the search may have missed take-off and touchdown
_MODEL_ERROR_S = 7e-5  # what the contact models themselves may miss in each instant
_DEGRADED_CHI = 3.0
_REJECTED_CHI = 60.0
_REJECTED_BIAS = 0.1  # share of gravity by which the flight may read other than the weight taken away
_DEGRADED_SIGMA_S = 2e-3
_REJECTED_SIGMA_S = 2e-2


@dataclass(frozen=True)
class FlightTime:
    """A flight as seen by the accelerometer. Times on the record's clock; covariance of the two instants.

    Take-off is where the mean contact force vanishes, from where the centre of mass is ballistic. On hard
    ground the foot chatters, and may leave it for the last time a little earlier: the sigmas of take-off and
    time of flight allow for that, `ballistic_sigma_s`, which counts for the height, does not.
    Rates and compressions of the spring at both ends come from the fitted ringing. `verdict` is `valid`,
    `degraded` (usable, with the reasons) or `rejected`.
    """

    verdict: str
    reasons: tuple[str, ...]
    take_off_s: float = math.nan
    touchdown_s: float = math.nan
    take_off_sigma_s: float = math.nan
    touchdown_sigma_s: float = math.nan
    time_of_flight_sigma_s: float = math.nan
    ballistic_sigma_s: float = math.nan
    static_m_s2: float = math.nan
    static_sigma_m_s2: float = math.nan
    offset_m_s2: float = math.nan
    offset_sigma_m_s2: float = math.nan
    compression_m: tuple[float, float] = (math.nan, math.nan)
    compression_rate_m_s: tuple[float, float] = (math.nan, math.nan)
    residual_rms_m_s2: float = math.nan
    chi: float = math.nan
    contact: str = ""

    @property
    def time_of_flight_s(self) -> float:
        return self.touchdown_s - self.take_off_s


def estimate_flight(
    record: HopRecord, settings: FlightSettings, heartbeat: Heartbeat | None = None
) -> FlightTime:
    """Take-off, touchdown and time of flight of one hop. Never raises for what the record holds."""
    try:
        return _Estimate(record, settings, heartbeat or Heartbeat()).result()
    except (NoFlight, Stalled) as error:
        return FlightTime("rejected", (str(error),))


class _Estimate:
    """The work on one record. Accelerations are per `sensor_gain`: those of the body along the leg."""

    def __init__(self, record: HopRecord, settings: FlightSettings, heartbeat: Heartbeat) -> None:
        rig = settings.rig
        self.record, self.settings, self.heartbeat = record, settings, heartbeat
        total_kg = rig.body_mass_kg + rig.leg_mass_kg
        self.robot = TwoMass(rig.leg_mass_kg / total_kg, rig.body_mass_kg / rig.leg_mass_kg, rig.gravity_m_s2)
        self.noise = settings.sensors.accelerometer_noise_m_s2 / rig.sensor_gain
        stiffness = rig.spring_stiffness_n_m / (rig.body_mass_kg * self.robot.leg_share)
        self.decay_1_s = rig.spring_damping_n_s_m / rig.spring_stiffness_n_m * stiffness / 2.0
        self.omega = math.sqrt(stiffness - self.decay_1_s**2)
        self.omega_std = 0.5 * self.omega * math.hypot(rig.spring_stiffness_std_share, rig.mass_std_share)
        self.times = record.times_s - record.fire_s
        self.reasons: list[str] = []
        self._check_record()
        self.static, self.static_sigma = self._static()
        # In flight a sensor without bias would read the ringing about static/gain - g.
        self.motion = record.specific_force_m_s2 / rig.sensor_gain
        self.motion = self.motion - (self.static / rig.sensor_gain - rig.gravity_m_s2)

    def _check_record(self) -> None:
        if self.times.size < 50:
            raise NoFlight(f"only {self.times.size} accelerometer samples")
        if not np.all(np.isfinite(self.record.specific_force_m_s2)):
            raise NoFlight("accelerometer samples that are no numbers")
        if np.any(np.diff(self.times) <= 0.0):
            raise NoFlight("accelerometer times do not increase")
        if not self.record.complete:
            self.reasons.append("a sensor lost samples during the hop")
        steps = np.diff(self.times)
        if float(np.max(steps)) > 3.0 * float(np.median(steps)):
            raise NoFlight("a gap in the accelerometer's samples")

    def _static(self) -> tuple[float, float]:
        """Mean reading of the robot at rest before the fire command, and its sigma."""
        rest = self.record.specific_force_m_s2[(self.times > -0.5) & (self.times < 0.0)]
        if rest.size < 20:
            raise NoFlight("too few accelerometer samples at rest before the fire command")
        noise = self.settings.sensors.accelerometer_noise_m_s2
        spread = float(np.std(rest, ddof=1))
        if spread > 5.0 * noise:
            self.reasons.append("the robot did not stand still before the fire command")
        return float(np.mean(rest)), max(spread, noise) / math.sqrt(rest.size)

    def result(self) -> FlightTime:
        weightless = -self.settings.rig.gravity_m_s2 / self.robot.body_per_leg
        stretch = find_flight(
            self.times,
            self.motion,
            0.0,
            weightless,
            self.noise,
            self.omega,
            self.omega_std,
            self.decay_1_s,
            self.heartbeat,
        )
        self._check_impact(stretch)
        return self._judge(self._best_fit(stretch))

    def _check_impact(self, stretch: Stretch) -> None:
        """After a flight something must hit: the ringing parts from its course for good."""
        after = slice(stretch.stop, min(stretch.stop + 40, self.times.size))
        flying = self.times[stretch.stop - 1] - self.times[stretch.first]
        if float(np.max(np.abs(self.motion[after]), initial=0.0)) < self.settings.rig.gravity_m_s2:
            raise NoFlight("no impact after the flight")
        clipped = self.record.saturated[stretch.first : stretch.stop]
        if np.any(clipped):
            raise NoFlight("the accelerometer was saturated in flight")
        if flying < 0.03:
            raise NoFlight(f"too short a flight ({flying:.3f} s of free ringing)")

    def _best_fit(self, stretch: Stretch) -> _Candidate:
        """The contact model, and the start of its fit, that explain the record best."""
        candidates: list[_Candidate] = []
        for hard in (False, True):
            for earlier_s in _TOUCHDOWN_STARTS_S:
                try:
                    candidates.append(self._fit(stretch, hard, earlier_s))
                except ValueError:  # this start leads nowhere; another may
                    continue
        if not candidates:
            raise NoFlight("no contact model explains the ends of the flight")
        return min(candidates, key=lambda candidate: candidate.fit.cost)

    def _fit(self, stretch: Stretch, hard: bool, earlier_s: float) -> _Candidate:
        problem = _Problem(self, stretch, hard, earlier_s)
        return _Candidate(
            problem,
            fit(problem.residuals, problem.start, problem.prior_mean, problem.prior_std, self.heartbeat),
        )

    def _judge(self, best: _Candidate) -> FlightTime:
        take_off, touchdown = (float(value) for value in best.fit.parameters[:2])
        before, flying, after = best.misfits()
        chi = flying
        # A misfit says that the model misses something: the errors of what it should tell grow with it.
        misfit = flying * math.sqrt(best.samples_per_error())
        growth = np.array([max(1.0, misfit, before), max(1.0, misfit, after)])
        covariance = best.fit.covariance[:2, :2] * np.outer(growth, growth)
        variances = np.diag(covariance) + _MODEL_ERROR_S**2
        sigma = math.sqrt(float(variances.sum() - 2.0 * covariance[0, 1]))
        chatter_s = self.settings.evaluation.chatter_s if best.problem.hard else 0.0
        ringing = best.problem.ringing(best.fit.parameters)
        ends = [ringing.compression(time, self.robot) for time in (take_off, touchdown)]
        gain = self.settings.rig.sensor_gain
        offset = float(best.fit.parameters[6]) + self.static / gain - self.settings.rig.gravity_m_s2
        verdict = self._verdict(chi, sigma, offset - self.static / gain + self.robot.gravity_m_s2, best)
        return FlightTime(
            verdict=verdict,
            reasons=tuple(self.reasons),
            take_off_s=take_off + self.record.fire_s,
            touchdown_s=touchdown + self.record.fire_s,
            take_off_sigma_s=math.hypot(math.sqrt(variances[0]), chatter_s),
            touchdown_sigma_s=math.sqrt(variances[1]),
            time_of_flight_sigma_s=math.hypot(sigma, chatter_s),
            ballistic_sigma_s=sigma,
            static_m_s2=self.static,
            static_sigma_m_s2=self.static_sigma,
            offset_m_s2=offset * gain,
            offset_sigma_m_s2=math.sqrt(best.fit.covariance[6, 6]) * max(1.0, misfit) * gain,
            compression_m=(ends[0][0], ends[1][0]),
            compression_rate_m_s=(ends[0][1], ends[1][1]),
            residual_rms_m_s2=float(np.sqrt(np.mean(best.fit.residuals**2))) * self.noise,
            chi=chi,
            contact="hard" if best.problem.hard else "soft",
        )

    def _verdict(self, chi: float, sigma_s: float, bias_m_s2: float, best: _Candidate) -> str:
        off = abs(bias_m_s2) > _REJECTED_BIAS * self.robot.gravity_m_s2
        if off:
            self.reasons.append(f"what rings is not in free fall (off by {bias_m_s2:.2f} m/s^2)")
        if chi > _REJECTED_CHI:
            self.reasons.append(f"the flight does not ring like this robot (misfit {chi:.0f} sigma)")
        if sigma_s > _REJECTED_SIGMA_S:
            self.reasons.append(f"time of flight known to {sigma_s * 1e3:.0f} ms only")
        if off or chi > _REJECTED_CHI or sigma_s > _REJECTED_SIGMA_S:
            return "rejected"
        if chi > _DEGRADED_CHI:
            self.reasons.append(f"the ringing is explained to {chi:.1f} sigma only")
        if sigma_s > _DEGRADED_SIGMA_S:
            self.reasons.append(f"time of flight known to {sigma_s * 1e3:.1f} ms only")
        if not best.fit.converged:
            self.reasons.append("the fit of the flight did not converge")
        return "degraded" if self.reasons else "valid"


@dataclass(frozen=True)
class _Candidate:
    problem: _Problem
    fit: Fit

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


class _Problem:
    """Residuals of one contact model.

    Parameters: take-off, touchdown, omega, decay, cosine, sine, offset, slope, log of the take-off ramp, its
    bend, then of the ground: soft: log stiffness, damping; hard: log contact frequency, rebound share.
    """

    def __init__(self, estimate: _Estimate, stretch: Stretch, hard: bool, earlier_s: float) -> None:
        self.estimate, self.hard = estimate, hard
        times = estimate.times
        ring = stretch.ringing
        self.reference_s = ring.reference_s
        left, landed = float(times[stretch.first]), float(times[stretch.stop - 1]) - earlier_s
        rig = estimate.settings.rig
        ground = (math.log(4835.0), 1.0) if hard else (math.log(2e5), 0.0)
        self.start = np.array(
            (
                left,
                landed,
                ring.omega_rad_s,
                ring.decay_1_s,
                ring.cosine_m_s2,
                ring.sine_m_s2,
                stretch.offset_m_s2,
                stretch.slope_m_s3,
                math.log(3e4),
                0.0,
                *ground,
            )
        )
        free = math.inf
        decay_std = rig.spring_damping_std_share * estimate.decay_1_s * 2.0
        ground_std = (0.7, 0.3) if hard else (1.2, 12.0)
        self.prior_mean = self.start.copy()
        self.prior_mean[2:4] = estimate.omega, estimate.decay_1_s
        self.prior_std = np.array(
            (
                _END_STD_S,
                _END_STD_S,
                2.0 * estimate.omega_std,
                decay_std,
                free,
                free,
                free,
                free,
                1.2,
                0.7,
                *ground_std,
            )
        )
        # The samples are chosen once, so that fits with different contacts are fits to the same data.
        first, last = float(times[stretch.first]), float(times[stretch.stop - 1])
        chosen = (times > first - _BEFORE_S) & (times < last + _AFTER_S)
        self.times, self.motion = times[chosen], estimate.motion[chosen]

    def ringing(self, p: Array) -> Ringing:
        return Ringing(self.reference_s, float(p[2]), float(p[3]), float(p[4]), float(p[5]))

    def residuals(self, p: Array) -> Array:
        """(m,) in sigmas of the accelerometer's noise."""
        ringing, robot, t = self.ringing(p), self.estimate.robot, self.times
        predicted = ringing.acceleration_m_s2(t) + p[6] + p[7] * (t - self.reference_s)
        before, after = p[0] - t > 0.0, t - p[1] > 0.0
        ramp = math.exp(p[8])
        predicted[before] += model.before_take_off(
            p[0] - t[before], ramp, ramp * p[9] / _BEFORE_S, ringing, robot
        )
        predicted[after] += self._contact(p, ringing)(t[after] - p[1])
        return np.asarray((self.motion - predicted) / self.estimate.noise, dtype=np.float64)

    def _contact(self, p: Array, ringing: Ringing) -> Callable[[Array], Array]:
        robot = self.estimate.robot
        rate = ringing.compression(float(p[1]), robot)[1]
        # The foot comes down with the centre of mass, and the spring's ringing on top of it.
        falling = 0.5 * robot.gravity_m_s2 * float(p[1] - p[0])
        impact = falling - (1.0 - robot.leg_share) * rate
        if self.hard:
            return lambda tau: (
                p[11] * model.after_hard_touchdown(tau, impact, math.exp(p[10]), ringing, robot)
            )
        return lambda tau: model.after_soft_touchdown(
            tau, float(p[1]), impact, math.exp(min(p[10], _STIFFEST)), float(p[11]), ringing, robot
        )


__all__ = ["FlightTime", "estimate_flight"]
