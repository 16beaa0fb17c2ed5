"""Discontinuities: flags, memories, kinks, and where friction turns or breaks away.

Each has a margin, which is negative where the mode of the thing no longer fits. They are listed in this order:
friction elements, memories, kinks, flags.
"""

from __future__ import annotations

import numpy as np

from sim_hal.plant.engine.friction import band, dot, hold_margin, relative_velocity, release, slide_rate
from sim_hal.plant.engine.machine import (
    AT_LOWER,
    AT_UPPER,
    BACKWARD,
    BEFORE,
    CHATTER,
    CONDITION,
    CONDITIONS,
    DYNAMIC,
    EMPTY_BAND,
    FLAG,
    FLAG_TIME,
    FORCE_AT,
    FORWARD,
    FOUND,
    HIGH,
    IDLE,
    JAC,
    LOWER,
    LOWER_SLOPE,
    MEMORY,
    MODAL,
    NF,
    NO_GRIP,
    NS,
    NW,
    OFF,
    OK,
    OUTPUT,
    RATE,
    RATE_AT,
    START,
    STATE,
    TREND,
    TRENDS,
    UPPER,
    UPPER_SLOPE,
    WATCHES,
    M,
    Q,
    execute,
)
from sim_hal.plant.engine.rates import rates_at
from sim_hal.plant.native import Floats1, Floats2, Ints1, Ints2

JUST_MET = -5e-324


def set_flags(tab: Ints1, r: Floats1, at: float) -> bool:
    """Latch the flags whose condition holds; whether there was one."""
    found = False
    for i in range(tab[NF]):
        condition = tab[tab[CONDITIONS] + i]
        if r[tab[FLAG] + i] == 0.0 and condition >= 0 and r[condition] >= 0.0:
            r[tab[FLAG] + i] = 1.0
            r[tab[FLAG_TIME] + i] = at
            found = True
    return found


def take_sides(tab: Ints1, r: Floats1, mode: Ints1, every: bool) -> bool:
    """Note on which side of each kink the state is; of those only that were on it, unless `every`.

    Whether there is any change.
    """
    first = tab[M] + tab[Q]
    found = False
    for k in range(tab[NW]):
        if mode[first + k] == 0 or (every and mode[first + k] != IDLE):
            value = r[tab[tab[WATCHES] + k]]
            side = 1 if value > 0.0 else -1 if value < 0.0 else 0
            found = found or side != mode[first + k]
            mode[first + k] = side
    return found


def settle(code: Ints2, tab: Ints1, r: Floats1, mode: Ints1, w: Floats2, t: float) -> int:
    """Bring flags, friction modes and memories into agreement with the state; gives the rates (row START) there."""
    for _ in range(100):
        execute(code, tab[MODAL], tab[DYNAMIC], r)
        if not rates_at(code, tab, r, mode, w, t, STATE, RATE + START):
            return NO_GRIP
        execute(code, tab[CONDITION], tab[OUTPUT], r)
        if set_flags(tab, r, t):
            continue
        breaks = False
        for j in range(tab[M]):
            width = r[tab[tab[FORWARD] + j]] + r[tab[tab[BACKWARD] + j]]
            if mode[j] != OFF and not width >= -band(tab, r, j):
                return EMPTY_BAND
            if mode[j] == 0 and hold_margin(tab, r, j) < 0.0:
                breaks = True
        if breaks and release(tab, r, mode, w, RATE + START):
            continue
        settle_memories(tab, r, mode, w)
        execute(code, tab[MODAL], tab[DYNAMIC], r)
        take_sides(tab, r, mode, True)
        return OK
    return CHATTER


def settle_memories(tab: Ints1, r: Floats1, mode: Ints1, w: Floats2) -> None:
    """Store each memory's value and whether it follows a limit from here on (at rest it follows none)."""
    for q in range(tab[Q]):
        low, high = r[tab[tab[LOWER] + q]], r[tab[tab[UPPER] + q]]
        value = min(max(r[tab[MEMORY] + q], low), high)
        r[tab[MEMORY] + q] = value
        r[tab[AT_LOWER] + q] = r[tab[AT_UPPER] + q] = 0.0
        if mode[tab[M] + q] == IDLE:  # without strength both limits are one
            r[tab[AT_LOWER] + q] = 1.0
            continue
        mode[tab[M] + q] = 0
        if value == low and dot(tab, r, tab[LOWER_SLOPE] + q * tab[NS], w, RATE + START) > 0.0:
            mode[tab[M] + q] = 1
            r[tab[AT_LOWER] + q] = 1.0
        elif value == high and dot(tab, r, tab[UPPER_SLOPE] + q * tab[NS], w, RATE + START) < 0.0:
            mode[tab[M] + q] = 2
            r[tab[AT_UPPER] + q] = 1.0


def keep_memories(tab: Ints1, r: Floats1, mode: Ints1) -> None:
    """Store the values of the memories that follow a limit."""
    for q in range(tab[Q]):
        if mode[tab[M] + q] == 1:
            r[tab[MEMORY] + q] = r[tab[tab[LOWER] + q]]
        elif mode[tab[M] + q] == 2:
            r[tab[MEMORY] + q] = r[tab[tab[UPPER] + q]]


def memory_margin(tab: Ints1, r: Floats1, q: int, mode: int, w: Floats2, rate: int) -> float:
    """How far memory q is from doing something else than its mode says."""
    margin = 1.0
    if mode == 0:
        value = r[tab[MEMORY] + q]
        margin = min(value - r[tab[tab[LOWER] + q]], r[tab[tab[UPPER] + q]] - value)
    elif mode == 1:
        margin = dot(tab, r, tab[LOWER_SLOPE] + q * tab[NS], w, rate)
    elif mode == 2:
        margin = -dot(tab, r, tab[UPPER_SLOPE] + q * tab[NS], w, rate)
    return margin


def margins(
    code: Ints2, tab: Ints1, r: Floats1, mode: Ints1, w: Floats2, x: int, rate: int, found: int
) -> bool:
    """All margins at the point (rows x and `rate`) just evaluated, and their rates; whether any is negative.

    They go to the rows FOUND and TREND of `found`. A rate of 0 stands for one that is not known.
    """
    for s in range(tab[NS]):
        r[tab[RATE_AT] + s] = w[rate, s]
    execute(code, tab[CONDITION], tab[OUTPUT], r)
    for j in range(tab[M]):
        margin, trend = 1.0, 0.0
        if mode[j] == 0:
            margin = hold_margin(tab, r, j)
        elif mode[j] != OFF:
            margin = mode[j] * relative_velocity(tab, r, j, w, x)
            trend = mode[j] * slide_rate(tab, r, j, w, rate)
        w[FOUND + found, j], w[TREND + found, j] = margin, trend
    first = tab[M]
    for q in range(tab[Q]):
        w[FOUND + found, first + q] = memory_margin(tab, r, q, mode[first + q], w, rate)
        w[TREND + found, first + q] = memory_trend(tab, r, q, mode[first + q], w, rate)
    first += tab[Q]
    for k in range(tab[NW]):
        side = mode[first + k] if abs(mode[first + k]) == 1 else 0
        w[FOUND + found, first + k] = side * r[tab[tab[WATCHES] + k]] if side != 0 else 1.0
        w[TREND + found, first + k] = side * r[tab[tab[TRENDS] + k]]
    first += tab[NW]
    for i in range(tab[NF]):
        condition = tab[tab[CONDITIONS] + i]
        margin, trend = 1.0, 0.0
        if condition >= 0 and r[tab[FLAG] + i] == 0.0:
            margin = -r[condition] if r[condition] != 0.0 else JUST_MET
            trend = -r[tab[tab[TRENDS] + tab[NW] + i]]
        w[FOUND + found, first + i], w[TREND + found, first + i] = margin, trend
    hit = False
    for i in range(first + tab[NF]):
        hit = hit or w[FOUND + found, i] < 0.0
    return hit


def memory_trend(tab: Ints1, r: Floats1, q: int, mode: int, w: Floats2, rate: int) -> float:
    """Rate of a memory's margin; while it follows a limit by the derivatives at the step's start."""
    trend = 0.0
    if mode == 0:
        value, lower, upper = r[tab[MEMORY] + q], tab[LOWER] + q, tab[UPPER] + q
        if value - r[tab[lower]] < r[tab[upper]] - value:
            trend = -dot(tab, r, tab[LOWER_SLOPE] + q * tab[NS], w, rate)
        else:
            trend = dot(tab, r, tab[UPPER_SLOPE] + q * tab[NS], w, rate)
    elif mode == 1:
        trend = bend(tab, r, tab[LOWER_SLOPE] + q * tab[NS], w, rate)
    elif mode == 2:
        trend = -bend(tab, r, tab[UPPER_SLOPE] + q * tab[NS], w, rate)
    return trend


def bend(tab: Ints1, r: Floats1, place: int, w: Floats2, rate: int) -> float:
    """Second derivative by time of a limit of which the registers listed from `place` on tell the slopes."""
    total = 0.0
    for s in range(tab[NS]):
        slope = r[tab[place + s]]
        if slope != 0.0:
            change = w[JAC + s, tab[NS]]
            for c in range(tab[NS]):
                change += w[JAC + s, c] * w[rate, c]
            total += slope * change
    return total


def copy(w: Floats2, to: int, found: int) -> None:
    """Note margins and their rates for another point."""
    for i in range(w.shape[1]):
        w[FOUND + to, i] = w[FOUND + found, i]
        w[TREND + to, i] = w[TREND + found, i]


def dip(w: Floats2, h: float, i: int) -> float:
    """Share of a step at which margin i, positive at both ends, may have been negative, or 0.

    Where its tangents at the ends cross below 0, the cubic through its values and rates tells where it is lowest.
    """
    before, after = w[FOUND + BEFORE, i], w[FOUND + HIGH, i]
    falls, rises = -h * w[TREND + BEFORE, i], h * w[TREND + HIGH, i]
    share = 0.0
    if falls > 0.0 and rises > 0.0 and before > 0.0 and after > 0.0:
        meet = (before - after + rises) / (falls + rises)
        if 0.0 < meet < 1.0 and before < falls * meet:
            bend = 3.0 * (after - before) + 2.0 * falls - rises
            root = bend * bend + 3.0 * falls * (rises - falls - 2.0 * (after - before))
            lowest = falls / (bend + np.sqrt(root)) if root > 0.0 else meet
            share = lowest if 0.0 < lowest < 1.0 else meet
    return share


def apply_events(tab: Ints1, r: Floats1, mode: Ints1, w: Floats2, found: int, at: float) -> None:
    """Change the modes of what has a negative margin, at the point just evaluated at time `at`."""
    for j in range(tab[M]):
        if w[FOUND + found, j] < 0.0 and mode[j] == 0:
            force = r[tab[FORCE_AT] + j]
            forward = force + r[tab[tab[FORWARD] + j]] < r[tab[tab[BACKWARD] + j]] - force
            mode[j] = 1 if forward else -1
        elif w[FOUND + found, j] < 0.0:
            mode[j] = 0
    for q in range(tab[Q]):
        if w[FOUND + found, tab[M] + q] < 0.0 and mode[tab[M] + q] == 0:
            low, high, value = r[tab[tab[LOWER] + q]], r[tab[tab[UPPER] + q]], r[tab[MEMORY] + q]
            r[tab[MEMORY] + q] = low if abs(low - value) < abs(high - value) else high
    set_flags(tab, r, at)
