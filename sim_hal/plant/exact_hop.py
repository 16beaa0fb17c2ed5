"""The nominal hop to its highest point, piece by piece, each piece exact: many hops in a blink.

Body and leg on one spring over soil are linear as long as the soil is loaded, unloaded or left, so that the state
within a piece is its Taylor series, to rounding. A piece ends where the foot turns (loading), or crosses the height
at which the soil lets it go or is loaded anew. In flight the foot's height is bounded from below by the ring of the
spring: once that bound is above the soil, the centre of mass is a parabola to its top.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim_hal.plant.native import Floats1, Floats2, entry

HOP_PARAMETERS = ("m_b", "m_l", "g", "k", "c", "k_l", "chi", "spring_compression_m")
M_B, M_L, G, K, C, K_L, CHI, S = range(len(HOP_PARAMETERS))

LOADING, UNLOADING, FLIGHT, DONE = range(4)
LONGEST = 30
"""Terms of a Taylor series over one radian of the fastest oscillation; the last are below rounding."""
REACH = 1.0
MOST_STEPS = 200_000
FOOT, FOOT_SPEED, BODY, BODY_SPEED = range(4)


def expand(p: Floats1, w: Floats2, stiffness: float, push: float, h: float) -> int:
    """Taylor coefficients of the state by the share of a step h, in the rows of w, from the state in row 0; how many.

    The soil pushes with push − stiffness · (height of the foot).
    """
    count = 1
    largest = size_of(w, 0, h)
    for n in range(LONGEST - 1):
        inner = p[K] * (w[n, FOOT] - w[n, BODY]) + p[C] * (w[n, FOOT_SPEED] - w[n, BODY_SPEED])
        soil = -stiffness * w[n, FOOT]
        weight = 0.0
        if n == 0:
            soil += push
            weight = p[G]
        share = h / (n + 1)
        w[n + 1, FOOT] = share * w[n, FOOT_SPEED]
        w[n + 1, FOOT_SPEED] = share * ((soil - inner) / p[M_L] - weight)
        w[n + 1, BODY] = share * w[n, BODY_SPEED]
        w[n + 1, BODY_SPEED] = share * (inner / p[M_B] - weight)
        count = n + 2
        size = size_of(w, n + 1, h)
        largest = max(largest, size)
        if size <= 1e-17 * largest:
            break
    return count


def size_of(w: Floats2, n: int, h: float) -> float:
    """Size of a term, as a speed."""
    return float(abs(w[n, FOOT_SPEED]) + abs(w[n, BODY_SPEED]) + (abs(w[n, FOOT]) + abs(w[n, BODY])) / h)


def at(w: Floats2, count: int, column: int, share: float) -> float:
    """A quantity of the state at a share of the step."""
    total = 0.0
    for n in range(count - 1, -1, -1):
        total = total * share + w[n, column]
    return total


def crossing(w: Floats2, count: int, column: int, level: float, low: float, high: float) -> float:
    """Share of the step between two at which a quantity crosses a level that lies between its values there."""
    rising = at(w, count, column, high) > at(w, count, column, low)
    share = 0.5 * (low + high)
    for _ in range(100):
        value, slope = 0.0, 0.0
        for n in range(count - 1, -1, -1):
            slope = slope * share + value
            value = value * share + w[n, column]
        value -= level
        if (value > 0.0) == rising:
            high = share
        else:
            low = share
        newton = share - value / slope if slope != 0.0 else low
        newton = newton if low < newton < high else 0.5 * (low + high)
        if abs(newton - share) <= 1e-16 or not low < newton < high:
            break
        share = newton
    return share


def first_above(w: Floats2, count: int, level: float) -> float:
    """Share of the step at which the foot first rises above a level, 2 if it does not; it may turn once within."""
    top = 1.0
    if w[0, FOOT_SPEED] > 0.0 and at(w, count, FOOT_SPEED, 1.0) < 0.0:
        top = crossing(w, count, FOOT_SPEED, 0.0, 0.0, 1.0)
    if at(w, count, FOOT, top) > level:
        return crossing(w, count, FOOT, level, 0.0, top)
    return 2.0


def first_below(w: Floats2, count: int, level: float) -> float:
    """Share of the step at which the foot first falls below a level, 2 if it does not; it may turn once within."""
    bottom = 1.0
    if w[0, FOOT_SPEED] < 0.0 and at(w, count, FOOT_SPEED, 1.0) > 0.0:
        bottom = crossing(w, count, FOOT_SPEED, 0.0, 0.0, 1.0)
    if at(w, count, FOOT, bottom) < level:
        return crossing(w, count, FOOT, level, 0.0, bottom)
    return 2.0


def clear(p: Floats1, w: Floats2, level: float) -> bool:
    """Whether the foot stays above a level for as long as the centre of mass rises."""
    mass = p[M_B] + p[M_L]
    reduced = p[M_B] * p[M_L] / mass
    apart = w[0, FOOT] - w[0, BODY]
    closing = w[0, FOOT_SPEED] - w[0, BODY_SPEED]
    ring = np.sqrt(apart * apart + reduced / p[K] * closing * closing)
    return bool(centre(p, w) - p[M_B] / mass * ring > level)


def highest(p: Floats1, w: Floats2, count: int) -> float:
    """Share of the step at which the centre of mass is highest, 2 if it still rises at the end."""
    if speed_at(p, w, count, 0.0) <= 0.0 or speed_at(p, w, count, 1.0) > 0.0:
        return 2.0
    low, high = 0.0, 1.0
    while high - low > 1e-9:  # its height there is right to the square of that
        share = 0.5 * (low + high)
        if speed_at(p, w, count, share) > 0.0:
            low = share
        else:
            high = share
    return low


def speed_at(p: Floats1, w: Floats2, count: int, share: float) -> float:
    """Speed of the centre of mass times the mass."""
    return float(p[M_B] * at(w, count, BODY_SPEED, share) + p[M_L] * at(w, count, FOOT_SPEED, share))


def centre(p: Floats1, w: Floats2) -> float:
    """Height of the centre of mass at the start of the step."""
    return float((p[M_B] * w[0, BODY] + p[M_L] * w[0, FOOT]) / (p[M_B] + p[M_L]))


def go_on(p: Floats1, w: Floats2, piece: int, deepest: float) -> tuple[int, float]:
    """One step within a piece, up to its end at most: the piece then, and the deepest that the foot has been.

    The piece is DONE at the highest point.
    """
    steep, crater = p[K_L] / (1.0 - p[CHI]), -p[CHI] * deepest
    stiffness, push = 0.0, 0.0
    if piece == LOADING:
        stiffness = p[K_L]
    elif piece == UNLOADING:
        stiffness, push = steep, (p[K_L] - steep) * deepest
    fastest = np.sqrt((p[K] + stiffness) / p[M_L] + p[K] / p[M_B]) + p[C] * (1.0 / p[M_L] + 1.0 / p[M_B])
    count = expand(p, w, stiffness, push, REACH / fastest)
    end, later, foot = 2.0, piece, 0.0
    if piece == LOADING and at(w, count, FOOT_SPEED, 1.0) > 0.0:
        end, later = crossing(w, count, FOOT_SPEED, 0.0, 0.0, 1.0), UNLOADING
    elif piece == UNLOADING:
        end, later, foot = first_above(w, count, crater), FLIGHT, crater
        below = first_below(w, count, -deepest)
        if below < end:
            end, later, foot = below, LOADING, -deepest
    elif piece == FLIGHT:
        end, later, foot = first_below(w, count, crater), UNLOADING, crater
    top = highest(p, w, count)
    share = min(end, top, 1.0)
    for column in range(4):
        w[LONGEST, column] = at(w, count, column, share)
    for column in range(4):
        w[0, column] = w[LONGEST, column]
    if piece == LOADING:
        deepest = max(deepest, -w[0, FOOT])
    if top < 2.0 and top <= end:
        return DONE, deepest
    if end > 1.0:
        return piece, deepest
    if piece == LOADING:
        w[0, FOOT_SPEED] = 0.0  # exactly where the next piece begins, that it does not end at once
    else:
        w[0, FOOT] = foot
    return later, deepest


def climb(p: Floats1, w: Floats2) -> float:
    """How far the centre of mass rises from the opening of the lock on; nan if that takes for ever."""
    mass = p[M_B] + p[M_L]
    deepest = mass * p[G] / p[K_L]
    w[0, FOOT] = -deepest
    w[0, BODY] = -deepest - p[M_B] * p[G] / p[K] - p[S]
    w[0, FOOT_SPEED] = w[0, BODY_SPEED] = 0.0
    start, piece, rise = centre(p, w), LOADING, np.nan
    for _ in range(MOST_STEPS):
        piece, deepest = go_on(p, w, piece, deepest)
        if piece == DONE:
            rise = 0.0
            break
        if piece == FLIGHT and clear(p, w, -p[CHI] * deepest):
            rise = (speed_at(p, w, 1, 0.0) / mass) ** 2.0 / (2.0 * p[G])
            break
    return centre(p, w) - start + rise


def room() -> NDArray[np.float64]:
    """What `climbs` needs to work in."""
    return np.zeros((LONGEST + 1, 4))


@entry
def climbs(parameters: Floats2, w: Floats2, heights: Floats1) -> None:
    """Heights [m] of hops with given `HOP_PARAMETERS` (n, 8), not finite where there is none; w is room."""
    for i in range(len(parameters)):
        heights[i] = climb(parameters[i], w)
