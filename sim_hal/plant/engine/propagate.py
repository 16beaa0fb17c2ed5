"""How a step's increment u follows u' = L u + F(t): exactly, for a polynomial F and whatever eigenvalues L has.

F = F0 + F1 θ + F2 θ² + F3 θ³ with θ running from 0 to 1 over the step. Where L does little within a step the
increment is its Taylor series, which also tells it everywhere within the step. Where L is stiff the increment is
h Σ k! φ_{k+1}(hL) F_k with the φ functions of the matrix, computed by scaling and doubling, and kept.

Hochbruck and Ostermann, Exponential integrators, Acta Numerica 19 (2010) 209; the doubling of φ functions: Skaflestad
and Wright, Appl. Numer. Math. 59 (2009) 783.
"""

from __future__ import annotations

import numpy as np

from sim_hal.plant.engine.machine import FORCE, JAC, KEPT, LONGEST, NS, SLOTS, TERMS
from sim_hal.plant.jit import compiled
from sim_hal.plant.program import Floats, Ints

SERIES_REACH = 2.0
"""Size of hL up to which the series is taken."""
PHI_TERMS = 13
PHI_REACH = 0.5


@compiled
def kept_at(ns: int, slot: int) -> int:
    """First row of a kept propagator: its matrix, then the weights of F0 … F3 for a whole step and for half of it."""
    return int(JAC + ns * (1 + 9 * slot))


@compiled
def strength(w: Floats, n: int) -> tuple[float, float]:
    """Bounds, whatever the units of the states, on the matrix and on how fast it makes the states oscillate, 1/s."""
    diagonal = coupled = swing = 0.0
    for i in range(n):
        diagonal = max(diagonal, abs(w[JAC + i, i]))
        for j in range(i):
            loop = w[JAC + i, j] * w[JAC + j, i]
            coupled += abs(loop)
            swing += max(0.0, -loop - 0.25 * (w[JAC + i, i] - w[JAC + j, j]) ** 2)
    return diagonal + np.sqrt(coupled), np.sqrt(swing)


@compiled
def series(tab: Ints, w: Floats, h: float) -> int:
    """Taylor coefficients of the increment by θ, in rows from TERMS on; how many, or 0 if they do not end."""
    n = tab[NS]
    quiet = 0
    for s in range(n):
        w[TERMS, s] = 0.0
        w[TERMS + 1, s] = h * w[FORCE, s]
    for k in range(1, LONGEST - 1):
        small = True
        for s in range(n):
            total = w[FORCE + k, s] if k < 4 else 0.0
            for c in range(n):
                total += w[JAC + s, c] * w[TERMS + k, c]
            total *= h / (k + 1)
            w[TERMS + k + 1, s] = total
            largest = max(abs(w[TERMS + 1, s]), abs(w[TERMS + 2, s]), abs(w[TERMS + 3, s]))
            small = small and k > 3 and abs(total) <= 1e-16 * largest
        quiet = quiet + 1 if small else 0
        if quiet == 2:
            return k + 2
    return 0


@compiled
def along(tab: Ints, w: Floats, count: int, share: float, to: int) -> None:
    """Increment at a share of the step, to a row."""
    for s in range(tab[NS]):
        total = 0.0
        for k in range(count - 1, 0, -1):
            total = (total + w[TERMS + k, s]) * share
        w[to, s] = total


@compiled
def weigh(tab: Ints, w: Floats, place: int, first: int, count: int, to: int) -> None:
    """Sum of the kept weights (from row `place` on) times `count` rows from `first` on, to a row."""
    n = tab[NS]
    for s in range(n):
        total = 0.0
        for k in range(count):
            for c in range(n):
                total += w[place + k * n + s, c] * w[first + k, c]
        w[to, s] = total


@compiled
def same(w: Floats, n: int, matrix: int, h: float) -> bool:
    """Whether a kept matrix serves for the derivatives: only loops of states bear upon how fast things go."""
    fits = True
    for i in range(n):
        fits = fits and abs(w[JAC + i, i] - w[matrix + i, i]) * h <= 0.02
        for j in range(n):
            change = abs(w[JAC + i, j] - w[matrix + i, j])
            fits = fits and change * max(abs(w[JAC + j, i]), abs(w[matrix + j, i])) * h * h <= 4e-4
    return fits


@compiled
def find(tab: Ints, w: Floats, h: float) -> int:
    """First row of a kept propagator that serves for steps of size h (up to the rounding of times).

    It is made where there is none. Row KEPT has how many there are, the last one made, and their step sizes.
    """
    n = tab[NS]
    for back in range(int(w[KEPT, 0])):
        slot = (int(w[KEPT, 1]) - back) % SLOTS
        if abs(w[KEPT, 2 + slot] - h) <= 1e-10 * h and same(w, n, kept_at(n, slot), h):
            return kept_at(n, slot)
    slot = (int(w[KEPT, 1]) + 1) % SLOTS
    w[KEPT, 0] = min(w[KEPT, 0] + 1.0, SLOTS)
    w[KEPT, 1] = slot
    w[KEPT, 2 + slot] = h
    fill(w, n, kept_at(n, slot), h)
    return kept_at(n, slot)


@compiled
def balance(a: Floats, scale: Floats) -> None:
    """Make rows and columns of `a` alike in size by powers of 2, in place: a_ij · scale_j / scale_i (Osborne)."""
    n = len(scale)
    for i in range(n):
        scale[i] = 1.0
    for _ in range(8):
        for i in range(n):
            row = column = 0.0
            for j in range(n):
                if j != i:
                    row += abs(a[i, j])
                    column += abs(a[j, i])
            if row == 0.0 or column == 0.0:
                continue
            factor = 2.0 ** np.floor(0.5 + 0.5 * np.log2(row / column))
            scale[i] *= factor
            for j in range(n):
                a[j, i] *= factor
            for j in range(n):
                a[i, j] /= factor


@compiled
def multiply(a: Floats, b: Floats, out: Floats) -> None:
    """out = a b."""
    n = a.shape[0]
    for i in range(n):
        for j in range(n):
            total = 0.0
            for k in range(n):
                total += a[i, k] * b[k, j]
            out[i, j] = total


@compiled
def first_phis(z: Floats, phi: Floats, work: Floats) -> None:
    """φ0 … φ4 of a small matrix: φ4 by its series, the others from it."""
    n = z.shape[0]
    factor = 1.0  # 1 / (PHI_TERMS + 4)!
    for k in range(2, PHI_TERMS + 5):
        factor /= k
    for i in range(n):
        for j in range(n):
            phi[4, i, j] = factor if i == j else 0.0
    for k in range(PHI_TERMS + 4, 4, -1):
        factor *= k
        multiply(z, phi[4], work)
        for i in range(n):
            for j in range(n):
                phi[4, i, j] = work[i, j] + factor if i == j else work[i, j]
    for k in range(3, -1, -1):
        multiply(z, phi[k + 1], phi[k])
        factor *= k + 1
        for i in range(n):
            phi[k, i, i] += factor


@compiled
def double(phi: Floats, work: Floats) -> None:
    """φ0 … φ4 of twice the matrix."""
    n = work.shape[0]
    for k in range(4, -1, -1):
        multiply(phi[0], phi[k], work)
        factor = 1.0
        for j in range(k, 0, -1):
            factor /= max(k - j, 1)
            for i in range(n):
                for c in range(n):
                    work[i, c] += factor * phi[j, i, c]
        for i in range(n):
            for c in range(n):
                phi[k, i, c] = work[i, c] * 0.5**k


@compiled
def fill(w: Floats, n: int, place: int, h: float) -> None:
    """Make a propagator of the present derivatives for steps of size h."""
    z, scale, work = np.empty((n, n)), np.empty(n), np.empty((n, n))
    for i in range(n):
        for j in range(n):
            w[place + i, j] = w[JAC + i, j]
            z[i, j] = h * w[JAC + i, j]
    balance(z, scale)
    size = 0.0
    for i in range(n):
        row = 0.0
        for j in range(n):
            row += abs(z[i, j])
        size = max(size, row)
    doublings = 1
    while size > PHI_REACH * 2.0**doublings and doublings < 60:
        doublings += 1
    for i in range(n):
        for j in range(n):
            z[i, j] *= 0.5**doublings
    phi = np.empty((5, n, n))
    first_phis(z, phi, work)
    for level in range(doublings + 1):
        left = doublings - level  # k! h φ_{k+1} θ^k, scaled back: for half a step and for all of it
        if left <= 1:
            factor = h * 0.5**left
            for k in range(4):
                for i in range(n):
                    for j in range(n):
                        at = place + n * (1 + 4 * left + k) + i
                        w[at, j] = factor * phi[k + 1, i, j] * scale[i] / scale[j]
                factor *= (k + 1) * 0.5**left
        if left > 0:
            double(phi, work)
