"""Time of flight from the accelerometer: take-off and touchdown with their uncertainty, and a verdict.

Free fall alone shows nothing on this robot: its spring rings at about 22 Hz through the whole flight. So the
ringing is fitted, together with what the ground did to it just before take-off and just after touchdown
(`flight.ringing`); both instants are parameters of that fit, and their covariance comes out of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from flight.contact_fit import ContactFit, P, fit_contact
from flight.flight_search import Expectation, NoFlight, Stretch, explained, find_flight
from flight.heartbeat import Heartbeat, Stalled
from flight.record import HopRecord
from flight.settings import FlightSettings

# Starts of the fit for touchdown, before the first sample that shows it: soft ground shows late.
_TOUCHDOWN_STARTS_S = (-0.0003, 0.0008)
# What the contact models themselves may miss: how ground lets go varies more than how it takes the foot.
_MODEL_ERROR_S = np.array((2.0e-4, 7e-5))
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
        self.record, self.settings, self.heartbeat = record, settings, heartbeat
        self.expected = Expectation.of(settings)
        self.gravity = settings.rig.gravity_m_s2
        self.times = record.times_s - record.fire_s
        self.reasons: list[str] = []
        self._check_record()
        self.static, self.static_sigma = self._static()
        # In flight a sensor without bias would read the ringing about static/gain - g.
        gain = settings.rig.sensor_gain
        self.motion = record.specific_force_m_s2 / gain - (self.static / gain - self.gravity)

    def _check_record(self) -> None:
        if self.times.size < 50:
            raise NoFlight(f"only {self.times.size} accelerometer samples")
        if not np.all(np.isfinite(self.record.specific_force_m_s2)):
            raise NoFlight("accelerometer samples that are no numbers")
        steps = np.diff(self.times)
        if np.any(steps <= 0.0):
            raise NoFlight("accelerometer times do not increase")
        if float(np.max(steps)) > 3.0 * float(np.median(steps)):
            raise NoFlight("a gap in the accelerometer's samples")
        if not self.record.complete:
            self.reasons.append("a sensor lost samples during the hop")

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
        stretch = find_flight(self.times, self.motion, self.expected, self.heartbeat)
        self._check_impact(stretch)
        return self._judge(self._best_fit(stretch))

    def _check_impact(self, stretch: Stretch) -> None:
        """After a flight something must hit: the ringing parts from its course for good."""
        after = slice(stretch.stop, stretch.stop + 40)
        unexplained = self.motion[after] - explained(stretch, self.times[after])
        flying = self.times[stretch.stop - 1] - self.times[stretch.first]
        if float(np.max(np.abs(unexplained))) < self.gravity:
            raise NoFlight("no impact after the flight")
        clipped = self.record.saturated[stretch.first : stretch.stop]
        if np.any(clipped):
            raise NoFlight("the accelerometer was saturated in flight")
        if flying < 0.03:
            raise NoFlight(f"too short a flight ({flying:.3f} s of free ringing)")

    def _best_fit(self, stretch: Stretch) -> ContactFit:
        """The contact model, and the start of its fit, that explain the record best."""
        candidates: list[ContactFit] = []
        ground = self.settings.evaluation.ground
        for hard in (False, True):
            for earlier_s in _TOUCHDOWN_STARTS_S:
                try:
                    candidate = fit_contact(
                        self.times,
                        self.motion,
                        stretch,
                        self.expected,
                        ground,
                        self.heartbeat,
                        hard=hard,
                        earlier_s=earlier_s,
                    )
                except ValueError:  # this start leads nowhere; another may
                    continue
                candidates.append(candidate)
        if not candidates:
            raise NoFlight("no contact model explains the ends of the flight")
        return min(candidates, key=lambda candidate: candidate.fit.cost)

    def _judge(self, best: ContactFit) -> FlightTime:
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
        ringing = best.ringing
        ends = [ringing.compression(time, self.expected.robot) for time in (take_off, touchdown)]
        gain = self.settings.rig.sensor_gain
        offset = float(best.fit.parameters[P.OFFSET]) + self.static / gain - self.gravity
        verdict = self._verdict(chi, sigma, offset - self.static / gain + self.gravity, best)
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
            offset_sigma_m_s2=math.sqrt(best.fit.covariance[P.OFFSET, P.OFFSET]) * max(1.0, misfit) * gain,
            compression_m=(ends[0][0], ends[1][0]),
            compression_rate_m_s=(ends[0][1], ends[1][1]),
            residual_rms_m_s2=float(np.sqrt(np.mean(best.fit.residuals**2))) * self.expected.noise_m_s2,
            chi=chi,
            contact="hard" if best.problem.hard else "soft",
        )

    def _verdict(self, chi: float, sigma_s: float, bias_m_s2: float, best: ContactFit) -> str:
        off = abs(bias_m_s2) > _REJECTED_BIAS * self.gravity
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
