"""The stages of a step: an exponential Rosenbrock method that stops at the order which suffices.

Over a step the rates are f = f0 + L (y − y0) + F1 θ + D(θ), L their derivatives by the states and F1 that by time.
Where the equations are linear D is 0 and the step exact. Else D, of which value and slope vanish at the start, is the
cubic through its values at half and whole step: order 4, with the cubic's last term for the error (the method
exprb43 of Hochbruck, Ostermann, Schweitzer, SIAM J. Numer. Anal. 47 (2009) 786), its stages repeated where they have
not settled. L may be of an earlier step; what it lacks is in F1 and D.
"""

from __future__ import annotations

import numpy as np

from sim_hal.plant.engine.machine import (
    ABSOLUTE,
    CHANGE,
    CLOCK,
    DEFECT,
    END,
    FORCE,
    HALF,
    HALF_STEP,
    HERE,
    JAC,
    NS,
    POINT,
    RATE,
    RELATIVE,
    SCALE,
    SPARE,
    START,
    STATE,
    TIME,
    WEIGHT,
    WHOLE_STEP,
    span_at,
)
from sim_hal.plant.engine.propagate import along, series, weigh
from sim_hal.plant.engine.rates import rates_at
from sim_hal.plant.native import Floats1, Floats2, Ints1, Ints2

FLOOR = 0.01
"""Share of a state's largest value so far below which its relative tolerance no longer shrinks."""
SWEEPS = 3


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
