"""Rates of the states, friction forces in them, and their derivatives."""

from __future__ import annotations

import numpy as np

from sim_hal.plant.engine.friction import add_force, grip, grips, hold, only_state, solve_small
from sim_hal.plant.engine.machine import (
    BACKWARD,
    BACKWARD_SLOPE,
    CONDITION,
    DERIVATIVE,
    DYNAMIC,
    FORCE_AT,
    FORWARD,
    FORWARD_SLOPE,
    INPUT,
    JAC,
    JACOBIAN,
    NS,
    NU,
    OFF,
    PER_FORCE,
    RATES,
    SEGMENT,
    SLOPE,
    SLOTS,
    START_VALUE,
    STATE_AT,
    TIME_AT,
    VELOCITY,
    WEIGHT,
    M,
    execute,
    kept_at,
    span_at,
)
from sim_hal.plant.native import Floats1, Floats2, Ints1, Ints2


def rates_at(
    code: Ints2, tab: Ints1, r: Floats1, mode: Ints1, w: Floats2, t: float, x: int, rate: int
) -> bool:
    """Rates at time t and the state in row x go to row `rate`, friction forces to their registers. False: no grip.

    States that do not count stand still.
    """
    r[tab[TIME_AT]] = t
    for k in range(tab[NU]):
        r[tab[INPUT] + k] = r[tab[START_VALUE] + k] + r[tab[SLOPE] + k] * (t - r[tab[SEGMENT]])
    for s in range(tab[NS]):
        r[tab[STATE_AT] + s] = w[x, s]
    execute(code, tab[DYNAMIC], tab[DERIVATIVE], r)
    for s in range(tab[NS]):
        w[rate, s] = r[tab[tab[RATES] + s]] if w[WEIGHT, s] != 0.0 else 0.0
    stuck = False
    for j in range(tab[M]):
        if mode[j] == 0:
            stuck = True
        elif mode[j] != OFF:
            level = -r[tab[tab[FORWARD] + j]] if mode[j] > 0 else r[tab[tab[BACKWARD] + j]]
            r[tab[FORCE_AT] + j] = level
            add_force(tab, r, j, level, w, rate)
    return hold(tab, r, mode, w, rate) if stuck else True


def jacobian_at(code: Ints2, tab: Ints1, r: Floats1, mode: Ints1, w: Floats2) -> None:
    """Derivatives of the rates where they were just evaluated.

    An entry that is no finite number is left out: the steps that use the matrix do not need it to be exact. `mode`
    gets from where to where each row is not 0.
    """
    execute(code, tab[DERIVATIVE], tab[CONDITION], r)
    columns, spans = tab[NS] + 1, span_at(tab)
    for s in range(tab[NS]):
        for c in range(columns):
            known = r[tab[tab[JACOBIAN] + s * columns + c]]
            w[JAC + s, c] = known if w[WEIGHT, s] != 0.0 else 0.0
    stuck = False
    for j in range(tab[M]):
        if mode[j] == 0:
            stuck = True
        elif mode[j] != OFF:
            slope = tab[FORWARD_SLOPE if mode[j] > 0 else BACKWARD_SLOPE] + j * columns
            for s in range(tab[NS]):
                per_force = -mode[j] * r[tab[tab[PER_FORCE] + j * tab[NS] + s]]
                if per_force != 0.0:
                    for c in range(columns):
                        w[JAC + s, c] += per_force * r[tab[slope + c]]
    if stuck:
        for c in range(columns):
            hold_still(tab, r, mode, w, c)
    for s in range(tab[NS]):
        total = 0.0
        for c in range(columns):
            total += w[JAC + s, c]
        if not np.isfinite(total):
            for c in range(columns):
                w[JAC + s, c] = w[JAC + s, c] if np.isfinite(w[JAC + s, c]) else 0.0
        first, last = 0, tab[NS]
        while first < last and w[JAC + s, first] == 0.0:
            first += 1
        while last > first and w[JAC + s, last - 1] == 0.0:
            last -= 1
        mode[spans + s], mode[spans + tab[NS] + s] = first, last


def hold_still(tab: Ints1, r: Floats1, mode: Ints1, w: Floats2, c: int) -> None:
    """Take from the derivatives in a column what the holding forces take from the rates."""
    ns = tab[NS]
    first = kept_at(ns, SLOTS)
    grips(tab, r, mode, w)
    for i in range(tab[M]):
        if mode[i] == 0 and grip(tab, r, i, i) != 0.0:
            for s in range(ns):
                w[first + i, tab[M]] -= r[tab[tab[VELOCITY] + i * ns + s]] * w[JAC + s, c]
    if not solve_small(w, first, tab[M]):
        return
    for i in range(tab[M]):
        for s in range(ns):
            w[JAC + s, c] += r[tab[tab[PER_FORCE] + i * ns + s]] * w[first + i, tab[M]]
    for i in range(tab[M]):
        only = only_state(tab, r, i) if mode[i] == 0 and grip(tab, r, i, i) != 0.0 else -1
        if only >= 0:
            w[JAC + only, c] = 0.0
