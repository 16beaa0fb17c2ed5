"""From one hop's record to its energies: E_used, height above the start, E_pot, and what follows."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from flight import energy
from flight.energy import RigConstants
from flight.flight_time import FlightTime, estimate_flight
from flight.heartbeat import Heartbeat
from flight.jump_height import jump_height
from flight.push import NoPush, find_push
from flight.record import HopRecord
from flight.settings import FlightSettings
from flight.uncertain import Uncertain
from flight.weighing import weighed

_STATIC_S = 0.2  # stretch before the fire command over which the compression is averaged
_REJECTED_SIGMAS = 6.0  # by which the push and the time of flight may disagree


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
        return HopEnergies(_rejected(flight, "no spring readings before the fire command"))
    if not abs(compression_m.value) + compression_m.sigma < 2.0 * settings.max_compression_m:
        return HopEnergies(
            _rejected(flight, "the spring's readings before the fire command are no compression of it")
        )
    used_j = energy.used_energy(compression_m, rig)
    try:
        analysis_j = energy.analysis_energy(compression_m, rig)
    except ValueError as error:
        return HopEnergies(_rejected(flight, str(error)), compression_m, used_j)
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
    flight, fit = seen.flight, seen.flight.fit
    assert seen.compression_m is not None
    assert fit is not None
    gravity = measured_gravity(flight, settings, hop_index)
    rig = weighed(replace(rig, gravity_m_s2=gravity), fit, hop_index)
    try:
        least_a = settings.rig.release_current_a * (1.0 - 3.0 * settings.rig.release_current_std_share)
        push = find_push(record, fit, seen.compression_m.value, least_a)
    except NoPush as error:
        return replace(seen, flight=_rejected(flight, str(error)))
    share = energy.c1_expected(rig)
    jump = jump_height(flight, fit, push, seen.compression_m, gravity, share, settings, hop_index)
    if abs(jump.disagreement_sigmas) > _REJECTED_SIGMAS:  # one of the two is wrong, and nobody knows which
        by = f"by {jump.disagreement_m_s:.3f} m/s"
        return replace(seen, flight=_rejected(flight, f"the push and the time of flight disagree {by}"))
    source = f"time_of_flight#{hop_index}"
    return replace(
        seen,
        used_j=energy.used_energy(seen.compression_m, rig),
        analysis_j=energy.analysis_energy(seen.compression_m, rig),
        flight=flight,
        time_of_flight_s=Uncertain.of(flight.time_of_flight_s, flight.time_of_flight_sigma_s, source),
        take_off_speed_m_s=jump.speed_m_s,
        height_m=jump.height_m,
        potential_j=rig.total_mass_kg * gravity * jump.height_m,
        gravity_m_s2=gravity,
    )


def _rejected(flight: FlightTime, reason: str) -> FlightTime:
    return replace(flight, verdict="rejected", reasons=(*flight.reasons, reason))


def measured_gravity(flight: FlightTime, settings: FlightSettings, hop_index: int) -> Uncertain:
    """Effective gravity: (reading at rest - reading in flight)/gain, weighed against the configured value.

    The sensor's bias cancels in the difference. On an arm the same holds: the readings are g cos(theta) and
    (g - rho g_eff/L) cos(theta), so that the difference over rho/L is g_eff there too.
    """
    rig, gain = settings.rig, settings.rig.sensor_gain
    measured = (flight.static_m_s2 - flight.offset_m_s2) / gain
    noise = math.hypot(flight.static_sigma_m_s2, flight.offset_sigma_m_s2) / gain
    scale = settings.sensors.scale_std_share * rig.gravity_m_s2
    common_error = math.hypot(settings.evaluation.gravity_error_m_s2, scale)
    configured, spread = rig.gravity_m_s2, rig.gravity_std_share * rig.gravity_m_s2
    weight = spread**2 / (spread**2 + common_error**2 + noise**2)
    common = math.hypot((1.0 - weight) * spread, weight * common_error)
    value = configured + weight * (measured - configured)
    return Uncertain(value, {"gravity": common, f"accelerometer_zero#{hop_index}": weight * noise})
