"""The simulated robot as its chips see it: analogue signals, supplies that can be cut, tasks at their instants.

The world is that of the board `sim`, with the same noise from the same seed; between it and the flight software
stand the chips and the real drivers. Nothing runs in a thread, so the same seed gives the same bits.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Protocol

from hal.errors import CommandRefused
from hal.raspberry_pi.clock import Agenda
from hal.raspberry_pi.ports import Task
from sim_hal.rig import CHUNK_S, Rig
from sim_hal.sensors import GRID_TOLERANCE_S, Sample, SampledSensor
from sim_hal.settings import SimSettings
from sim_hal.world import World

PENDING = 4096
"""Samples that a signal keeps for its chip: more than any chip's FIFO holds."""


class Guard(Protocol):
    """Something that acts when it is not kept quiet."""

    def deadline_s(self) -> float:
        """When it acts; infinity when it does not."""

    def act(self) -> None: ...


class ChipRig(Rig):
    """World and signals. Motor and magnet have power while the supply is on, whatever they are commanded."""

    def __init__(self, settings: SimSettings, world: World) -> None:
        self.supply_on = False
        self._voltage_v = 0.0
        self._magnet = False
        self.guards: list[Guard] = []
        self.agenda = Agenda()
        self.signals: dict[str, Signal] = {}
        super().__init__(settings, world)
        self.signals = {name: Signal(self, sensor) for name, sensor in self.sensors.items()}
        self._hand_over()

    def advance(self, to_s: float) -> None:
        """Let time pass until `to_s` [s]; tasks run at their instants, guards act at theirs."""
        while self.now_s < to_s:
            deadline_s = min((guard.deadline_s() for guard in self.guards), default=math.inf)
            end_s = min(to_s, self.now_s + CHUNK_S, max(deadline_s, self.now_s))
            if end_s > self.now_s:
                self._step(end_s)
                self._hand_over()
                self._run_tasks(end_s)
            for guard in self.guards:
                if guard.deadline_s() <= self.now_s:
                    guard.act()

    def _hand_over(self) -> None:
        for signal in self.signals.values():
            signal.receive()

    def _run_tasks(self, end_s: float) -> None:
        """Tasks read sensors only, so that the world may be ahead of them by a chunk."""
        while (at_s := self.agenda.next_s()) <= end_s + GRID_TOLERANCE_S:
            self.now_s = min(at_s, end_s)
            self.agenda.run_next(self.now_s)
        self.now_s = end_s

    def switch_supply(self, on: bool) -> None:
        """Give the actuators their supply, or take it."""
        self.supply_on = on
        self._apply()

    def command_voltage_v(self, voltage_v: float) -> None:
        """What the motor's stage would put out with a supply [V]."""
        self._voltage_v = voltage_v
        self._apply()

    def command_magnet(self, on: bool) -> None:
        """Whether the magnet's stage conducts."""
        self._magnet = on
        self._apply()

    @property
    def outputs_off(self) -> bool:
        """Whether nothing is commanded, whatever the supply."""
        return self._voltage_v == 0.0 and not self._magnet

    def _apply(self) -> None:
        if self._obeys("motor"):
            self.world.set_voltage_v(self._voltage_v if self.supply_on else 0.0)
        if self._obeys("magnet"):
            self.world.set_magnet(self._magnet and self.supply_on)

    def _obeys(self, actuator: str) -> bool:
        return self.faults.active(actuator, self.now_s) in (None, "fail") or not self.supply_on


class Signal:
    """The analogue signal at a chip's input, sampled (noise, range) when the chip samples."""

    def __init__(self, rig: ChipRig, sensor: SampledSensor) -> None:
        self._rig, self._sensor = rig, sensor
        self._pending: deque[Sample] = deque(maxlen=PENDING)
        self._newest = Sample(0.0, 0.0, False)

    @property
    def now_s(self) -> float:
        """Time of the board."""
        return self._rig.now_s

    def set_rate_hz(self, rate_hz: float) -> None:
        """Sample at the fastest rate of the settings that is not beyond `rate_hz`, else at the slowest."""
        rates = sorted(mode.rate_hz for mode in self._sensor.modes)
        best = max((rate for rate in rates if rate <= rate_hz * (1.0 + 1e-6)), default=rates[0])
        if best != self._sensor.mode.rate_hz:
            self._sensor.set_rate_hz(best)

    def receive(self) -> None:
        """Take over what the sensor sampled."""
        times_s, values, saturated, _ = self._sensor.drain()
        self._pending.extend(map(Sample, times_s, values, saturated))

    def take(self) -> list[Sample]:
        """Samples up to now that were not taken yet, oldest first."""
        taken = []
        while self._pending and self._pending[0].time_s <= self.now_s + GRID_TOLERANCE_S:
            self._newest = self._pending.popleft()
            taken.append(self._newest)
        return taken

    def newest(self) -> float:
        """The newest value up to now; 0 before the first."""
        self.take()
        return self._newest.value

    def newest_s(self) -> float:
        """When that was sampled."""
        self.take()
        return self._newest.time_s


class RigClock:
    """The board's clock: waiting lets the simulated world go on."""

    def __init__(self, rig: ChipRig) -> None:
        self._rig = rig

    def now_s(self) -> float:
        """Simulated seconds since the board was opened."""
        return self._rig.now_s

    def sleep_until_s(self, time_s: float) -> None:
        """Advance the world to `time_s`. Raises `CommandRefused` for a time that is not finite."""
        if not math.isfinite(time_s):
            raise CommandRefused(f"clock: cannot sleep until {time_s!r} s")
        self._rig.advance(time_s)


class RigSampler:
    """Runs tasks when the simulated time reaches their instants."""

    def __init__(self, rig: ChipRig) -> None:
        self._rig = rig

    def every(self, rate_hz: float, task: Task) -> Callable[[], None]:
        """Run `task` at whole multiples of the period; returns what ends it."""
        return self._rig.agenda.every(rate_hz, task, self._rig.now_s).cancel

    def once(self, at_s: float, task: Task) -> Callable[[], None]:
        """Run `task` at one instant; returns what calls it off."""
        return self._rig.agenda.once(at_s, task).cancel

    def close(self) -> None:
        """Run nothing any more."""
        self._rig.agenda = Agenda()
