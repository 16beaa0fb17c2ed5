"""Set-valued friction: what slides resists with its level, what sticks with whatever force holds it."""

from __future__ import annotations

import numpy as np

from sim_hal.plant.engine.machine import (
    BACKWARD,
    FORCE_AT,
    FORWARD,
    NS,
    PER_FORCE,
    VELOCITY,
    VELOCITY_OFFSET,
    M,
)
from sim_hal.plant.jit import compiled
from sim_hal.plant.program import Floats, Ints

BAND_TOLERANCE = 1e-9
"""Share of the band by which the holding force must leave it: keeps stick from flickering."""


@compiled
def solve_small(a: Floats, b: Floats, n: int) -> bool:
    """Solve a·x = b in place (x in b) by elimination with pivoting; False where a is singular."""
    for col in range(n):
        pivot = col
        for row in range(col + 1, n):
            if abs(a[row, col]) > abs(a[pivot, col]):
                pivot = row
        if a[pivot, col] == 0.0:
            return False
        for k in range(n):
            a[col, k], a[pivot, k] = a[pivot, k], a[col, k]
        b[col], b[pivot] = b[pivot], b[col]
        for row in range(col + 1, n):
            factor = a[row, col] / a[col, col]
            for k in range(col, n):
                a[row, k] -= factor * a[col, k]
            b[row] -= factor * b[col]
    for row in range(n - 1, -1, -1):
        for k in range(row + 1, n):
            b[row] -= a[row, k] * b[k]
        b[row] /= a[row, row]
    return True


@compiled
def dot(tab: Ints, r: Floats, place: int, w: Floats, row: int) -> float:
    """Sum over the states of the registers listed from `place` on times a row of w."""
    total = 0.0
    for s in range(tab[NS]):
        total += r[tab[place + s]] * w[row, s]
    return total


@compiled
def grip(tab: Ints, r: Floats, i: int, j: int) -> float:
    """What one unit of element j's force adds to the rate of element i's relative velocity."""
    total = 0.0
    for s in range(tab[NS]):
        total += r[tab[tab[VELOCITY] + i * tab[NS] + s]] * r[tab[tab[PER_FORCE] + j * tab[NS] + s]]
    return total


@compiled
def slide_rate(tab: Ints, r: Floats, j: int, w: Floats, row: int) -> float:
    """Rate of element j's relative velocity, the rates being in a row of w."""
    return dot(tab, r, tab[VELOCITY] + j * tab[NS], w, row)


@compiled
def relative_velocity(tab: Ints, r: Floats, j: int, w: Floats, row: int) -> float:
    """Relative velocity of friction element j, the state being in a row of w."""
    return float(r[tab[tab[VELOCITY_OFFSET] + j]] + dot(tab, r, tab[VELOCITY] + j * tab[NS], w, row))


@compiled
def add_force(tab: Ints, r: Floats, j: int, force: float, w: Floats, row: int) -> None:
    """Add a force of friction element j to a row of rates."""
    for s in range(tab[NS]):
        w[row, s] += r[tab[tab[PER_FORCE] + j * tab[NS] + s]] * force


@compiled
def only_state(tab: Ints, r: Floats, j: int) -> int:
    """The state that element j's velocity consists of, negative where there are several."""
    only = -1
    for s in range(tab[NS]):
        if r[tab[tab[VELOCITY] + j * tab[NS] + s]] != 0.0:
            only = s if only == -1 else -2
    return only


@compiled
def hold(tab: Ints, r: Floats, mode: Ints, w: Floats, row: int) -> bool:
    """Find and apply the forces that keep the stuck elements still (0 where a force has no grip)."""
    which = np.empty(tab[M], np.int64)
    n = 0
    for j in range(tab[M]):
        if mode[j] == 0:
            r[tab[FORCE_AT] + j] = 0.0
            if grip(tab, r, j, j) != 0.0:
                which[n] = j
                n += 1
    a, b = np.empty((n, n)), np.empty(n)
    for i in range(n):
        b[i] = -slide_rate(tab, r, which[i], w, row)
        for k in range(n):
            a[i, k] = grip(tab, r, which[i], which[k])
    if not solve_small(a, b, n):
        return False
    for i in range(n):
        r[tab[FORCE_AT] + which[i]] = b[i]
        add_force(tab, r, which[i], b[i], w, row)
    for i in range(n):  # a held state's rate is exactly 0, where the sum of forces leaves a rounding error
        only = only_state(tab, r, which[i])
        if only >= 0:
            w[row, only] = 0.0
    return True


@compiled
def band(tab: Ints, r: Floats, j: int) -> float:
    """By how much element j's force may miss its band before that counts."""
    return float(BAND_TOLERANCE * (abs(r[tab[tab[FORWARD] + j]]) + abs(r[tab[tab[BACKWARD] + j]])))


@compiled
def hold_margin(tab: Ints, r: Floats, j: int) -> float:
    """How far the holding force of stuck element j is from the band's end; negative outside."""
    force = r[tab[FORCE_AT] + j]
    spare = min(force + r[tab[tab[FORWARD] + j]], r[tab[tab[BACKWARD] + j]] - force)
    return float(spare + band(tab, r, j))


@compiled
def release(tab: Ints, r: Floats, mode: Ints, w: Floats, row: int) -> bool:
    """Decide which stuck elements start to slide, all together (projected Gauss–Seidel on their bands)."""
    for j in range(tab[M]):  # back to the rates without the stuck elements' forces
        if mode[j] == 0:
            add_force(tab, r, j, -r[tab[FORCE_AT] + j], w, row)
            r[tab[FORCE_AT] + j] = 0.0
    for _ in range(200):
        for j in range(tab[M]):
            if mode[j] == 0 and grip(tab, r, j, j) != 0.0:
                force = r[tab[FORCE_AT] + j]
                target = force - slide_rate(tab, r, j, w, row) / grip(tab, r, j, j)
                target = min(max(target, -r[tab[tab[FORWARD] + j]]), r[tab[tab[BACKWARD] + j]])
                add_force(tab, r, j, target - force, w, row)
                r[tab[FORCE_AT] + j] = target
    released = False
    for j in range(tab[M]):
        if mode[j] == 0 and grip(tab, r, j, j) != 0.0:
            pull = slide_rate(tab, r, j, w, row) / grip(tab, r, j, j)
            if abs(pull) > band(tab, r, j):
                mode[j] = 1 if pull > 0.0 else -1
                released = True
    return released
