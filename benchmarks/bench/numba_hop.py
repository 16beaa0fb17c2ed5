"""The nominal hop by a Runge–Kutta of fixed step in Numba: what one would write by hand for speed."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from benchmarks.hop_peers import Rig

LOADING, UNLOADING, FLIGHT = 0, 1, 2


def numba_hop(rig: Rig, step_s: float) -> Callable[[], float]:
    """A job that gives the rise [m]; it is compiled by now. Raises `ImportError` without Numba."""
    rise = _compiled()
    values = np.array([rig.m_b, rig.m_l, rig.g, rig.k, rig.c, rig.k_l, rig.chi])
    start = rig.start()
    rise(values, start, step_s)
    return lambda: float(rise(values, start, step_s))


@cache
def _compiled() -> Any:
    """The rise of a hop in machine code."""
    from numba import njit

    slope: Any = njit(_slope)

    def rise(p: Any, start: Any, step: float) -> float:
        m_b, m_l, k_l, chi = p[0], p[1], p[5], p[6]
        x, y = start.copy(), np.empty(4)
        k1, k2, k3, k4 = np.empty(4), np.empty(4), np.empty(4), np.empty(4)
        before = (m_b * x[2] + m_l * x[0]) / (m_b + m_l)
        piece, deepest, stiffness, free = LOADING, -x[0], k_l, 0.0
        while True:
            slope(x, p, stiffness, free, k1)
            for n in range(4):
                y[n] = x[n] + 0.5 * step * k1[n]
            slope(y, p, stiffness, free, k2)
            for n in range(4):
                y[n] = x[n] + 0.5 * step * k2[n]
            slope(y, p, stiffness, free, k3)
            for n in range(4):
                y[n] = x[n] + step * k3[n]
            slope(y, p, stiffness, free, k4)
            for n in range(4):
                x[n] += step / 6.0 * (k1[n] + 2.0 * k2[n] + 2.0 * k3[n] + k4[n])
            if piece == LOADING:
                deepest = max(deepest, -x[0])
                if x[1] > 0.0:
                    piece, stiffness, free = UNLOADING, k_l / (1.0 - chi), -chi * deepest
            elif piece == UNLOADING:
                if x[0] > -chi * deepest:
                    piece, stiffness, free = FLIGHT, 0.0, 0.0
                elif x[0] < -deepest:
                    piece, stiffness, free = LOADING, k_l, 0.0
            elif x[0] < -chi * deepest:
                piece, stiffness, free = UNLOADING, k_l / (1.0 - chi), -chi * deepest
            if m_b * x[3] + m_l * x[1] <= 0.0:
                return float((m_b * x[2] + m_l * x[0]) / (m_b + m_l) - before)

    return njit(rise)


def _slope(x: Any, p: Any, stiffness: float, free: float, out: Any) -> None:
    force = p[3] * (x[0] - x[2]) + p[4] * (x[1] - x[3])  # of the spring, on the body
    out[0], out[2] = x[1], x[3]
    out[1] = (stiffness * (free - x[0]) - force) / p[1] - p[2]
    out[3] = force / p[0] - p[2]
