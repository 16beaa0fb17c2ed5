"""How high hops go: many at once, exact where the plant is the nominal one, else integrated to the highest point."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim_hal.plant import exact_hop
from sim_hal.plant.compiled import compile_plant
from sim_hal.plant.expressions import parse
from sim_hal.plant.plant import Plant
from sim_hal.plant.program import Floats
from sim_hal.plant.run import Run, SimulationError

FIRE, COMPRESSION = "fire_command", "spring_compression_m"
_TOLERANCE = 1e-6  # heights within 1e-6 of themselves, by measurement
_RISEN = 0.01  # m/s, of the centre of mass; less would lift it by 5 µm
#: Momentum of the centre of mass upwards, by geometry.
_RISING = {
    "vertical": "body_mass * v_b + leg_mass * v_l",
    "arm": "body_mass * v_b * cos(z_b / L_CoM) + leg_mass * v_l * cos(z_l / L_CoM)",
}


class Hops:
    """Hops of one plant of kind `hop` from one surface. `parameter_names`, `values`: as of `compile_plant`."""

    def __init__(self, plant: Plant, surface: str, relative_tolerance: float = _TOLERANCE) -> None:
        rising = _RISING[plant.geometry]
        flags = {
            "risen": parse(f"{rising} >= {_RISEN} * (body_mass + leg_mass)"),
            "highest": parse(f"risen and {rising} <= 0"),
        }
        structure = replace(plant.structure, flags={**plant.structure.flags, **flags})
        if surface not in plant.surfaces:
            raise SimulationError(
                f"surface {surface!r} is not in the plant file; known: {', '.join(plant.surfaces)}"
            )
        self._plant = plant
        self._surface = surface
        self._compiled = compile_plant(
            replace(plant, structure=structure), relative_tolerance=relative_tolerance
        )
        self.parameter_names = self._compiled.parameter_names
        self.values = self._compiled.values

    @property
    def exact(self) -> bool:
        """Whether the heights are exact, to rounding."""
        return not self._plant.effects and self._plant.geometry == "vertical"

    def heights_m(self, compression_m: Floats, values: Floats | None = None, **conditions: float) -> Floats:
        """Rise of the centre of mass from before the release to its highest point, (n,) m.

        compression_m: (n,), beyond what the body's weight takes. values: (n, n_par) or (n_par,), else the plant's.
        `conditions` are those of a recording that are numbers (`hop_index`, `tilt_deg`). Raises `SimulationError`.
        """
        count = len(compression_m)
        rows = np.broadcast_to(self.values if values is None else values, (count, len(self.values)))
        if not np.all(compression_m > 0.0) or not np.all(np.isfinite(compression_m)):
            raise SimulationError("spring_compression_m must be a finite number above 0")
        if not np.isfinite(rows).all():
            row, column = np.argwhere(~np.isfinite(rows))[0]
            raise SimulationError(
                f"{self.parameter_names[column]} = {rows[row, column]} is not a finite number"
            )
        if count == 0:
            return np.empty(0)
        return (
            self._exactly(compression_m, rows)
            if self.exact
            else self._integrated(compression_m, rows, conditions)
        )

    def _exactly(self, compression_m: Floats, values: Floats) -> Floats:
        columns = [
            compression_m if name == COMPRESSION else values[:, self._column(name)]
            for name in exact_hop.HOP_PARAMETERS
        ]
        heights = np.empty(len(values))
        exact_hop.climbs(np.column_stack(columns), exact_hop.room(), heights)
        for row in np.flatnonzero(~np.isfinite(heights))[:1]:
            own = dict(zip(exact_hop.HOP_PARAMETERS, (float(column[row]) for column in columns), strict=True))
            raise SimulationError(f"{self._plant.name}: no highest point with {own}")
        return heights

    def _column(self, name: str) -> int:
        own = name in self._plant.structure.surface_parameters
        return self.parameter_names.index(f"{self._surface}.{name}" if own else name)

    def _integrated(self, compression_m: Floats, values: Floats, conditions: dict[str, float]) -> Floats:
        longest = self._longest_s(compression_m, values)
        heights = np.empty(len(values))
        for until_s in np.unique(longest):
            rows = longest == until_s
            known = {COMPRESSION: compression_m[rows]}
            run = Run(
                np.array([0.0, until_s]),
                events={FIRE: 0.0},
                known={COMPRESSION: 0.0},
                conditions={"surface": self._surface, **conditions},
            )
            before, after = self._compiled.until("highest", values[rows], run, known)
            heights[rows] = self._centres_m(values[rows], after) - self._centres_m(values[rows], before)
        return heights

    def _longest_s(self, compression_m: Floats, values: Floats) -> Floats:
        """Longer than each hop can rise, by the energy of its spring: powers of 4, so that many share a schedule."""
        k, g, m_b, m_l = (values[:, self._column(name)] for name in ("k", "g", "m_b", "m_l"))
        speed = np.sqrt((k * compression_m + 2.0 * m_b * g) * compression_m / (m_b + m_l))
        return np.asarray(4.0 ** np.ceil(np.log2(1.0 + 2.0 * speed / g) / 2.0))

    def _centres_m(self, values: Floats, states: Floats) -> Floats:
        """Height of the centre of mass."""
        total = np.zeros(len(values))
        m_b, m_l = (values[:, self._column(name)] for name in ("m_b", "m_l"))
        for mass, name in ((m_b, "z_b"), (m_l, "z_l")):
            height = states[:, self._compiled.state_names.index(name)]
            if self._plant.geometry == "arm":
                radius = values[:, self._column("L_CoM")]
                height = radius * np.sin(height / radius)
            total += mass * height
        return np.asarray(total / (m_b + m_l))
