"""Height of a jump from its time of flight and its push, with every error carried through.

The foot leaves the ground and comes back to it at the same height; between, the centre of mass is ballistic:
v T - g T^2/2 = (m_b/M)(delta_1 - delta_2). An error of take-off or touchdown counts by the foot's speed there,
which is why the height is known better than the time of flight alone would tell. The push gives the same
speed once more.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from flight.flight_time import FlightFit, FlightTime
from flight.push import Push
from flight.settings import FlightSettings
from flight.uncertain import Uncertain, combine


@dataclass(frozen=True)
class Jump:
    """Take-off speed and apex of the centre of mass above its start; and how far push and flight are apart."""

    speed_m_s: Uncertain
    height_m: Uncertain
    disagreement_m_s: float
    disagreement_sigmas: float


@dataclass(frozen=True)
class _Inputs:
    """What the height depends on: each has an error of its own."""

    take_off_s: float
    touchdown_s: float
    gravity_m_s2: float
    slope_m_s3: float
    leg_share: float
    held_m: float


def jump_height(
    flight: FlightTime,
    fit: FlightFit,
    push: Push,
    compression_m: Uncertain,
    gravity: Uncertain,
    leg_share: Uncertain,
    settings: FlightSettings,
    hop_index: int,
) -> Jump:
    """Speed and height with their errors by source (GUM: derivatives by differences)."""
    evaluation, sensors = settings.evaluation, settings.sensors
    at = _Inputs(
        fit.take_off.time_s,
        fit.touchdown.time_s,
        gravity.value,
        fit.level.slope_m_s3,
        leg_share.value,
        compression_m.value,
    )
    sources: Mapping[str, Uncertain] = {
        "take_off_s": Uncertain.of(at.take_off_s, flight.leaving_sigma_s, f"take_off#{hop_index}"),
        "touchdown_s": Uncertain.of(at.touchdown_s, flight.touchdown_sigma_s, f"touchdown#{hop_index}"),
        "gravity_m_s2": gravity,
        "slope_m_s3": Uncertain.of(at.slope_m_s3, fit.level.slope_sigma_m_s3, f"flight_slope#{hop_index}"),
        "leg_share": leg_share,
        "held_m": compression_m,
    }
    by_flight = _through(lambda x: _speed(x, fit, at.take_off_s), at, sources)
    body_lag = leg_share.value * flight.compression_rate_m_s[0]
    gained = push.gained_m_s
    sigma = math.hypot(push.first_m_s2 * push.opening_sigma_s, sensors.scale_std_share * gained)
    sigma = math.hypot(sigma, evaluation.push_error_share * gained)
    by_push = Uncertain.of(gained + body_lag, sigma, f"push#{hop_index}")
    apart = by_flight.value - by_push.value
    weight = by_flight.sigma**2 / (by_flight.sigma**2 + sigma**2)
    speed = by_flight * (1.0 - weight) + by_push * weight

    def height(x: _Inputs) -> float:
        by = _speed(x, fit, at.take_off_s)
        return _height(x, by + weight * (by_push.value - by), fit, push, at.take_off_s)

    through_flight = _through(height, at, sources)
    lifted = (
        (height(at) - _height(at, by_flight.value, fit, push, at.take_off_s)) / (weight * -apart)
        if weight * apart
        else 0.0
    )
    total = through_flight + Uncertain.of(0.0, lifted * weight * sigma, f"push#{hop_index}")
    total = total.with_part(f"rise#{hop_index}", evaluation.rise_error_m)
    return Jump(speed, total, apart, apart / math.hypot(by_flight.sigma, sigma))


def _through(
    function: Callable[[_Inputs], float], at: _Inputs, sources: Mapping[str, Uncertain]
) -> Uncertain:
    """A function's value with the errors of its inputs."""
    value = function(at)
    terms = []
    for name, source in sources.items():
        step = 0.1 * source.sigma
        if step > 0.0:
            moved = function(replace(at, **{name: getattr(at, name) + step}))
            terms.append((source, (moved - value) / step))
    return combine(value, *terms)


def _speed(x: _Inputs, fit: FlightFit, at_s: float) -> float:
    """Speed of the centre of mass at a time, from the flight.

    It is asked for at a fixed time, not at take-off: a foot that leaves later leaves at a speed that has become less,
    and nothing else is changed by that.
    """
    robot = replace(fit.robot, leg_share=x.leg_share)
    hung = [
        edge.ringing.compression(at_s, robot)[0]
        for edge, at_s in ((fit.take_off, x.take_off_s), (fit.touchdown, x.touchdown_s))
    ]
    fall = replace(fit.fall, gravity_m_s2=x.gravity_m_s2, slope_m_s3=x.slope_m_s3)
    rise = (1.0 - x.leg_share) * (hung[0] - hung[1])
    speed = fall.take_off_speed_m_s(x.take_off_s, x.touchdown_s - x.take_off_s, rise)
    return speed + x.gravity_m_s2 * (x.take_off_s - at_s)


def _height(x: _Inputs, speed: float, fit: FlightFit, push: Push, at_s: float) -> float:
    """Apex above the start: until `at_s` the body's rise on the spring and the leg's share in it, then the flight."""
    robot = replace(fit.robot, leg_share=x.leg_share)
    ringing = fit.take_off.ringing
    hung, rate = ringing.compression(at_s, robot)
    held = x.held_m + x.gravity_m_s2 / (x.leg_share * ringing.stiffness_1_s2)
    rise = push.rise_m(speed - x.leg_share * rate) + x.leg_share * (hung - held)
    up_s = speed / x.gravity_m_s2
    slowed = x.slope_m_s3 * (up_s**3 / 6.0 + 0.5 * (at_s - fit.fall.middle_s) * up_s**2)
    return rise + 0.5 * speed**2 / x.gravity_m_s2 + slowed
