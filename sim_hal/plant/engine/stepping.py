"""One step: an exponential Rosenbrock method that stops at the order which suffices.

Over a step the rates are f = f0 + L (y − y0) + F1 θ + D(θ), L their derivatives by the states and F1 that by time.
Where the equations are linear D is 0 and the step exact. Else D, of which value and slope vanish at the start, is the
cubic through its values at half and whole step: order 4, with the cubic's last term for the error (the method
exprb43 of Hochbruck, Ostermann, Schweitzer, SIAM J. Numer. Anal. 47 (2009) 786), its stages repeated where they have
not settled. L may be of an earlier step; what it lacks is in F1 and D.
"""

from __future__ import annotations

import numpy as np

from sim_hal.plant.engine.events import copy, margins
from sim_hal.plant.engine.friction import dot, relative_velocity
from sim_hal.plant.engine.machine import (
    ABSOLUTE,
    BEFORE,
    BETWEEN,
    CHANGE,
    CLOCK,
    DEFECT,
    END,
    FORCE,
    FORCED,
    FOUND,
    HALF,
    HALF_STEP,
    HERE,
    HIGH,
    JAC,
    LOW,
    NF,
    NO_PROPAGATOR,
    NOT_FINITE,
    NS,
    NW,
    OK,
    POINT,
    RATE,
    RELATIVE,
    SCALE,
    SPARE,
    START,
    STATE,
    STEP_VANISHED,
    TERMS,
    TIME,
    TREND,
    VELOCITY,
    WANTED,
    WEIGHT,
    WHOLE_STEP,
    M,
    Q,
    span_at,
)
from sim_hal.plant.engine.propagate import ALIKE, ROUGHLY, along, find, same, series, weigh
from sim_hal.plant.engine.rates import rates_at
from sim_hal.plant.native import Floats1, Floats2, Ints1, Ints2

FLOOR = 0.01
"""Share of a state's largest value so far below which its relative tolerance no longer shrinks."""
MIN_STEP = 1e-14
LINEAR = 0.1
"""Share of the tolerance within which D is taken for 0."""
KINK = 100.0
"""Error beyond which a step is looked at for an event up to which it is linear, before anything else."""
NEARLY = 0.95
"""Share of the way to an event that is tried where the step is neither linear up to it nor smooth beyond."""
SWEEPS = 3
JUST_NOW = 1e-9
"""Share of a step by which an event may be noticed late."""
AT_ONCE = 1e-5
"""Share of a step within which what leaves a limit that it was at has left it: along a parabola, so by nothing."""
AGAIN = -1


def error_of(tab: Ints1, w: Floats2, h: float, place: int, end: int) -> float:
    """What a term θ² of F, in row CHANGE, adds to the increment relative to the tolerance: largest of all states."""
    n = tab[NS]
    if place > 0:
        weigh(tab, w, place + 3 * n, CHANGE, 1, SPARE)
    worst = 0.0
    for s in range(n):
        error = w[SPARE, s] if place > 0 else h / 3.0 * w[CHANGE, s]
        size = max(abs(w[end, s]), abs(w[STATE, s]), FLOOR * w[SCALE, s])
        share = w[WEIGHT, s] * abs(error) / (w[CLOCK, ABSOLUTE] + w[CLOCK, RELATIVE] * size)
        if not share <= worst:  # also catches what is not a number
            worst = share
    return float(worst)


def go_to(
    code: Ints2,
    tab: Ints1,
    r: Floats1,
    mode: Ints1,
    w: Floats2,
    at: float,
    share: float,
    look: int,
    matrix: int,
) -> bool:
    """Add row CHANGE to the state: point and rates (rows `look`) there, and D in its place. False: no grip."""
    n, spans = tab[NS], span_at(tab)
    for s in range(n):
        w[POINT + look, s] = w[STATE, s] + w[CHANGE, s]
    held = rates_at(code, tab, r, mode, w, at, POINT + look, RATE + look)
    for s in range(n):
        w[SPARE, s] = w[CHANGE, s]
    for s in range(n):
        total = w[RATE + look, s] - w[FORCE, s] - w[FORCE + 1, s] * share
        first = mode[spans + s] if matrix == JAC else 0
        last = mode[spans + n + s] if matrix == JAC else n
        for c in range(first, last):
            total -= w[matrix + s, c] * w[SPARE, c]
        w[CHANGE, s] = total
    return held


def reach(
    code: Ints2, tab: Ints1, r: Floats1, mode: Ints1, w: Floats2, h: float, place: int, half: int, count: int,
    terms: int,
) -> bool:  # fmt: skip
    """Go to the step's end (half 0) or middle (1): point, rates and D there. False: no grip.

    By the Taylor series of so many terms, or with the kept propagator at row `place` and `count` terms of F.
    """
    n = tab[NS]
    share = 0.5 if half == 1 else 1.0
    if place > 0:
        weigh(tab, w, place + n * (1 + 4 * half), FORCE, count, CHANGE)
    else:
        along(tab, w, terms, share, CHANGE)
    matrix = place if place > 0 else JAC
    held = go_to(code, tab, r, mode, w, w[CLOCK, TIME] + share * h, share, HALF if half == 1 else END, matrix)
    for s in range(n):
        w[DEFECT + half, s] = w[CHANGE, s]
    return held


def linear(
    code: Ints2, tab: Ints1, r: Floats1, mode: Ints1, w: Floats2, h: float, place: int
) -> tuple[float, int]:
    """The step as if all were linear: its error, and the length of its Taylor series (0 with a kept propagator)."""
    n = tab[NS]
    for s in range(n):
        w[FORCE, s] = w[RATE + START, s]
        slope = w[JAC + s, n]
        if place > 0:
            for c in range(n):
                slope += (w[JAC + s, c] - w[place + s, c]) * w[RATE + START, c]
        w[FORCE + 1, s] = h * slope
        w[FORCE + 2, s] = w[FORCE + 3, s] = 0.0
    terms = series(tab, mode, w, h) if place == 0 else 0
    held = reach(code, tab, r, mode, w, h, place, WHOLE_STEP, 2, terms)
    error = error_of(tab, w, h, place, POINT + END)
    return error if held and place + terms > 0 else np.nan, terms


def cubic(
    code: Ints2, tab: Ints1, r: Floats1, mode: Ints1, w: Floats2, h: float, place: int, terms: int
) -> tuple[float, int]:
    """The step with D, after `linear`: its error and the length of its Taylor series."""
    n = tab[NS]
    held = reach(code, tab, r, mode, w, h, place, HALF_STEP, 2, terms)
    error = np.nan
    for sweep in range(SWEEPS):
        if sweep > 0:
            held = held and reach(code, tab, r, mode, w, h, place, HALF_STEP, 4, terms)
        for s in range(n):
            w[FORCE + 2, s] = 8.0 * w[DEFECT + 1, s] - w[DEFECT, s]
            w[FORCE + 3, s] = 2.0 * w[DEFECT, s] - 8.0 * w[DEFECT + 1, s]
            w[POINT + HERE, s] = w[DEFECT, s]
        if place == 0:
            terms = series(tab, mode, w, h)
        if not (held and place + terms > 0 and reach(code, tab, r, mode, w, h, place, WHOLE_STEP, 4, terms)):
            return np.nan, terms
        for s in range(n):
            w[CHANGE, s] = 0.75 * w[FORCE + 3, s]
        bent = error_of(tab, w, h, place, POINT + END)
        for s in range(n):
            w[CHANGE, s] = w[DEFECT, s] - w[POINT + HERE, s]
        error = bent + error_of(tab, w, h, place, POINT + END)
        if error <= 1.0 or not bent <= 1.0:
            break
    return error, terms


def try_step(
    code: Ints2, tab: Ints1, r: Floats1, mode: Ints1, w: Floats2, h: float, last: bool, stiff: bool
) -> tuple[int, int, float]:
    """A step of size h with error control.

    OK, AGAIN to try with the smaller step, or what is wrong; the length of its Taylor series, 0 where there is none
    to tell what is within the step; the share of it up to which it counts, below 1 where it was found to end at an
    event (whose margins are in row FOUND + HIGH).
    """
    error, terms, share, wanted = np.nan, 0, 1.0, 0.0
    for attempt in range(2):
        alike = ROUGHLY if attempt == 0 else ALIKE
        place = find(tab, w, h, alike) if stiff else NO_PROPAGATOR
        error, terms = linear(code, tab, r, mode, w, h, place)
        wanted = h * (5.0 if error < 1e-3 * LINEAR else 2.0)
        if error <= LINEAR:
            break
        event = 1.0
        if terms > 0 and not error <= KINK:
            event, fits = linear_up_to(code, tab, r, mode, w, h, terms)
            if fits:
                error, share, wanted = 0.0, event, w[CLOCK, WANTED]
                break
        error, terms = cubic(code, tab, r, mode, w, h, place, terms)
        wanted = h * (
            min(5.0, max(0.2, 0.8 / np.sqrt(np.sqrt(max(error, 1e-4))))) if np.isfinite(error) else 0.1
        )
        if not error <= 1.0:
            wanted = max(wanted, NEARLY * event * h if event < 1.0 else 0.0)
        if error <= 1.0 or not stiff or same(w, tab[NS], place, h, ALIKE):
            break
    status = OK
    if not error <= 1.0:
        status = AGAIN
        if wanted < MIN_STEP * max(1.0, abs(w[CLOCK, TIME])):
            status = vanished(w, error)
    w[CLOCK, WANTED] = max(wanted, w[CLOCK, WANTED]) if last and status == OK else wanted
    if status == OK:
        w[CLOCK, FORCED] = max(0.0, w[CLOCK, FORCED] - 1.0)
    return status, terms, share


def vanished(w: Floats2, error: float) -> int:
    """What to do about a step that cannot be made smaller: once it is taken, for a jump at its start does no harm."""
    finite = np.isfinite(error)
    if finite and w[CLOCK, FORCED] == 0.0:
        w[CLOCK, FORCED] = 2.0
        return OK
    return STEP_VANISHED if finite else NOT_FINITE


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
