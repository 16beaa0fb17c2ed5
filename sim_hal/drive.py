"""The tensioning drive as one machine that never stops: string taut, slack or let go, end stops, restarts.

The plant of kind `drive` knows a nut that pulls on the springs from x = 0 (string taut) on. Everything around
that is here: with the lock open the string is held by nothing, so the plant runs with its travel shifted to
where no string is taut; at an end stop the screw jams and the motor draws its voltage over its winding.
"""

from __future__ import annotations

from collections.abc import Mapping

from sim_hal.plant.simulate import Plant, Simulator
from sim_hal.settings import RigSettings

ANGLE, SPEED, CURRENT = "theta", "omega", "i"
"""Names of the drive plant's states; the angle follows from the nut's position at each start."""


class TensioningDrive:
    """Motor, gearbox, screw and string; positions [m] count from where the latched string is just taut."""

    def __init__(
        self,
        plant: Plant,
        rig: RigSettings,
        conditions: Mapping[str, float | str],
        position_m: float,
        held: bool,
    ) -> None:
        self._plant = plant
        self._rig = rig
        self._conditions = conditions
        self._jammed_current_a: float | None = None
        self._restart({}, position_m, held)

    @property
    def position_m(self) -> float:
        """Travel of the nut."""
        return self._outputs["nut_position_m"] + self._shift_m

    @property
    def spring_compression_m(self) -> float:
        """Compression that the string imposes on the springs; 0 while it is slack or let go."""
        return self._outputs["spring_compression_m"]

    @property
    def current_a(self) -> float:
        """Motor current."""
        if self._jammed_current_a is not None:
            return self._jammed_current_a
        return self._outputs["motor_current_a"]

    def advance(self, by_s: float, voltage_v: float) -> None:
        """Run for `by_s` seconds at a terminal voltage [V]."""
        if self._jammed_current_a is not None and self._pushes_into_stop(voltage_v):
            self._jammed_current_a = voltage_v / self._rig.stop_resistance_ohm
            return
        self._jammed_current_a = None
        self._simulator.advance(self._simulator.time_s + by_s, {"motor_voltage_v": voltage_v})
        self._outputs = self._simulator.outputs()
        if not self._rig.stop_low_m <= self.position_m <= self._rig.stop_high_m:
            self._jam(voltage_v)

    def hold_string(self) -> None:
        """The lock has closed: from now on the nut pulls on the springs."""
        self._restart(self._simulator.state(), self.position_m, held=True)

    def let_go(self) -> None:
        """The lock has opened: the string is slack wherever the nut stands."""
        self._restart(self._simulator.state(), self.position_m, held=False)

    def _jam(self, voltage_v: float) -> None:
        stop_m = min(max(self.position_m, self._rig.stop_low_m), self._rig.stop_high_m)
        held = self._shift_m == 0.0
        self._restart({**self._simulator.state(), SPEED: 0.0, CURRENT: 0.0}, stop_m, held)
        self._jammed_current_a = voltage_v / self._rig.stop_resistance_ohm

    def _pushes_into_stop(self, voltage_v: float) -> bool:
        at_low = self.position_m <= self._rig.stop_low_m
        return voltage_v < 0.0 if at_low else voltage_v > 0.0

    def _restart(self, states: Mapping[str, float], position_m: float, held: bool) -> None:
        self._shift_m = 0.0 if held else self._rig.stop_high_m
        self._simulator = Simulator(
            self._plant,
            conditions=self._conditions,
            known={"nut_position_m": position_m - self._shift_m},
            initial={name: value for name, value in states.items() if name != ANGLE},
        )
        self._outputs = self._simulator.outputs()
