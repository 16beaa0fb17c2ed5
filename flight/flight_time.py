"""Time of flight from the accelerometer: take-off and touchdown with their uncertainty, and a verdict.

Free fall alone shows nothing on this robot: its spring rings at about 22 Hz through the whole flight, and the body
feels the ground through that spring only. So each end of the flight is fitted by a model of what the sensor must
read there (`flight.edge_fit`): the ringing on one side, the foot on the ground on the other.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flight.ballistics import FreeFall, Level, flight_level
from flight.doubts import doubts
from flight.edge_fit import Edge, mixed
from flight.edge_model import TAKE_OFF, TOUCHDOWN, E
from flight.edge_search import EndOfFlight, Scene, best_edge, look_at_end
from flight.flight_search import Expectation, NoFlight, Stretch, find_flight
from flight.flown import FlightFit as FlightFit
from flight.flown import FlightTime as FlightTime
from flight.graze import Graze, graze, undecided
from flight.heartbeat import Heartbeat, Stalled
from flight.quality import afterwards, gap_at, has_gap, longest_gap_s
from flight.record import HopRecord
from flight.ringing import TwoMass
from flight.settings import FlightSettings
from flight.spring_check import LegShare, leg_share_seen

Array = NDArray[np.float64]

_REST_S = 0.5  # before the fire command, over which the sensor's rest is averaged
_MOST_NOISE = 10.0  # over the data sheet's, of a robot that stands still
_FRICTION_IN_LEVEL = 0.1
_EXPLAINED_CHI = 1.5  # misfit in contact that needs no other ground
_UNLIKE_CHI = 4.0  # misfit in contact of a ground that is not looked at further, if another explains more
_GROUNDS_TEMPER = 10.0  # by which the costs of soft and hard ground count less
_BOUNCING = 4.0  # as much more is left to the model where the foot bounces between two samples
_REJECTED_CHI = 60.0
_REJECTED_BIAS = 0.1  # share of gravity by which the flight may read other than the weight taken away
_REJECTED_SIGMA_S = 5e-3
_REACH = 1.96  # of a 95 % interval, in sigmas


def estimate_flight(
    record: HopRecord, settings: FlightSettings, heartbeat: Heartbeat | None = None
) -> FlightTime:
    """Take-off, touchdown and time of flight of one hop. Never raises for what the record holds."""
    estimate = _Estimate(record, settings, heartbeat or Heartbeat())
    try:
        return estimate.result()
    except (NoFlight, Stalled) as error:
        return FlightTime("rejected", (str(error), *estimate.reasons, *estimate.doubts))


class _Estimate:
    """The work on one record. Accelerations are per `sensor_gain`: those of the body along the leg."""

    def __init__(self, record: HopRecord, settings: FlightSettings, heartbeat: Heartbeat) -> None:
        self.record, self.settings, self.heartbeat = record, settings, heartbeat
        self.expected = Expectation.of(settings)
        self.gravity = settings.rig.gravity_m_s2
        self.gain = settings.rig.sensor_gain
        self.times = record.times_s - record.fire_s
        self.reasons: list[str] = []
        self.doubts: list[str] = []  # which count only where no flight was found

    def _check_record(self) -> None:
        """Raises `NoFlight` for what cannot be evaluated, and notes what makes it doubtful."""
        record = self.record
        if self.times.size < 50:
            raise NoFlight(f"only {self.times.size} accelerometer samples")
        if not (np.all(np.isfinite(record.specific_force_m_s2)) and np.all(np.isfinite(self.times))):
            raise NoFlight("accelerometer samples that are no numbers")
        if np.any(np.diff(self.times) <= 0.0):
            raise NoFlight("accelerometer times do not increase")
        after = np.diff(self.times[self.times > -0.02])
        if np.any(after > longest_gap_s(self.times)):
            self.doubts.append("a gap in the accelerometer's samples")
        if not record.complete:
            self.reasons.append("a sensor lost samples during the hop")

    def _static(self) -> tuple[float, float, float]:
        """Mean reading of the robot at rest before the fire command, its sigma, and the noise of a sample."""
        rest = self.record.specific_force_m_s2[(self.times > -_REST_S) & (self.times < 0.0)]
        if rest.size < 20:
            raise NoFlight("too few accelerometer samples at rest before the fire command")
        spread = float(np.std(rest, ddof=1))
        if spread > _MOST_NOISE * self.settings.sensors.accelerometer_noise_m_s2:
            self.reasons.append("the robot did not stand still before the fire command")
        spread = max(spread, self.settings.sensors.accelerometer_step_m_s2 / math.sqrt(12.0))
        return float(np.mean(rest)), spread / math.sqrt(rest.size), spread / self.gain

    def result(self) -> FlightTime:
        self._check_record()
        self.static, self.static_sigma, self.noise = self._static()
        # In flight a sensor without bias would read the ringing about static/gain - g.
        self.motion = self.record.specific_force_m_s2 / self.gain - (self.static / self.gain - self.gravity)
        stretch = find_flight(self.times, self.motion, self.expected, self.noise)
        self._check_saturation(stretch)
        scene = self._scene(stretch)
        share_std = 2.0 * self.expected.omega_std
        take_off = look_at_end(scene, stretch, TAKE_OFF, share_std)
        touchdown = look_at_end(scene, stretch, TOUCHDOWN, share_std)
        seen = leg_share_seen(self.record, take_off, self.settings, self.expected)
        robot = replace(self.expected.robot, leg_share=seen.share)
        level = self._level(stretch, take_off)
        # Dry friction turns round with the spring: what is left of it in the mean looks like a level.
        rubbing = _FRICTION_IN_LEVEL * max(abs(end.local.friction_m_s2) for end in (take_off, touchdown))
        level = replace(level, sigma_m_s2=math.hypot(level.sigma_m_s2, rubbing))
        return self._fitted(scene, take_off, touchdown, robot, seen, level)

    def _scene(self, stretch: Stretch) -> Scene:
        """What is fitted: samples at the end of the sensor's range tell nothing but that."""
        usable = ~self.record.saturated
        rig = self.settings.rig
        before = self.record.compression_m[self.record.spring_times_s < self.record.fire_s]
        held_m = float(np.median(before)) if before.size else 0.0
        load_n = (
            rig.spring_stiffness_n_m * max(held_m, 0.0) + (rig.body_mass_kg + rig.leg_mass_kg) * self.gravity
        )
        return Scene(
            self.times[usable],
            self.motion[usable],
            self.noise,
            self.expected,
            self.settings.evaluation.ground,
            load_n,
            self.heartbeat,
        )

    def _check_saturation(self, stretch: Stretch) -> None:
        flying = (self.times > stretch.first_s) & (self.times < stretch.last_s)
        if np.any(self.record.saturated & flying):
            raise NoFlight("the accelerometer was saturated in flight")

    def _level(self, stretch: Stretch, end: EndOfFlight) -> Level:
        """The flight's level; on an arm, the sensor reads the turning weight in it."""
        level = flight_level(self.times, self.motion, stretch, end.local.ringing.pole, self.noise)
        rig = self.settings.rig
        if rig.geometry != "arm" or rig.arm is None:
            return level
        flight_s = stretch.last_s - stretch.first_s
        arc_m = self.gravity * flight_s**2 / 8.0
        mean_square = 8.0 / 15.0 * (arc_m / rig.arm.com_radius_m) ** 2  # of a parabola of that height
        turned = 0.5 * mean_square * (self.gravity - rig.arm.local_gravity_m_s2 / self.gain)
        return replace(level, value_m_s2=level.value_m_s2 - turned)

    def _fitted(
        self,
        scene: Scene,
        take_off: EndOfFlight,
        touchdown: EndOfFlight,
        robot: TwoMass,
        share: LegShare,
        level: Level,
    ) -> FlightTime:
        rig = self.settings.rig
        radius = rig.arm.com_radius_m if rig.geometry == "arm" and rig.arm else math.inf
        weight = 1.0 / (1.0 + (level.sigma_m_s2 / (rig.gravity_std_share * self.gravity)) ** 2)
        gravity = self.gravity - weight * level.value_m_s2
        robot = replace(robot, gravity_m_s2=gravity)
        scene = replace(scene, expected=replace(self.expected, robot=robot))
        fall = FreeFall(gravity, level.slope_m_s3, level.middle_s, radius)
        begin, end = take_off.strange_s, touchdown.strange_s
        hung = [
            side.local.ringing.compression(at, robot)[0] for side, at in ((take_off, begin), (touchdown, end))
        ]
        rise = (1.0 - robot.leg_share) * (hung[0] - hung[1])
        speed = fall.take_off_speed_m_s(begin, end - begin, rise)
        edges, hard = self._edges(scene, take_off, touchdown, speed, begin)
        fit = FlightFit(edges[0], edges[1], robot, share, fall, level, self.motion, self.gravity, self.noise)
        return self._judge(fit, hard)

    def _edges(
        self, scene: Scene, take_off: EndOfFlight, touchdown: EndOfFlight, speed: float, at_s: float
    ) -> tuple[tuple[Edge, Edge], bool]:
        """Both ends on the ground, soft or hard, that explains them best.

        Where the other ground explains them nearly as well, the variances are those of both.
        """
        found: list[tuple[float, Edge, Edge, bool]] = []
        best_chi, enough = math.inf, math.inf
        for hard in (False, True):
            left = best_edge(scene, take_off, hard, speed, at_s, enough=enough)
            if left is None or left.misfits()[1] > max(_UNLIKE_CHI, 3.0 * best_chi):
                continue
            best_chi, enough = min(best_chi, left.misfits()[1]), left.cost_per_sample
            back = best_edge(scene, touchdown, hard, speed, at_s, left)
            if back is None:
                continue
            # The hard ground's fits leave out what the foot did before its last touch.
            cost = left.cost_per_sample + back.cost_per_sample
            found.append((cost * 0.5 * (left.residuals.size + back.residuals.size), left, back, hard))
            if max(left.misfits()[1], back.misfits()[1]) < _EXPLAINED_CHI and left.is_soil and back.is_soil:
                break
        if not found:
            raise NoFlight("no contact model explains the ends of the flight")
        found.sort(key=lambda entry: entry[0])
        costs = [entry[0] for entry in found]
        left = mixed([entry[1] for entry in found], costs, _GROUNDS_TEMPER)
        back = mixed([entry[2] for entry in found], costs, _GROUNDS_TEMPER)
        return (left, back), found[0][3]

    def _judge(self, fit: FlightFit, hard: bool) -> FlightTime:
        edges = (fit.take_off, fit.touchdown)
        if fit.touchdown.time_s - fit.take_off.time_s <= 0.0:
            raise NoFlight("the ends of the flight do not stand in order")
        chi = max(edge.misfits()[0] for edge in edges)
        evaluation = self.settings.evaluation
        floors = (evaluation.take_off_error_s, evaluation.touchdown_error_s)
        sigmas = []
        unseen_s = evaluation.sampling_error_1_s * float(np.median(np.diff(self.times))) ** 2
        for edge, floor_s in zip(edges, floors, strict=True):
            growth = max(1.0, *edge.misfits())  # a misfit says that the model misses something
            rubbing_s = evaluation.friction_error_s3_m * abs(float(edge.parameters[E.FRICTION]))
            sigmas.append(
                math.hypot(growth * math.sqrt(edge.covariance[E.TIME, E.TIME]), floor_s, unseen_s, rubbing_s)
            )
        left_s, leaving_sigma_s = fit.take_off.time_s, sigmas[0]
        if not fit.take_off.is_soil:
            sigmas[0] = math.hypot(sigmas[0], _BOUNCING * unseen_s)
            leaving_sigma_s = sigmas[0]
        again = graze(fit.take_off)
        if again is not None:
            left_s += again.after_s if again.odds > 0.5 else 0.0
            sigmas[0] = math.hypot(sigmas[0], again.after_s * math.sqrt(min(again.odds, 1.0 - again.odds)))
        sigmas[1] = math.hypot(sigmas[1], self.record.rate_sigma * (edges[1].time_s - edges[0].time_s))
        ends = [edge.ringing.compression(edge.time_s, fit.robot) for edge in edges]
        offset = fit.level.value_m_s2 * self.gain + self.static - self.gravity * self.gain
        verdict = self._verdict(
            fit, hard, chi, math.hypot(*sigmas), math.hypot(leaving_sigma_s, sigmas[1]), again
        )
        return FlightTime(
            verdict=verdict,
            reasons=tuple(self.reasons),
            take_off_s=left_s + self.record.fire_s,
            touchdown_s=fit.touchdown.time_s + self.record.fire_s,
            take_off_sigma_s=sigmas[0],
            touchdown_sigma_s=sigmas[1],
            static_m_s2=self.static,
            static_sigma_m_s2=self.static_sigma,
            offset_m_s2=offset,
            offset_sigma_m_s2=fit.level.sigma_m_s2 * self.gain,
            compression_m=(ends[0][0], ends[1][0]),
            compression_rate_m_s=(ends[0][1], ends[1][1]),
            chi=chi,
            contact="hard" if hard else "soft",
            leaving_sigma_s=leaving_sigma_s,
            fit=fit,
        )

    def _verdict(
        self,
        fit: FlightFit,
        hard: bool,
        chi: float,
        sigma_s: float,
        left_sigma_s: float,
        again: Graze | None,
    ) -> str:
        """`sigma_s`: of the time of flight; `left_sigma_s`: of it, had the foot kept clear once it left.

        `again`: that it may not have.
        """
        twice = undecided(again, _REACH * _REJECTED_SIGMA_S)
        off = abs(fit.level.value_m_s2) > _REJECTED_BIAS * self.gravity + 5.0 * fit.level.sigma_m_s2
        if off:
            bias = fit.level.value_m_s2
            self.reasons.append(f"what rings is not in free fall (off by {bias:.2f} m/s^2)")
        if chi > _REJECTED_CHI:
            self.reasons.append(f"the flight does not ring like this robot (misfit {chi:.0f} sigma)")
        if left_sigma_s > _REJECTED_SIGMA_S:
            self.reasons.append(f"time of flight known to {left_sigma_s * 1e3:.0f} ms only")
        edges_s = (fit.take_off.time_s, fit.touchdown.time_s)
        gap = gap_at(self.times, dict(zip(("take-off", "touchdown"), edges_s, strict=True)))
        after = afterwards(self.times, self.motion, self.expected, self.noise, edges_s)
        self.reasons += [reason for reason in (gap, after, twice) if reason]
        if off or gap or after or twice or chi > _REJECTED_CHI or left_sigma_s > _REJECTED_SIGMA_S:
            self.reasons += self.doubts
            return "rejected"
        if has_gap(self.times, -0.02, fit.touchdown.time_s):
            self.reasons.append("a gap in the accelerometer's samples")
        self.reasons += doubts(fit, hard, chi, sigma_s, again, self.settings.rig.body_mass_kg)
        return "degraded" if self.reasons else "valid"
