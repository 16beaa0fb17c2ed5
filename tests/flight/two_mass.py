"""A two-mass hop by exact piecewise formulas: each phase is linear, so its motion is a matrix exponential.

Written for the tests of flight alone, from the equations of the rig's specification.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STEP_S = 1.0 / 1666.0 / 8.0
_TERMS = 24


@dataclass(frozen=True)
class Ground:
    stiffness_n_m: float
    kept: float  # chi

    @property
    def unloading_n_m(self) -> float:
        return self.stiffness_n_m / (1.0 - self.kept)


STEEL = Ground(5e7, 0.0)
SAND = Ground(95e3, 0.90)
SYAR = Ground(120e3, 0.75)
CLAY = Ground(75e3, 0.92)


def _moved(matrix: Array, time_s: float, state: Array) -> Array:
    """expm(matrix time) state as its series; frequency times a step is below 1."""
    total, term = state.copy(), state
    for n in range(1, _TERMS):
        term = matrix @ term * (time_s / n)
        total += term
    return total


@dataclass
class TwoMassHop:
    """One hop from rest at compression s; time 0 is the opening of the lock."""

    compression_m: float
    ground: Ground
    body_kg: float = 5.393
    leg_kg: float = 2.139
    stiffness_n_m: float = 30600.0
    damping: float = 18.0
    gravity: float = 8.874
    duration_s: float = 1.6
    times: Array = field(init=False)
    states: Array = field(init=False)  # z_b, v_b, z_l, v_l, 1
    take_off_s: float | None = None
    touchdown_s: float | None = None

    def __post_init__(self) -> None:
        self._deepest = (self.body_kg + self.leg_kg) * self.gravity / self.ground.stiffness_n_m
        self._mode = "load"
        weight_m = self.body_kg * self.gravity / self.stiffness_n_m
        z_l = -self._deepest
        state = np.array([z_l - (self.compression_m + weight_m), 0.0, z_l, 0.0, 1.0])
        self._step_of: tuple[str, float] | None = None
        self._step = np.eye(5)
        self._contacts: list[tuple[str, float]] = []
        states = [state]
        count = int(self.duration_s / STEP_S)
        for index in range(count):
            state = self._advance(state, index * STEP_S)
            states.append(state)
        self.times = np.arange(count + 1, dtype=np.float64) * STEP_S
        self.states = np.array(states)
        self._name_the_flight()

    def _name_the_flight(self) -> None:
        """The flight is the longest stretch without contact."""
        longest = 0.0
        for (what, begin), (_, end) in zip(self._contacts, self._contacts[1:], strict=False):
            if what == "leave" and end - begin > longest:
                longest, self.take_off_s, self.touchdown_s = end - begin, begin, end

    def _matrix(self) -> Array:
        k, c, m_b, m_l = self.stiffness_n_m, self.damping, self.body_kg, self.leg_kg
        spring = np.array([-k, -c, k, c, 0.0])  # k delta + c delta', delta = z_l - z_b
        soil = np.zeros(5)
        soft, stiff = self.ground.stiffness_n_m, self.ground.unloading_n_m
        if self._mode == "load":
            soil[2] = -soft
        elif self._mode == "unload":
            soil[2], soil[4] = -stiff, (soft - stiff) * self._deepest
        matrix = np.zeros((5, 5))
        matrix[0, 1] = matrix[2, 3] = 1.0
        matrix[1] = spring / m_b
        matrix[3] = (soil - spring) / m_l
        matrix[1, 4] -= self.gravity
        matrix[3, 4] -= self.gravity
        return matrix

    def _advance(self, state: Array, start_s: float) -> Array:
        left = STEP_S
        for _ in range(12):
            matrix = self._matrix()
            end = self._whole_step(matrix) @ state if left == STEP_S else _moved(matrix, left, state)
            if not self._ended(end):
                return end
            low, high = 0.0, left
            for _ in range(45):
                middle = 0.5 * (low + high)
                if self._ended(_moved(matrix, middle, state)):
                    high = middle
                else:
                    low = middle
            state = _moved(matrix, high, state)
            left -= high
            self._switch(state, start_s + STEP_S - left)
        raise RuntimeError("the contact chatters")

    def _whole_step(self, matrix: Array) -> Array:
        key = (self._mode, self._deepest)
        if self._step_of != key:
            self._step_of, self._step = key, np.column_stack([_moved(matrix, STEP_S, e) for e in np.eye(5)])
        return self._step

    def _residual_m(self) -> float:
        return self.ground.kept * self._deepest

    def _ended(self, state: Array) -> bool:
        depth = -state[2]
        if self._mode == "load":
            return bool(state[3] > 0.0)
        if self._mode == "unload":
            return bool(depth > self._deepest or depth < self._residual_m())
        return bool(depth > self._residual_m() and state[3] < 0.0)

    def _switch(self, state: Array, at_s: float) -> None:
        if self._mode == "load":
            self._deepest, self._mode = -state[2], "unload"
        elif self._mode == "unload" and state[3] > 0.0:
            self._mode = "free"
            self._contacts.append(("leave", at_s))
        elif self._mode == "unload":
            self._mode = "load"
        else:
            self._mode = "unload" if self.ground.kept > 0.0 else "load"
            self._contacts.append(("touch", at_s))

    def read(self, times_s: Array) -> tuple[Array, Array]:
        """Specific force of the body and spring compression s at any times; at rest before 0."""
        times_s = np.asarray(times_s)
        index = np.clip((times_s / STEP_S).astype(int), 0, self.times.size - 1)
        specific, compression = np.empty(times_s.size), np.empty(times_s.size)
        weight_m = self.body_kg * self.gravity / self.stiffness_n_m
        for number, (time_s, near) in enumerate(zip(times_s, index, strict=True)):
            if time_s < 0.0:
                specific[number], compression[number] = self.gravity, self.compression_m
                continue
            z_b, v_b, z_l, v_l, _ = self._between(near, time_s)
            delta = z_l - z_b
            specific[number] = (self.stiffness_n_m * delta + self.damping * (v_l - v_b)) / self.body_kg
            compression[number] = delta - weight_m
        return specific, compression

    def _between(self, near: int, time_s: float) -> Array:
        """Linear between stored states: their spacing is an eighth of a sample."""
        if near + 1 >= self.times.size:
            return np.asarray(self.states[-1])
        u = (time_s - self.times[near]) / STEP_S
        a, b = self.states[near], self.states[near + 1]
        return np.asarray(a + u * (b - a))

    @property
    def height_m(self) -> float:
        """Apex of the centre of mass above its height at the start, in the flight."""
        total = self.body_kg + self.leg_kg
        com = (self.body_kg * self.states[:, 0] + self.leg_kg * self.states[:, 2]) / total
        return float(com.max() - com[0])
