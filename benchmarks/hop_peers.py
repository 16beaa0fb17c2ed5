"""The nominal hop to its highest point by others: SciPy's solver with events, and MuJoCo.

Both get the same two masses on a spring, and the soil as a spring whose stiffness changes when the foot turns or
leaves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Float = NDArray[np.float64]

LONGEST_S = 10.0


@dataclass(frozen=True)
class Rig:
    """One hop: masses [kg], gravity [m/s²], spring and its damping, soil, compression [m]."""

    m_b: float
    m_l: float
    g: float
    k: float
    c: float
    k_l: float
    chi: float
    s: float

    @property
    def mass(self) -> float:
        return self.m_b + self.m_l

    def start(self) -> Float:
        """(z_l, v_l, z_b, v_b) at rest under the full weight, the spring compressed."""
        rest = self.mass * self.g / self.k_l
        return np.array([-rest, 0.0, -rest - self.m_b * self.g / self.k - self.s, 0.0])

    def soil(self, piece: str, deepest: float) -> tuple[float, float]:
        """Stiffness of the soil, and the foot's height at which it would give no force."""
        if piece == "loading":
            return self.k_l, 0.0
        if piece == "unloading":
            steep = self.k_l / (1.0 - self.chi)
            return steep, (self.k_l / steep - 1.0) * deepest
        return 0.0, 0.0

    def height(self, state: Sequence[float] | Float) -> float:
        """Of the centre of mass."""
        return (self.m_b * float(state[2]) + self.m_l * float(state[0])) / self.mass

    def momentum(self, state: Sequence[float] | Float) -> float:
        return self.m_b * float(state[3]) + self.m_l * float(state[1])


def by_scipy(rig: Rig, tolerance: float) -> float:
    """Rise [m] by DOP853 with events."""
    state, piece, now = rig.start(), "loading", 0.0
    start, deepest = rig.height(state), -float(state[0])
    while True:
        stiffness, free = rig.soil(piece, deepest)
        crater = -rig.chi * deepest
        ends = {
            "loading": [("unloading", Crossing(1, 0.0, 1.0))],
            "unloading": [("flight", Crossing(0, crater, 1.0)), ("loading", Crossing(0, -deepest, -1.0))],
            "flight": [("unloading", Crossing(0, crater, -1.0))],
        }[piece]
        system = _system(rig, stiffness)
        force = np.array([0.0, stiffness * free / rig.m_l - rig.g, 0.0, -rig.g])
        solve: Any = solve_ivp  # its stubs know no events with a memory
        found = solve(
            lambda _, x, system=system, force=force: system @ x + force,
            (now, LONGEST_S),
            state,
            method="DOP853",
            events=[*(event for _, event in ends), Top(rig)],
            rtol=tolerance,
            atol=1e-2 * tolerance,
        )
        now, state = float(found.t[-1]), found.y[:, -1]
        if found.status != 1 or found.t_events[-1].size:
            return rig.height(state) - start
        which = next(n for n, times in enumerate(found.t_events) if times.size)
        if piece == "loading":
            deepest = max(deepest, -float(state[0]))
            state[1] = 0.0
        piece = ends[which][0]


class Crossing:
    """A state that crosses a level, upwards (1) or downwards (−1)."""

    terminal = True

    def __init__(self, column: int, level: float, direction: float) -> None:
        self._column, self._level, self.direction = column, level, direction

    def __call__(self, time_s: float, state: Float) -> float:
        return float(state[self._column]) - self._level


class Top:
    """The centre of mass at its highest."""

    terminal, direction = True, -1.0

    def __init__(self, rig: Rig) -> None:
        self._rig = rig

    def __call__(self, time_s: float, state: Float) -> float:
        return self._rig.momentum(state)


def _system(rig: Rig, stiffness: float) -> Float:
    k, c = rig.k, rig.c
    return np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [-(k + stiffness) / rig.m_l, -c / rig.m_l, k / rig.m_l, c / rig.m_l],
            [0.0, 0.0, 0.0, 1.0],
            [k / rig.m_b, c / rig.m_b, -k / rig.m_b, -c / rig.m_b],
        ]
    )


_MJCF = """
<mujoco>
  <option timestep="{step}" gravity="0 0 -{g}" integrator="RK4">
    <flag contact="disable" constraint="disable"/>
  </option>
  <worldbody>
    <body><joint name="leg" type="slide" axis="0 0 1" stiffness="1"/><geom size="0.01" mass="{m_l}"/></body>
    <body><joint name="body" type="slide" axis="0 0 1"/><geom size="0.01" mass="{m_b}"/></body>
  </worldbody>
  <tendon>
    <fixed stiffness="{k}" damping="{c}" springlength="0">
      <joint joint="leg" coef="1"/><joint joint="body" coef="-1"/>
    </fixed>
  </tendon>
</mujoco>
"""


class MuJoCoHop:
    """Rise [m] by MuJoCo's Runge–Kutta with a fixed step; pieces change at the end of a step."""

    def __init__(self, rig: Rig, step_s: float) -> None:
        import mujoco

        self._step = mujoco.mj_step
        self._rig = rig
        values = {"step": step_s, "g": rig.g, "m_l": rig.m_l, "m_b": rig.m_b, "k": rig.k, "c": rig.c}
        self._model = mujoco.MjModel.from_xml_string(_MJCF.format(**values))
        self._data = mujoco.MjData(self._model)

    def rise_m(self) -> float:
        rig, model, data, step = self._rig, self._model, self._data, self._step
        state = rig.start()
        data.qpos[:], data.qvel[:] = state[[0, 2]], 0.0
        piece, deepest, start = "loading", -float(state[0]), rig.height(state)
        model.jnt_stiffness[0], model.qpos_spring[0] = rig.soil(piece, deepest)
        position, velocity = data.qpos, data.qvel
        while True:
            step(model, data)
            foot, foot_speed = position[0], velocity[0]
            later = piece
            if piece == "loading":
                deepest = max(deepest, -foot)
                later = "unloading" if foot_speed > 0.0 else piece
            elif piece == "unloading":
                later = "flight" if foot > -rig.chi * deepest else "loading" if foot < -deepest else piece
            elif foot < -rig.chi * deepest:
                later = "unloading"
            if later != piece:
                piece = later
                model.jnt_stiffness[0], model.qpos_spring[0] = rig.soil(piece, deepest)
            if rig.m_b * velocity[1] + rig.m_l * foot_speed <= 0.0:
                return rig.height((foot, foot_speed, position[1], velocity[1])) - start
