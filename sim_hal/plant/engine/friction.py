"""Set-valued friction: what slides resists with its level, what sticks with whatever force holds it."""

from __future__ import annotations

from sim_hal.plant.engine.machine import (
    BACKWARD,
    FORCE_AT,
    FORWARD,
    NS,
    PER_FORCE,
    SLOTS,
    VELOCITY,
    VELOCITY_OFFSET,
    M,
    kept_at,
)
from sim_hal.plant.native import Floats1, Floats2, Ints1

BAND_TOLERANCE = 1e-9
"""Share of the band by which the holding force must leave it: keeps stick from flickering."""


def solve_small(w: Floats2, first: int, n: int) -> bool:
    """Solve a·x = b by elimination with pivoting, in place; False where a is singular.

    Row `first` + i of w has row i of a and then b_i, which becomes x_i.
    """
    for col in range(n):
        pivot = col
        for row in range(col + 1, n):
            if abs(w[first + row, col]) > abs(w[first + pivot, col]):
                pivot = row
        if w[first + pivot, col] == 0.0:
            return False
        for k in range(col, n + 1):
            w[first + col, k], w[first + pivot, k] = w[first + pivot, k], w[first + col, k]
        for row in range(col + 1, n):
            factor = w[first + row, col] / w[first + col, col]
            for k in range(col, n + 1):
                w[first + row, k] -= factor * w[first + col, k]
    for row in range(n - 1, -1, -1):
        for k in range(row + 1, n):
            w[first + row, n] -= w[first + row, k] * w[first + k, n]
        w[first + row, n] /= w[first + row, row]
    return True


def dot(tab: Ints1, r: Floats1, place: int, w: Floats2, row: int) -> float:
    """Sum over the states of the registers listed from `place` on times a row of w."""
    total = 0.0
    for s in range(tab[NS]):
        total += r[tab[place + s]] * w[row, s]
    return total


def grip(tab: Ints1, r: Floats1, i: int, j: int) -> float:
    """What one unit of element j's force adds to the rate of element i's relative velocity."""
    total = 0.0
    for s in range(tab[NS]):
        total += r[tab[tab[VELOCITY] + i * tab[NS] + s]] * r[tab[tab[PER_FORCE] + j * tab[NS] + s]]
    return total


def slide_rate(tab: Ints1, r: Floats1, j: int, w: Floats2, row: int) -> float:
    """Rate of element j's relative velocity, the rates being in a row of w."""
    return dot(tab, r, tab[VELOCITY] + j * tab[NS], w, row)


def relative_velocity(tab: Ints1, r: Floats1, j: int, w: Floats2, row: int) -> float:
    """Relative velocity of friction element j, the state being in a row of w."""
    return float(r[tab[tab[VELOCITY_OFFSET] + j]] + dot(tab, r, tab[VELOCITY] + j * tab[NS], w, row))


def add_force(tab: Ints1, r: Floats1, j: int, force: float, w: Floats2, row: int) -> None:
    """Add a force of friction element j to a row of rates."""
    for s in range(tab[NS]):
        w[row, s] += r[tab[tab[PER_FORCE] + j * tab[NS] + s]] * force


def only_state(tab: Ints1, r: Floats1, j: int) -> int:
    """The state that element j's velocity consists of, negative where there are several."""
    only = -1
    for s in range(tab[NS]):
        if r[tab[tab[VELOCITY] + j * tab[NS] + s]] != 0.0:
            only = s if only == -1 else -2
    return only


def grips(tab: Ints1, r: Floats1, mode: Ints1, w: Floats2) -> None:
    """Set up, in the room for scratch, the equations of the forces that keep the stuck elements still.

    The right sides are left at 0. Those of the others, and of a force without grip, are that it is 0.
    """
    first = kept_at(tab[NS], SLOTS)
    for i in range(tab[M]):
        held = mode[i] == 0 and grip(tab, r, i, i) != 0.0
        for j in range(tab[M]):
            both = held and mode[j] == 0
            w[first + i, j] = grip(tab, r, i, j) if both else 1.0 if i == j else 0.0
        w[first + i, tab[M]] = 0.0


def hold(tab: Ints1, r: Floats1, mode: Ints1, w: Floats2, row: int) -> bool:
    """Find and apply the forces that keep the stuck elements still (0 where a force has no grip)."""
    grips(tab, r, mode, w)
    first = kept_at(tab[NS], SLOTS)
    for j in range(tab[M]):
        if mode[j] == 0 and grip(tab, r, j, j) != 0.0:
            w[first + j, tab[M]] = -slide_rate(tab, r, j, w, row)
    if not solve_small(w, first, tab[M]):
        return False
    for j in range(tab[M]):
        if mode[j] == 0:
            r[tab[FORCE_AT] + j] = w[first + j, tab[M]]
            add_force(tab, r, j, w[first + j, tab[M]], w, row)
    for j in range(
        tab[M]
    ):  # a held state's rate is exactly 0, where the sum of forces leaves a rounding error
        only = only_state(tab, r, j) if mode[j] == 0 and grip(tab, r, j, j) != 0.0 else -1
        if only >= 0:
            w[row, only] = 0.0
    return True


def band(tab: Ints1, r: Floats1, j: int) -> float:
    """By how much element j's force may miss its band before that counts."""
    return float(BAND_TOLERANCE * (abs(r[tab[tab[FORWARD] + j]]) + abs(r[tab[tab[BACKWARD] + j]])))


def hold_margin(tab: Ints1, r: Floats1, j: int) -> float:
    """How far the holding force of stuck element j is from the band's end; negative outside."""
    force = r[tab[FORCE_AT] + j]
    spare = min(force + r[tab[tab[FORWARD] + j]], r[tab[tab[BACKWARD] + j]] - force)
    return float(spare + band(tab, r, j))


def release(tab: Ints1, r: Floats1, mode: Ints1, w: Floats2, row: int) -> bool:
    """Decide which stuck elements start to slide, all together (projected Gauss–Seidel on their bands)."""
    for j in range(tab[M]):  # back to the rates without the stuck elements' forces
        if mode[j] == 0:
            add_force(tab, r, j, -r[tab[FORCE_AT] + j], w, row)
            r[tab[FORCE_AT] + j] = 0.0
    for _ in range(200):
        settled = True
        for j in range(tab[M]):
            if mode[j] == 0 and grip(tab, r, j, j) != 0.0:
                force = r[tab[FORCE_AT] + j]
                target = force - slide_rate(tab, r, j, w, row) / grip(tab, r, j, j)
                target = min(max(target, -r[tab[tab[FORWARD] + j]]), r[tab[tab[BACKWARD] + j]])
                add_force(tab, r, j, target - force, w, row)
                r[tab[FORCE_AT] + j] = target
                settled = settled and abs(target - force) <= 1e-3 * band(tab, r, j)
        if settled:
            break
    released = False
    for j in range(tab[M]):
        if mode[j] == 0 and grip(tab, r, j, j) != 0.0:
            pull = slide_rate(tab, r, j, w, row) / grip(tab, r, j, j)
            if abs(pull) > band(tab, r, j):
                mode[j] = 1 if pull > 0.0 else -1
                released = True
    return released
