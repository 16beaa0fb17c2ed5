"""When within a step something happens: friction turns, a memory or kink changes sides, a flag's condition holds."""

from __future__ import annotations

from sim_hal.plant.engine.events import copy, margins
from sim_hal.plant.engine.friction import dot, relative_velocity
from sim_hal.plant.engine.machine import (
    BEFORE,
    BETWEEN,
    CHANGE,
    CLOCK,
    END,
    FOUND,
    HALF,
    HERE,
    HIGH,
    JAC,
    LOW,
    NF,
    NO_PROPAGATOR,
    NS,
    NW,
    POINT,
    RATE,
    STATE,
    TERMS,
    TIME,
    TREND,
    VELOCITY,
    M,
    Q,
)
from sim_hal.plant.engine.propagate import along
from sim_hal.plant.engine.rates import rates_at
from sim_hal.plant.engine.stages import error_of, go_to
from sim_hal.plant.native import Floats1, Floats2, Ints1, Ints2

LINEAR = 0.1
"""Share of the tolerance within which D is taken for 0."""
JUST_NOW = 1e-9
"""Share of a step by which an event may be noticed late."""
AT_ONCE = 1e-5
"""Share of a step within which what leaves a limit that it was at has left it: along a parabola, so by nothing."""


def linear_up_to(
    code: Ints2, tab: Ints1, r: Floats1, mode: Ints1, w: Floats2, h: float, terms: int
) -> tuple[float, bool]:
    """Share of the step, taken as linear, at which something happens, 1 if nothing does; whether it is linear so far.

    If so, the point HERE is as `locate` leaves it.
    """
    if not margins(code, tab, r, mode, w, POINT + END, RATE + END, HIGH):
        return 1.0, False
    share = locate(code, tab, r, mode, w, h, terms, 1.0)
    fits = is_linear(code, tab, r, mode, w, h, terms, share, HERE)
    if not fits:  # the rates may jump there
        fits = is_linear(code, tab, r, mode, w, h, terms, share - min(0.5 * share, 1e-10), HALF)
        if fits:
            hits(code, tab, r, mode, w, h, terms, share, HIGH)
    return share, fits


def is_linear(
    code: Ints2,
    tab: Ints1,
    r: Floats1,
    mode: Ints1,
    w: Floats2,
    h: float,
    terms: int,
    share: float,
    look: int,
) -> bool:
    """Whether the step is linear up to a share of it; point and rates there go to rows `look`."""
    along(tab, w, terms, share, CHANGE)
    held = go_to(code, tab, r, mode, w, w[CLOCK, TIME] + share * h, share, look, JAC)
    return held and error_of(tab, w, h * share, NO_PROPAGATOR, POINT + look) <= LINEAR


def hits(
    code: Ints2,
    tab: Ints1,
    r: Floats1,
    mode: Ints1,
    w: Floats2,
    h: float,
    terms: int,
    share: float,
    found: int,
) -> bool:
    """Whether something has happened by `share` of the step just taken; its margins go to rows `found`."""
    along(tab, w, terms, share, CHANGE)
    for s in range(tab[NS]):
        w[POINT + HERE, s] = w[STATE, s] + w[CHANGE, s]
    held = rates_at(code, tab, r, mode, w, w[CLOCK, TIME] + share * h, POINT + HERE, RATE + HERE)
    hit = margins(code, tab, r, mode, w, POINT + HERE, RATE + HERE, found)
    return hit or not held


def root(below: float, above: float, falls: float, rises: float) -> float:
    """Where between 0 and 1 a cubic vanishes, given its values there, of unlike sign, and slopes (0: not known).

    What is 0 at the start may leave it at once, along a parabola: looked for closer and closer to the start.
    """
    if not below > 0.0:
        return 1e-3
    chord = above - below
    first, last = falls if falls != 0.0 else chord, rises if rises != 0.0 else chord
    square, cube = 3.0 * chord - 2.0 * first - last, first + last - 2.0 * chord
    x = below / (below - above)
    for _ in range(3):
        slope = first + x * (2.0 * square + 3.0 * cube * x)
        if not slope < 0.0:
            break
        x = min(max(x - (below + x * (first + x * (square + x * cube))) / slope, 0.0), 1.0)
    return x


def behind(tab: Ints1, w: Floats2, h: float, share: float) -> bool:
    """Whether a look, at a share of the step, is as good as at what has happened: its rate says that it was just now.

    Or that it was just about to happen at the start of the step, its margin being 0 there.
    """
    found = True
    for i in range(tab[M] + tab[Q] + tab[NW] + tab[NF]):
        margin = w[FOUND + HIGH, i]
        near = -margin <= JUST_NOW * h * abs(w[TREND + HIGH, i])
        found = found and (near or (share <= AT_ONCE and (margin >= 0.0 or w[FOUND + BEFORE, i] == 0.0)))
    return found


def guess(
    tab: Ints1, r: Floats1, mode: Ints1, w: Floats2, h: float, terms: int, low: float, high: float
) -> tuple[float, bool]:
    """Where between two shares of a step the first margin vanishes, by cubics through its values and rates.

    Whether it is to rounding, by the series of a sliding element's velocity.
    """
    middle, known = high, False
    for i in range(tab[M] + tab[Q] + tab[NW] + tab[NF]):
        below, above = w[FOUND + LOW, i], w[FOUND + HIGH, i]
        if above < 0.0:
            span = h * (high - low)
            x = low + (high - low) * root(below, above, span * w[TREND + LOW, i], span * w[TREND + HIGH, i])
            own = i < tab[M] and below > 0.0 and abs(mode[i]) == 1
            if own:
                x = turn(tab, r, w, terms, i, x)
            if x < middle:
                middle, known = x, own
    return middle, known


def turn(tab: Ints1, r: Floats1, w: Floats2, terms: int, j: int, x: float) -> float:
    """Share of the step, near x, at which sliding element j comes to a stand, by its velocity's own series."""
    for _ in range(6):
        value, slope = 0.0, 0.0
        for k in range(terms - 1, 0, -1):
            slope = slope * x + value
            value = value * x + dot(tab, r, tab[VELOCITY] + j * tab[NS], w, TERMS + k)
        slope = slope * x + value
        value = value * x + relative_velocity(tab, r, j, w, STATE)
        step = value / slope if slope != 0.0 else 0.0
        x -= step
        if abs(step) <= 1e-8:  # and the next one as its square
            break
    return x


def locate(
    code: Ints2, tab: Ints1, r: Floats1, mode: Ints1, w: Floats2, h: float, terms: int, share: float
) -> float:
    """Share of the step at which the first thing happens, given one by which something has.

    Each look is a little to the far side of where a cubic says, so that both ends close in, or just behind where it
    is known to happen. Point, rates (rows HERE), registers and margins (rows HIGH) are left as they are there.
    """
    low, high = 0.0, share
    copy(w, LOW, BEFORE)
    looked = share < 1.0  # whether the last look was at the upper end
    if looked:
        hits(code, tab, r, mode, w, h, terms, high, HIGH)
    least = 1e-14 + 2e-16 * abs(w[CLOCK, TIME]) / h
    for count in range(100):
        if high - low <= least or (looked and behind(tab, w, h, high)):
            break
        middle = 0.5 * (low + high)
        if count % 6 != 5:
            middle, known = guess(tab, r, mode, w, h, terms, low, high)
            far = max(2.0 * least, 0.0 if known else 1e-5 * min(middle - low, high - middle))
            middle += far if known or middle - low < high - middle else -far
            middle = min(max(middle, low + 0.5 * least), high - 0.5 * least)
        if not low < middle < high:
            break
        looked = hits(code, tab, r, mode, w, h, terms, middle, BETWEEN)
        if looked:
            high = middle
        else:
            low = middle
        copy(w, HIGH if looked else LOW, BETWEEN)
    if not looked:
        hits(code, tab, r, mode, w, h, terms, high, HIGH)
    return high
