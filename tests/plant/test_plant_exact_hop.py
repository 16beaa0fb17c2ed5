"""The two-mass hop against its exact solution, piece by piece, by matrix exponentials: no engine involved."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from plant_helpers import hop_run, shipped, states
from scipy.optimize import brentq

from sim_hal.plant.simulate import compile_plant

Floats = NDArray[np.float64]
LOOK_S = 2e-4
"""Time between two looks for the end of a piece; the pieces of these hops last longer."""


def expm(matrix: Floats) -> Floats:
    """Matrix exponential by Taylor's series of a fraction, squared back; small matrices want no library's threads."""
    halvings = max(0, int(np.ceil(np.log2(max(np.abs(matrix).sum(axis=1).max(), 1e-30)))) + 2)
    small = matrix / 2.0**halvings
    total = term = np.eye(len(matrix))
    for n in range(1, 16):
        term = term @ small / n
        total = total + term
    for _ in range(halvings):
        total = total @ total
    return np.asarray(total)


@dataclass(frozen=True)
class Rig:
    """Parameters of the hop, and its compression at the start."""

    m_b: float
    m_l: float
    g: float
    k: float
    c: float
    k_l: float
    chi: float
    s: float

    def system(self, stiffness: float, push: float) -> Floats:
        """Rates of (z_l, v_l, z_b, v_b, 1) while the ground gives push − stiffness · z_l."""
        spring, damper = self.k * np.array([1, 0, -1, 0, 0]), self.c * np.array([0, 1, 0, -1, 0])
        inner = spring + damper
        ground = np.array([-stiffness, 0, 0, 0, push])
        weight = np.array([0, 0, 0, 0, self.g])
        return np.array(
            [
                [0, 1, 0, 0, 0],
                (ground - inner) / self.m_l - weight,
                [0, 0, 0, 1, 0],
                inner / self.m_b - weight,
                np.zeros(5),
            ]
        )


class ExactHop:
    """States at given times after the opening, from rest under the full weight."""

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        rest = (rig.m_b + rig.m_l) * rig.g / rig.k_l
        self.deepest = rest
        self.x = np.array([-rest, 0.0, -rest - rig.m_b * rig.g / rig.k - rig.s, 0.0, 1.0])
        self.piece = "loading"
        self.since = 0.0

    def force_law(self) -> tuple[float, float]:
        rig = self.rig
        if self.piece == "loading":
            return rig.k_l, 0.0
        if self.piece == "unloading":
            steep = rig.k_l / (1.0 - rig.chi)
            return steep, (rig.k_l - steep) * self.deepest
        return 0.0, 0.0

    def ends(self) -> list[tuple[str, Callable[[Floats], float]]]:
        """What may end the piece: what comes next, and a function that is negative until then."""
        residual = self.rig.chi * self.deepest
        return {
            "loading": [("unloading", lambda x: x[1])],
            "unloading": [("flight", lambda x: x[0] + residual), ("loading", lambda x: -x[0] - self.deepest)],
            "flight": [("unloading", lambda x: -x[0] - residual)],
        }[self.piece]

    def at(self, times: Floats) -> Floats:
        """(n, 4) states at increasing times since the opening."""
        found = []
        end = self.first_end(times[-1])
        for time in times:
            while end is not None and self.since + end[0] < time:
                self.advance(*end)
                end = self.first_end(times[-1])
            found.append(self.later(time - self.since)[:4])
        return np.array(found)

    def later(self, by: float) -> Floats:
        return np.asarray(expm(by * self.rig.system(*self.force_law())) @ self.x)

    def first_end(self, until: float) -> tuple[float, str] | None:
        step = expm(LOOK_S * self.rig.system(*self.force_law()))
        x, at = self.x, 0.0
        while (span := min(LOOK_S, until - self.since - at)) > 0.0:
            new = step @ x if span == LOOK_S else self.later(at + span)
            for piece, margin in self.ends():
                if margin(new) > 0.0 and not (at == 0.0 and margin(self.later(1e-9)) > 0.0):
                    when = brentq(
                        lambda t, margin=margin: margin(self.later(t)),
                        at + 1e-9 * (at == 0.0),
                        at + span,
                        xtol=1e-15,
                    )
                    return float(when), piece
            x, at = new, at + span
        return None

    def advance(self, by: float, piece: str) -> None:
        self.x = self.later(by)
        self.since += by
        if piece == "unloading" and self.piece == "loading":
            self.deepest = -self.x[0]
        self.piece = piece


OPENING_S = 0.05 - 0.06 / 8.0 * np.log(1.0 - 0.9 * 8.0 / 12.0)


@settings(max_examples=12, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    k=st.floats(1.5e4, 5e4),
    c=st.floats(0.0, 60.0),
    k_l=st.floats(6e4, 4e5),
    chi=st.floats(0.1, 0.95),
    s=st.floats(0.02, 0.045),
    g=st.floats(1.6, 10.0),
)
@example(
    k=21951.0, c=31.5, k_l=223438.0, chi=0.1, s=0.025177929633737633, g=1.890625
)  # grazes the soil for 0.4 ms
def test_the_hop_is_its_exact_piecewise_solution(
    k: float, c: float, k_l: float, chi: float, s: float, g: float
) -> None:
    rig = Rig(m_b=5.393, m_l=2.139, g=g, k=k, c=c, k_l=k_l, chi=chi, s=s)
    changed = {"k": k, "c": c, "g": g, "quartz_sand.k_l": k_l, "quartz_sand.chi": chi}
    times = np.arange(OPENING_S, 0.35, 1e-3)
    run = hop_run(np.concatenate([[0.0], times]), compression=s)
    compiled = compile_plant(shipped("bb0b_hop").with_values(changed), relative_tolerance=1e-10)
    found = dict(zip(compiled.state_names, compiled.states(compiled.values, run).T, strict=True))
    wanted = ExactHop(rig).at(times - OPENING_S)
    for column, name in enumerate(("z_l", "v_l", "z_b", "v_b")):
        assert np.allclose(
            found[name][1:], wanted[:, column], rtol=0, atol=2e-7 * max(1.0, np.ptp(wanted[:, column]))
        )


def test_apex_and_sinkage_of_the_starting_values_to_eight_digits() -> None:
    plant = shipped("bb0b_hop").with_values({"quartz_sand.k_l": 9.5e4, "quartz_sand.chi": 0.9})
    rig = Rig(m_b=5.393, m_l=2.139, g=8.874, k=3.06e4, c=18.0, k_l=9.5e4, chi=0.9, s=0.036)
    times = np.arange(OPENING_S, 0.32, 2e-4)
    found = states(plant, hop_run(np.concatenate([[0.0], times])))
    exact = ExactHop(rig)
    wanted = exact.at(times - OPENING_S)
    centre = (5.393 * wanted[:, 2] + 2.139 * wanted[:, 0]) / 7.532
    ours = (5.393 * found["z_b"] + 2.139 * found["z_l"])[1:] / 7.532
    assert (ours - ours[0]).max() == pytest.approx((centre - centre[0]).max(), rel=1e-8)
    assert -found["z_l"].min() == pytest.approx(-wanted[:, 0].min(), rel=1e-8)
