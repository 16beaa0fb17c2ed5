"""What makes a flight's evaluation doubtful although both its ends were found: gaps, a fall, a second flight."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flight.flight_search import Expectation, NoFlight, falls_s

Array = NDArray[np.float64]

_GAP_STEPS = 8.0  # a gap this many samples long hides what happens in it
_EDGE_S = 0.004  # around an edge, in which a gap counts
_STILL_S, _STILL_M_S2 = (
    0.1,
    0.5,
)  # the end of the record over which a robot stands or lies, and its unrest there
_UPRIGHT_SHARE = 0.15  # by which the reading may differ from that before the hop: a lean of 30 degrees
_FALLING_SHARE = 0.3  # of the weight: what reads less may be in the air
_AGAIN_SHARE = 0.5  # of the first flight, of one that counts
_STANDS_S = 0.25  # on the ground before another hop; a bounce is shorter there


def longest_gap_s(times_s: Array) -> float:
    """The longest pause between samples that hides nothing."""
    return _GAP_STEPS * float(np.median(np.diff(times_s)))


def has_gap(times_s: Array, first_s: float, last_s: float) -> bool:
    """Whether samples are missing between two times."""
    inside = times_s[(times_s > first_s) & (times_s < last_s)]
    return inside.size > 1 and float(np.max(np.diff(inside))) > longest_gap_s(times_s)


def gap_at(times_s: Array, edges_s: dict[str, float]) -> str:
    """Of an edge that lies in, or right beside, a gap of the samples: it was guessed, not seen. Else empty."""
    steps = np.diff(times_s)
    for index in np.flatnonzero(steps > longest_gap_s(times_s)).tolist():
        for name, edge_s in edges_s.items():
            if times_s[index] - _EDGE_S < edge_s < times_s[index + 1] + _EDGE_S:
                return f"a gap in the accelerometer's samples at {name}"
    return ""


def afterwards(
    times_s: Array, motion_m_s2: Array, expected: Expectation, noise_m_s2: float, edges_s: tuple[float, float]
) -> str:
    """What happened after touchdown that makes it no single hop on its foot: in words, or empty.

    `motion_m_s2` (n,): specific force of the body along the leg, gravity where it stands.
    """
    take_off_s, touchdown_s = edges_s
    gravity = expected.robot.gravity_m_s2
    # A robot in a bounce reads nothing too, but not for longer than it flew first.
    for still_s, least in ((_STILL_S, _FALLING_SHARE), (1.2 * (touchdown_s - take_off_s), -math.inf)):
        end = motion_m_s2[times_s > times_s[-1] - still_s]
        share = float(np.mean(end)) / gravity
        settled = times_s[-1] - touchdown_s > _STILL_S + still_s and float(np.std(end)) < _STILL_M_S2
        if settled and share > least and abs(share - 1.0) > _UPRIGHT_SHARE:
            return f"the robot fell over: it reads {share:.2f} of its weight after landing"
    after = times_s > touchdown_s
    if times_s[-1] - touchdown_s < _STANDS_S:
        return ""
    try:
        falls = falls_s(times_s[after], motion_m_s2[after], expected, noise_m_s2)
    except (NoFlight, IndexError):  # too few samples for any
        return ""
    landed_s = touchdown_s
    for begin_s, end_s in falls:
        if begin_s - landed_s > _STANDS_S and end_s - begin_s > _AGAIN_SHARE * (touchdown_s - take_off_s):
            return f"a second flight, of {end_s - begin_s:.2f} s, follows the first"
        landed_s = end_s
    return ""
