"""From one hop's record to its energies: E_used, height above the start, E_pot, and what follows."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flight import energy
from flight.energy import RigConstants
from flight.flight_time import FlightTime, estimate_flight
from flight.heartbeat import Heartbeat
from flight.record import HopRecord
from flight.settings import FlightSettings
from flight.uncertain import Uncertain, combine

Array = NDArray[np.float64]

_STATIC_S = 0.2  # stretch before the fire command over which the compression is averaged
_PUSH_TOLERANCE = 0.03  # of the body's take-off speed
_STEP_SIGMAS = 10.0  # acceleration, in noise sigmas, by which the opening shows


@dataclass(frozen=True)
class HopEnergies:
    """Energies [J] and heights [m] of one hop; `None` where the flight could not be seen.

    `height_m` is the apex of the centre of mass above its height before the release.
    """

    flight: FlightTime
    compression_m: Uncertain | None = None
    used_j: Uncertain | None = None
    analysis_j: Uncertain | None = None
    time_of_flight_s: Uncertain | None = None
    take_off_speed_m_s: Uncertain | None = None
    height_m: Uncertain | None = None
    potential_j: Uncertain | None = None
    gravity_m_s2: Uncertain | None = None


def evaluate_hop(
    record: HopRecord, settings: FlightSettings, hop_index: int, heartbeat: Heartbeat | None = None
) -> HopEnergies:
    """All energies of one hop. Errors of this hop alone have `#hop_index` in their source's name."""
    flight = estimate_flight(record, settings, heartbeat)
    rig = RigConstants.of(settings.rig)
    compression_m = stored_compression(record, settings, hop_index)
    if compression_m is None:
        reasons = (*flight.reasons, "no spring readings before the fire command")
        return HopEnergies(replace(flight, verdict="rejected", reasons=reasons))
    used_j = energy.used_energy(compression_m, rig)
    try:
        analysis_j = energy.analysis_energy(compression_m, rig)
    except ValueError as error:
        refused = replace(flight, verdict="rejected", reasons=(*flight.reasons, str(error)))
        return HopEnergies(refused, compression_m, used_j)
    seen = HopEnergies(flight, compression_m, used_j, analysis_j)
    if flight.verdict == "rejected":
        return seen
    return _with_height(seen, record, rig, settings, hop_index)


def stored_compression(record: HopRecord, settings: FlightSettings, hop_index: int) -> Uncertain | None:
    """Mean spring compression before the fire command; `None` without readings."""
    before = record.fire_s - record.spring_times_s
    rest = record.compression_m[(before > 0.0) & (before < _STATIC_S)]
    if rest.size < 3:
        return None
    sensors = settings.sensors
    scatter = max(float(np.std(rest, ddof=1)), sensors.spring_drive_noise_m) / math.sqrt(rest.size)
    sigma = math.hypot(scatter, sensors.spring_step_m / math.sqrt(12.0))
    return Uncertain.of(float(np.mean(rest)), sigma, f"compression#{hop_index}")


def _with_height(
    seen: HopEnergies, record: HopRecord, rig: RigConstants, settings: FlightSettings, hop_index: int
) -> HopEnergies:
    flight = seen.flight
    assert seen.compression_m is not None
    gravity = measured_gravity(flight, settings, hop_index)
    rig = replace(rig, gravity_m_s2=gravity)
    source = f"time_of_flight#{hop_index}"
    time_s = Uncertain.of(flight.time_of_flight_s, flight.ballistic_sigma_s, source)
    total = rig.total_mass_kg
    # The leg hangs differently at take-off and touchdown: z_com = z_l - (m_b/M) delta.
    stretch_m = flight.compression_m[0] - flight.compression_m[1]
    speed = 0.5 * gravity * time_s + (rig.body_mass_kg / total) * stretch_m / time_s
    rise_m, mismatch = _rise_on_spring(record, flight, rig, speed, settings)
    rise_m = rise_m.with_part(f"rise#{hop_index}", settings.evaluation.rise_error_m)
    height_m = rise_m + _leg_share_rise(seen.compression_m, flight, rig) + speed**2 / (2.0 * gravity)
    if mismatch:  # one of the two is wrong, and nobody knows which
        return replace(seen, flight=replace(flight, verdict="rejected", reasons=(*flight.reasons, mismatch)))
    return replace(
        seen,
        flight=flight,
        time_of_flight_s=Uncertain.of(time_s.value, flight.time_of_flight_sigma_s, source),
        take_off_speed_m_s=speed,
        height_m=height_m,
        potential_j=total * gravity * height_m,
        gravity_m_s2=gravity,
    )


def measured_gravity(flight: FlightTime, settings: FlightSettings, hop_index: int) -> Uncertain:
    """Effective gravity: (reading at rest - reading in flight)/gain, weighed against the configured value.

    The sensor's bias cancels in the difference. On an arm the same holds: the readings are g cos(theta) and
    (g - rho g_eff/L) cos(theta), so that the difference over rho/L is g_eff there too.
    """
    rig, gain = settings.rig, settings.rig.sensor_gain
    measured = (flight.static_m_s2 - flight.offset_m_s2) / gain
    noise = math.hypot(flight.static_sigma_m_s2, flight.offset_sigma_m_s2) / gain
    allowed = math.hypot(settings.evaluation.gravity_error_m_s2, noise)
    configured, spread = rig.gravity_m_s2, rig.gravity_std_share * rig.gravity_m_s2
    weight = spread**2 / (spread**2 + allowed**2)
    common = math.hypot((1.0 - weight) * spread, weight * settings.evaluation.gravity_error_m_s2)
    value = configured + weight * (measured - configured)
    return Uncertain(value, {"gravity": common, f"accelerometer_zero#{hop_index}": weight * noise})


def _leg_share_rise(compression_m: Uncertain, flight: FlightTime, rig: RigConstants) -> Uncertain:
    """What the leg, left behind as the spring extends, takes from the rise: z_com = z_b + (m_l/M) delta."""
    weight_m = rig.body_mass_kg * rig.gravity_m_s2 / rig.stiffness_n_m
    change_m = flight.compression_m[0] - (compression_m + weight_m)
    return (rig.leg_mass_kg / rig.total_mass_kg) * change_m


def _rise_on_spring(
    record: HopRecord, flight: FlightTime, rig: RigConstants, speed: Uncertain, settings: FlightSettings
) -> tuple[Uncertain, str]:
    """Rise of the body from the opening to take-off [m], and a complaint if the two ends do not meet.

    Integrated backwards from take-off, where the time of flight gives the speed: the speed must then vanish
    at the opening. That finds the opening between two samples, which a forward integration would have to
    guess while the acceleration jumps by 200 m/s^2.
    """
    body_m_s = speed - (rig.leg_mass_kg / rig.total_mass_kg) * flight.compression_rate_m_s[0]
    gain = settings.rig.sensor_gain
    motion = (record.specific_force_m_s2 - flight.static_m_s2) / gain
    times = record.times_s
    noise = settings.sensors.accelerometer_noise_m_s2 / gain
    moving = np.flatnonzero(
        (times >= record.fire_s) & (times < flight.take_off_s) & (motion > _STEP_SIGMAS * noise)
    )
    if moving.size == 0:
        return Uncertain(0.0), "no push is seen between the fire command and take-off"
    inside = slice(int(moving[0]), int(np.searchsorted(times, flight.take_off_s)))
    last = float(np.interp(flight.take_off_s, times, motion))
    t = np.append(times[inside], flight.take_off_s)
    a = np.append(motion[inside], last)
    gained = _cumulative(t, a)
    rate = body_m_s.value - (gained[-1] - gained)
    rise = float(_cumulative(t, rate)[-1])
    step_s = float(t[1] - t[0])
    # Before the first sample that shows the push: from rest at constant acceleration, for one sample at most.
    begin_m_s = float(rate[0])
    begin_s = min(max(begin_m_s, 0.0) / float(a[0]), step_s)
    rise += 0.5 * max(begin_m_s, 0.0) * begin_s
    duration_s = flight.take_off_s - float(t[0]) + begin_s
    slack = 3.0 * body_m_s.sigma + _PUSH_TOLERANCE * body_m_s.value
    complaint = ""
    if not -slack < begin_m_s < float(a[0]) * step_s + slack:
        complaint = f"the push and the time of flight disagree by {begin_m_s:.3f} m/s"
    return combine(rise, (body_m_s, duration_s)), complaint


def _cumulative(t: Array, y: Array) -> Array:
    """Integral of y over t by trapezia, from the first point to each (n,)."""
    return np.concatenate(([0.0], np.cumsum(0.5 * (y[1:] + y[:-1]) * np.diff(t))))
