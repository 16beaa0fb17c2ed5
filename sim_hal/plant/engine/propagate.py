"""How a step's increment u follows u' = L u + F(t): exactly, for a polynomial F and whatever eigenvalues L has.

F = F0 + F1 θ + F2 θ² + F3 θ³ with θ running from 0 to 1 over the step. Where L does little within a step the
increment is its Taylor series, which also tells it everywhere within the step. Where L is stiff the increment is
h Σ k! φ_{k+1}(hL) F_k with the φ functions of the matrix, computed by scaling and doubling, and kept.

Hochbruck and Ostermann, Exponential integrators, Acta Numerica 19 (2010) 209; the doubling of φ functions: Skaflestad
and Wright, Appl. Numer. Math. 59 (2009) 783.
"""

from __future__ import annotations

import numpy as np

from sim_hal.plant.engine.machine import (
    ABSOLUTE,
    CLOCK,
    FORCE,
    JAC,
    KEPT,
    LONGEST,
    NS,
    RELATIVE,
    SLOTS,
    SPARE,
    TERMS,
    kept_at,
    span_at,
)
from sim_hal.plant.native import Floats2, Ints1

SERIES_REACH = 8.0
"""Size of hL up to which the series is taken."""
ALIKE, ROUGHLY = 0.3, 0.5
"""Shares up to which a propagator's matrix is as good as the present one, and up to which it may serve."""
PHI_TERMS = 13
PHI_REACH = 0.5


def strength(w: Floats2, n: int) -> tuple[float, float]:
    """Bounds, whatever the units of the states, on the matrix and on how fast it makes the states oscillate, 1/s."""
    diagonal = coupled = swing = 0.0
    for i in range(n):
        diagonal = max(diagonal, abs(w[JAC + i, i]))
        for j in range(i):
            loop = w[JAC + i, j] * w[JAC + j, i]
            coupled += abs(loop)
            swing += max(0.0, -loop - 0.25 * (w[JAC + i, i] - w[JAC + j, j]) ** 2)
    return diagonal + np.sqrt(coupled), np.sqrt(swing)


def series(tab: Ints1, mode: Ints1, w: Floats2, h: float) -> int:
    """Taylor coefficients of the increment by θ, in rows from TERMS on; how many, or 0 if they do not end."""
    n, spans = tab[NS], span_at(tab)
    cut = max(1e-16, 1e-2 * w[CLOCK, RELATIVE])
    for s in range(n):
        w[TERMS, s] = 0.0
        w[TERMS + 1, s] = h * w[FORCE, s]
    for k in range(1, 4):
        for s in range(n):
            total = w[FORCE + k, s]
            for c in range(mode[spans + s], mode[spans + n + s]):
                total += w[JAC + s, c] * w[TERMS + k, c]
            w[TERMS + k + 1, s] = total * (h / (k + 1))
    for s in range(n):
        largest = max(abs(w[TERMS + 1, s]), abs(w[TERMS + 2, s]), abs(w[TERMS + 3, s]))
        w[SPARE, s] = cut * largest + 1e-4 * w[CLOCK, ABSOLUTE]
    quiet = 0
    for k in range(4, LONGEST - 1):
        share, spare = h / (k + 1), 1.0
        for s in range(n):
            total = 0.0
            for c in range(mode[spans + s], mode[spans + n + s]):
                total += w[JAC + s, c] * w[TERMS + k, c]
            total *= share
            w[TERMS + k + 1, s] = total
            spare = min(spare, w[SPARE, s] - abs(total))
        quiet = quiet + 1 if spare >= 0.0 else 0
        if quiet == 2:
            return k + 2
    return 0


def along(tab: Ints1, w: Floats2, count: int, share: float, to: int) -> None:
    """Increment at a share of the step, to a row."""
    for s in range(tab[NS]):
        total = 0.0
        for k in range(count - 1, 0, -1):
            total = (total + w[TERMS + k, s]) * share
        w[to, s] = total


def weigh(tab: Ints1, w: Floats2, place: int, first: int, count: int, to: int) -> None:
    """Sum of the kept weights (from row `place` on) times `count` rows from `first` on, to a row."""
    n = tab[NS]
    for s in range(n):
        total = 0.0
        for k in range(count):
            for c in range(n):
                total += w[place + k * n + s, c] * w[first + k, c]
        w[to, s] = total


def same(w: Floats2, n: int, matrix: int, h: float, share: float) -> bool:
    """Whether a kept matrix is the derivatives' up to a share: only loops of states bear upon how fast things go."""
    fits = True
    for i in range(n):
        fits = fits and abs(w[JAC + i, i] - w[matrix + i, i]) * h <= share
        for j in range(n):
            change = abs(w[JAC + i, j] - w[matrix + i, j])
            fits = fits and change * max(abs(w[JAC + j, i]), abs(w[matrix + j, i])) * h * h <= share * share
    return fits


def find(tab: Ints1, w: Floats2, h: float, share: float) -> int:
    """First row of a kept propagator for steps of size h (up to the rounding of times), its matrix right to a share.

    It is made where there is none. Row KEPT has how many there are, the last one made, and their step sizes.
    """
    n = tab[NS]
    slot = -1
    for back in range(int(w[KEPT, 0])):
        known = (int(w[KEPT, 1]) + SLOTS - back) % SLOTS
        if abs(w[KEPT, 2 + known] - h) <= 1e-10 * h:
            if same(w, n, kept_at(n, known), h, share):
                return kept_at(n, known)
            slot = known
    if slot < 0:
        slot = (int(w[KEPT, 1]) + 1) % SLOTS
        w[KEPT, 0] = min(w[KEPT, 0] + 1.0, SLOTS)
        w[KEPT, 1] = slot
        w[KEPT, 2 + slot] = h
    fill(w, n, kept_at(n, slot), h)
    return kept_at(n, slot)


def balance(w: Floats2, n: int, a: int, scale: int) -> None:
    """Make rows and columns of matrix `a` alike in size by powers of 2, a_ij · scale_j / scale_i (Osborne)."""
    for i in range(n):
        w[scale, i] = 1.0
    for _ in range(8):
        settled = True
        for i in range(n):
            row = column = 0.0
            for j in range(n):
                if j != i:
                    row += abs(w[a + i, j])
                    column += abs(w[a + j, i])
            factor = 1.0
            if row > 0.0 and column > 0.0:
                while column * factor * factor * 2.0 < row:
                    factor *= 2.0
                while column * factor * factor > row * 2.0:
                    factor *= 0.5
            if factor != 1.0:
                settled = False
                w[scale, i] *= factor
                for j in range(n):
                    w[a + j, i] *= factor
                for j in range(n):
                    w[a + i, j] /= factor
        if settled:
            break


def multiply(w: Floats2, n: int, a: int, b: int, out: int) -> None:
    """Product of the matrices at rows `a` and `b`, to row `out`."""
    for i in range(n):
        for j in range(n):
            w[out + i, j] = 0.0
        for k in range(n):
            factor = w[a + i, k]
            if factor != 0.0:
                for j in range(n):
                    w[out + i, j] += factor * w[b + k, j]


def first_phis(w: Floats2, n: int, z: int, phi: int, work: int) -> None:
    """φ0 … φ4, one after the other from row `phi` on, of a small matrix `z`: φ4 by its series, then the rest."""
    last = phi + 4 * n
    factor = 1.0  # 1 / (PHI_TERMS + 4)!
    for k in range(2, PHI_TERMS + 5):
        factor /= k
    for i in range(n):
        for j in range(n):
            w[last + i, j] = factor if i == j else 0.0
    for k in range(PHI_TERMS + 4, 4, -1):
        factor *= k
        multiply(w, n, z, last, work)
        for i in range(n):
            for j in range(n):
                w[last + i, j] = w[work + i, j] + factor if i == j else w[work + i, j]
    for k in range(3, -1, -1):
        multiply(w, n, z, phi + (k + 1) * n, phi + k * n)
        factor *= k + 1
        for i in range(n):
            w[phi + k * n + i, i] += factor


def double(w: Floats2, n: int, phi: int, work: int) -> None:
    """φ0 … φ4 of twice the matrix, in their place."""
    half = 1.0 / 16.0  # to the power k
    for k in range(4, -1, -1):
        multiply(w, n, phi, phi + k * n, work)
        factor = 1.0
        for j in range(k, 0, -1):
            factor /= max(k - j, 1)
            for i in range(n):
                for c in range(n):
                    w[work + i, c] += factor * w[phi + j * n + i, c]
        for i in range(n):
            for c in range(n):
                w[phi + k * n + i, c] = w[work + i, c] * half
        half *= 2.0


def fill(w: Floats2, n: int, place: int, h: float) -> None:
    """Make a propagator of the present derivatives for steps of size h."""
    z = kept_at(n, SLOTS)
    work, phi, scale = z + n, z + 2 * n, z + 7 * n
    for i in range(n):
        for j in range(n):
            w[place + i, j] = w[JAC + i, j]
            w[z + i, j] = h * w[JAC + i, j]
    balance(w, n, z, scale)
    size = 0.0
    for i in range(n):
        row = 0.0
        for j in range(n):
            row += abs(w[z + i, j])
        size = max(size, row)
    doublings, share = 1, 0.5
    while size * share > PHI_REACH and doublings < 60:
        doublings += 1
        share *= 0.5
    for i in range(n):
        for j in range(n):
            w[z + i, j] *= share
    first_phis(w, n, z, phi, work)
    for level in range(doublings + 1):
        left = doublings - level  # k! h φ_{k+1} θ^k, scaled back: for half a step and for all of it
        if left <= 1:
            part = 0.5 if left == 1 else 1.0
            factor = h * part
            for k in range(4):
                for i in range(n):
                    for j in range(n):
                        at = place + n * (1 + 4 * left + k) + i
                        w[at, j] = factor * w[phi + (k + 1) * n + i, j] * w[scale, i] / w[scale, j]
                factor *= (k + 1) * part
        if left > 0:
            double(w, n, phi, work)
