"""One step with error control."""

from __future__ import annotations

import numpy as np

from sim_hal.plant.engine.locating import LINEAR, linear_up_to
from sim_hal.plant.engine.machine import (
    CLOCK,
    FORCED,
    NO_PROPAGATOR,
    NOT_FINITE,
    NS,
    OK,
    STEP_VANISHED,
    TIME,
    WANTED,
)
from sim_hal.plant.engine.propagate import ALIKE, ROUGHLY, find, same
from sim_hal.plant.engine.stages import cubic, linear
from sim_hal.plant.native import Floats1, Floats2, Ints1, Ints2

MIN_STEP = 1e-14
KINK = 100.0
"""Error beyond which a step is looked at for an event up to which it is linear, before anything else."""
NEARLY = 0.95
"""Share of the way to an event that is tried where the step is neither linear up to it nor smooth beyond."""
AGAIN = -1


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
