"""The tensioning drive as one machine that never stops: string taut, slack or let go, end stops, restarts.

The plant of kind `drive` knows a nut that pulls on the springs from x = 0 (string taut) on. Everything around
that is here: with the lock open the string is held by nothing, so the plant runs with its travel shifted to
where no string is taut; at an end stop the screw jams and the motor draws its voltage over its winding.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from sim_hal.plant.simulate import Plant, Simulator
from sim_hal.settings import RigSettings

ANGLE, SPEED, CURRENT = "theta", "omega", "i"
"""Names of the drive plant's states; the angle follows from the nut's position at each start."""

_SEEN = ("nut_position_m", "spring_compression_m", "motor_current_a")


class TensioningDrive:
    """Motor, gearbox, screw and string; positions [m] count from where the latched string is just taut.

    `position_m`: travel of the nut. `spring_compression_m`: what the string imposes on the springs; 0 while it is
    slack or let go. `current_a`: of the motor.
    """

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
        self._jammed = False
        self._restart({}, position_m, held)

    def advance(self, by_s: float, voltage_v: float) -> None:
        """Run for `by_s` seconds at a terminal voltage [V]."""
        if self._jammed and self._pushes_into_stop(voltage_v):
            self.current_a = voltage_v / self._rig.stop_resistance_ohm
            return
        self._jammed = False
        times_s = (self._simulator.time_s + by_s,)
        self._look(self._simulator.trace(times_s, {"motor_voltage_v": voltage_v})[0])
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
        self._jammed = True
        self.current_a = voltage_v / self._rig.stop_resistance_ohm

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
            definitions=False,
        )
        self._places = [self._simulator.names.index(name) for name in _SEEN]
        self._look(self._simulator.values())

    def _look(self, values: Sequence[float]) -> None:
        """Take over what the plant says now."""
        position, compression, current = self._places
        self.position_m = values[position] + self._shift_m
        self.spring_compression_m = values[compression]
        if not self._jammed:
            self.current_a = values[current]
