"""The textbook's estimators of a jump, on the same records: what the flight software has to beat.

All know the rig's nominal masses and gravity, state no uncertainty, and refuse only what they cannot evaluate.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import lru_cache

import numpy as np

from benchmarks.hop_cases import Float, SimulatedHop, nominal_signal
from benchmarks.hop_results import Answer
from flight.flight_search import Expectation
from flight.record import HopRecord

_FREE_FALL_G = 0.5
_SHORTEST_S = 0.05
_TEMPLATE_S = 0.012
_REFUSED = Answer(False, reason="no flight found")


def threshold(hop: SimulatedHop, record: HopRecord) -> Answer:
    """Free fall where the reading, averaged over a period of the ringing, is below g/2; E = M g g T^2/8."""
    times, motion = _motion(hop, record)
    expected = Expectation.of(hop.settings)
    width = max(1, round(2.0 * math.pi / expected.omega_rad_s / float(np.median(np.diff(times)))))
    smooth = np.convolve(motion, np.ones(width) / width, mode="same")
    gravity = hop.settings.rig.gravity_m_s2
    after_push = np.flatnonzero((times > 0.0) & (smooth > 2.0 * gravity))
    if not after_push.size:
        return _REFUSED
    falling = smooth < _FREE_FALL_G * gravity
    falling[: after_push[0]] = False
    edges = np.flatnonzero(np.diff(np.concatenate(([0], falling.astype(np.int8), [0]))))
    for first, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        if stop < times.size and times[stop] - times[first] > _SHORTEST_S:
            return _by_flight(hop, float(times[stop] - times[first]))
    return _REFUSED


def integration(hop: SimulatedHop, record: HopRecord) -> Answer:
    """Take-off speed of the body by integrating the push, v = (m_b/M) v_b; T = 2 v/g and E = M v^2/2."""
    times, motion = _motion(hop, record)
    rig = hop.settings.rig
    pushing = np.flatnonzero((times > 0.0) & (motion > 2.0 * rig.gravity_m_s2))
    if not pushing.size:
        return _REFUSED
    first = int(pushing[0])
    over = np.flatnonzero(motion[first:] < 0.0)
    if not over.size:
        return _REFUSED
    part = slice(max(first - 1, 0), first + int(over[0]) + 1)
    acceleration = motion[part] - rig.gravity_m_s2
    body_m_s = float(np.sum(0.5 * (acceleration[1:] + acceleration[:-1]) * np.diff(times[part])))
    total_kg = rig.body_mass_kg + rig.leg_mass_kg
    speed = body_m_s * rig.body_mass_kg / total_kg
    return Answer(True, 2.0 * speed / rig.gravity_m_s2, energy_j=0.5 * total_kg * speed**2)


def template(hop: SimulatedHop, record: HopRecord) -> Answer:
    """Where the ends of the nominal hop, surface and energy known, correlate best; E = M g g T^2/8."""
    times, motion = _motion(hop, record)
    step = float(np.median(np.diff(times)))
    grid = np.arange(times[0], times[-1], step)
    seen = np.interp(grid, times, motion)
    case = hop.case
    clean_s, clean, take_off_s, touchdown_s = _nominal(
        case.rig, case.body, case.foot, case.surface, case.compression_m
    )
    ends = []
    for at_s in (take_off_s, touchdown_s):
        shape_s = np.arange(at_s - _TEMPLATE_S, at_s + _TEMPLATE_S, step)
        shape = np.interp(shape_s, clean_s, clean)
        windows = np.lib.stride_tricks.sliding_window_view(seen, shape.size)
        near = np.abs(grid[: len(windows)] - shape_s[0]) < 0.2 * at_s + 0.01
        if not near.any():
            return _REFUSED
        centred = windows[near] - windows[near].mean(axis=1, keepdims=True)
        shape = shape - shape.mean()
        match = centred @ shape / np.maximum(np.linalg.norm(centred, axis=1), 1e-9)
        ends.append(float(grid[np.flatnonzero(near)[int(np.argmax(match))]]) + _TEMPLATE_S)
    if ends[1] - ends[0] < _SHORTEST_S:
        return _REFUSED
    return _by_flight(hop, ends[1] - ends[0])


RIVALS: Mapping[str, Callable[[SimulatedHop, HopRecord], Answer]] = {
    "threshold": threshold,
    "integration": integration,
    "template": template,
}


def _motion(hop: SimulatedHop, record: HopRecord) -> tuple[Float, Float]:
    """Body's specific force along the leg, zero in free fall; times from the fire command."""
    rig = hop.settings.rig
    rest = float(np.mean(record.specific_force_m_s2[record.times_s < record.fire_s]))
    force = (record.specific_force_m_s2 - rest) / rig.sensor_gain + rig.gravity_m_s2
    return record.times_s - record.fire_s, force


def _by_flight(hop: SimulatedHop, flight_s: float) -> Answer:
    rig = hop.settings.rig
    weight_n = (rig.body_mass_kg + rig.leg_mass_kg) * rig.gravity_m_s2
    return Answer(True, flight_s, energy_j=weight_n * rig.gravity_m_s2 * flight_s**2 / 8.0)


@lru_cache(maxsize=64)
def _nominal(
    rig: str, body: str, foot: str, surface: str, compression_m: float
) -> tuple[Float, Float, float, float]:
    return nominal_signal(rig, body, foot, surface, compression_m)
