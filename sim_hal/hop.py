"""One hop of the simulated robot, from the energised magnet until it stands still again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from hal.errors import HalError
from sim_hal.plant.simulate import Plant, Rows, Simulator
from sim_hal.settings import RestSettings

FIRE = "fire_command"
OPENED = "opened"
"""Names of the hop plant's event and of the flag that its latch raises."""


class SimulationFault(HalError, RuntimeError):
    """The simulated robot did what a robot cannot do, such as never coming to rest."""


class Hop:
    """A hop while it lasts; the plant's time starts at `start_s` of the board, with the energised magnet."""

    def __init__(
        self,
        plant: Plant,
        conditions: Mapping[str, float | str],
        compression_m: float,
        start_s: float,
        rest: RestSettings,
    ) -> None:
        known = {"spring_compression_m": compression_m}
        self._simulator = Simulator(
            plant, conditions=conditions, known=known, events={FIRE: 0.0}, definitions=False
        )
        self._rest = rest
        self._quiet_since_s: float | None = None
        self.start_s = start_s
        self.places = {name: place for place, name in enumerate(self._simulator.names)}
        """Where each output stands in `values`."""
        self.values = self._simulator.values()
        self.opened = self._simulator.flag(OPENED)
        """Whether the lock has let go."""

    def now(self, name: str) -> float:
        """An output at the present time."""
        return self.values[self.places[name]]

    @property
    def at_rest(self) -> bool:
        """Whether both masses have been slow for long enough."""
        since_s = self._quiet_since_s
        return since_s is not None and self._simulator.time_s - since_s >= self._rest.for_s

    def advance(self, to_s: float) -> None:
        """Go on until `to_s` of the board [s]. Raises `SimulationFault` when the robot never comes to rest."""
        self.trace([to_s])

    def trace(self, times_s: Sequence[float]) -> Rows:
        """As `advance` to the last of some increasing times of the board; the values at each."""
        traced = self._simulator.trace([time_s - self.start_s for time_s in times_s])
        self.values = traced[-1]
        self.opened = self.opened or self._simulator.flag(OPENED)
        self._watch_for_rest(times_s[-1] - self.start_s)
        return traced

    def _slow(self) -> bool:
        states = self._simulator.state()
        return max(abs(states["v_b"]), abs(states["v_l"])) < self._rest.speed_m_s

    def _watch_for_rest(self, time_s: float) -> None:
        if not (self.opened and self._slow()):
            self._quiet_since_s = None
        elif self._quiet_since_s is None:
            self._quiet_since_s = time_s
        if time_s > self._rest.timeout_s:
            raise SimulationFault(f"the robot is not at rest {time_s:.1f} s after the magnet was energised")


def standing_reading_m_s2(plant: Plant, conditions: Mapping[str, float | str]) -> float:
    """What the accelerometer reads while the robot stands [m/s²]."""
    standing = Simulator(plant, conditions=conditions, known={"spring_compression_m": 0.0}, definitions=False)
    return standing.outputs()["body_acceleration_m_s2"]
