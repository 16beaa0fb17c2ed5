"""The public face of the plant engine: plants, runs, and a simulator to step along with software in the loop."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from sim_hal.plant import engine
from sim_hal.plant.compiled import CompiledPlant, Rows, compile_plant, probes
from sim_hal.plant.compose import MISSING_FORCE
from sim_hal.plant.effects import catalogue
from sim_hal.plant.effects.base import Effect, alternatives, prior, usual_size
from sim_hal.plant.engine import Schedule
from sim_hal.plant.expressions import Name, Node
from sim_hal.plant.plant import EffectUse, Parameter, Plant, Sensor
from sim_hal.plant.plantfile import load_plant, read_plant, save_plant
from sim_hal.plant.program import Floats
from sim_hal.plant.run import Run, SimulationError
from sim_hal.plant.structure import Balance, PlantError

__all__ = [
    "MISSING_FORCE",
    "Balance",
    "CompiledPlant",
    "Effect",
    "EffectUse",
    "Parameter",
    "Plant",
    "PlantError",
    "Rows",
    "Run",
    "Sensor",
    "SimulationError",
    "Simulator",
    "alternatives",
    "catalogue",
    "compile_plant",
    "load_plant",
    "prior",
    "probes",
    "read_plant",
    "save_plant",
    "usual_size",
]


class Simulator:
    """A plant that is stepped along in time, inputs held over each step.

    `definitions`: whether they are told, too, beside the outputs. Raises `SimulationError` when it cannot go on.
    """

    def __init__(
        self,
        plant: Plant,
        *,
        conditions: Mapping[str, float | str] | None = None,
        known: Mapping[str, float] | None = None,
        events: Mapping[str, float] | None = None,
        start_s: float = 0.0,
        initial: Mapping[str, float] | None = None,
        definitions: bool = True,
    ) -> None:
        self._compiled = _compiled(plant, definitions)
        self._flags = self._compiled.assembled.flags
        self._events = np.array([(events or {}).get(name, np.inf) for name in self._flags], dtype=float)
        self._places = {name: place for place, name in enumerate(plant.structure.inputs)}
        run = Run(
            times_s=np.array([start_s]), conditions=conditions or {}, known=known or {}, events=events or {}
        )
        self._machine = self._compiled.machine(self._compiled.values, run, initial)
        self._steps = self._machine.starts[0, engine.CLOCK, engine.STEPS :][:1]
        self._states = self._machine.starts[0, engine.STATE]
        self.time_s = start_s
        """Simulated time."""
        self.names = self._compiled.output_names
        """Names of outputs, and of definitions if they are told, in the order of `values`."""
        self._late = self._compiled.lateness(self._compiled.values, run)
        for channel, late in self._late.items():
            if late.skew < 0.0 or late.delay_s < 0.0:
                raise SimulationError(f"{plant.name}: {channel} is early: what is to come cannot be read")
        self._latest: list[float] | None = None  # outputs at the present time
        self._breaks = np.zeros(2)
        self._held = np.zeros((2, len(plant.structure.inputs)))
        self._given: dict[str, float] = {}
        self._runs: dict[int, tuple[Floats, Callable[[], Rows]]] = {}  # by number of samples
        self._history: list[tuple[float, dict[str, float]]] = []
        self._remember()

    def advance(self, to_time_s: float, inputs: Mapping[str, float] | None = None) -> None:
        """Go on to a later time, the given inputs held; those not given keep their value."""
        self._check(to_time_s)
        self._take(inputs or {})
        self._go_on(to_time_s)
        self._remember()

    def trace(self, times_s: Sequence[float], inputs: Mapping[str, float] | None = None) -> Rows:
        """Go on to the last of some increasing times, (n,) s, inputs as in `advance`; what `values` says at each."""
        if self._late or (self._flags and self._inside(times_s[-1])):
            found = []
            for time_s in times_s:
                self.advance(time_s, inputs)
                found.append(self.values())
            return found
        self._check(times_s[0])
        if inputs:
            self._take(inputs)
        rows = self._sampled(times_s)
        self._latest = rows[-1]
        return rows

    def _check(self, to_time_s: float) -> None:
        if not to_time_s >= self.time_s:
            raise SimulationError(f"cannot go back from t = {self.time_s} s to {to_time_s} s")

    def _take(self, inputs: Mapping[str, float]) -> None:
        """Hold these inputs from now on."""
        for name, value in inputs.items():
            if self._given.get(name) == value:
                continue  # nearly always: to write into an array takes its time
            if name not in self._places:
                raise SimulationError(f"no input {name!r}; inputs: {', '.join(self._places) or 'none'}")
            if not math.isfinite(value):
                raise SimulationError(f"input {name} = {value} is not finite")
            place = self._places[name]
            self._held[0, place] = self._held[1, place] = value
            self._given[name] = value

    def outputs(self) -> dict[str, float]:
        """Outputs and definitions by name at the present time, SI."""
        return dict(zip(self.names, self.values(), strict=True))

    def values(self) -> list[float]:
        """As `outputs`, in the order of `names`."""
        if not self._late:
            return self._now()
        return [
            self._delayed(name, float(self._late[name].seen_s(np.array(self.time_s))))
            if name in self._late
            else now
            for name, now in zip(self.names, self._now(), strict=True)
        ]

    def state(self) -> dict[str, float]:
        """States by name, SI."""
        return dict(zip(self._compiled.state_names, self._states.tolist(), strict=False))

    def set_event(self, name: str, time_s: float) -> None:
        """Let an event happen at a time, now or later."""
        if name not in self._compiled.plant.structure.events:
            known = ", ".join(self._compiled.plant.structure.events) or "none"
            raise SimulationError(f"no event {name!r}; events: {known}")
        if time_s < self.time_s:
            raise SimulationError(f"event {name} at t = {time_s} s is in the past (t = {self.time_s} s)")
        self._events[self._flags.index(name)] = time_s
        self._latest = None

    def flag(self, name: str) -> bool:
        """Whether a flag is set or an event has happened."""
        if name not in self._flags:
            raise SimulationError(f"no flag {name!r}; flags: {', '.join(self._flags) or 'none'}")
        return bool(self._register("flag", name))

    def flag_time_s(self, name: str) -> float | None:
        """When a flag was set, or None."""
        return self._register("flag_time", name) if self.flag(name) else None

    def _register(self, block: str, name: str) -> float:
        layout = self._compiled.assembled.program.layout
        return float(self._machine.registers[0, getattr(layout, block) + self._flags.index(name)])

    def _go_on(self, to_time_s: float) -> None:
        """Go on to a later time, from event to event, or stay; notes the outputs there."""
        for event_s in sorted(set(self._inside(to_time_s))):
            self._sampled((event_s,))
        self._latest = self._sampled((to_time_s,))[0]

    def _sampled(self, times_s: Sequence[float]) -> Rows:
        """Go on to the last of some times between which nothing happens from outside; outputs (n, n_outputs)."""
        count = len(times_s)
        if count not in self._runs:
            here = np.zeros(count)
            plan = Schedule(self._breaks, self._held, np.zeros_like(self._held), self._events, here)
            self._runs[count] = here, self._compiled.stepper(self._machine, plan)
        here, run = self._runs[count]
        for place, time_s in enumerate(times_s):  # mostly one, or a few: quicker than all at once
            here[place] = time_s
        self._breaks[0], self._breaks[1] = self.time_s, times_s[-1]
        self._steps[0] = 0.0
        outputs = run()
        self.time_s = times_s[-1]
        return outputs

    def _inside(self, to_time_s: float) -> list[float]:
        """The events between now and then, both left out."""
        now_s = self.time_s
        return [event for event in self._events.tolist() if now_s < event < to_time_s]

    def _now(self) -> list[float]:
        """Outputs at the present time, computed once."""
        if self._latest is None:
            self._go_on(self.time_s)
        assert self._latest is not None
        return self._latest

    def _remember(self) -> None:
        """Keep late channels' values, no longer than they are late."""
        if self._late:
            self._history.append((self.time_s, dict(zip(self.names, self._now(), strict=True))))
            oldest = self.time_s - max(late.longest_s(self.time_s) for late in self._late.values())
            while len(self._history) > 2 and self._history[1][0] <= oldest:
                self._history.pop(0)

    def _delayed(self, channel: str, time_s: float) -> float:
        times = [time for time, _ in self._history]
        return float(np.interp(time_s, times, [values[channel] for _, values in self._history]))


_RECENT: deque[tuple[bool, CompiledPlant]] = deque(maxlen=8)


def _compiled(plant: Plant, definitions: bool) -> CompiledPlant:
    """A plant made ready, its definitions as outputs or not: kept, for a robot's plants start anew with each hop."""
    for told, known in tuple(_RECENT):
        if known.plant is plant and told is definitions:
            return known
    _RECENT.append((definitions, compile_plant(plant, extra=_numbers(plant) if definitions else {})))
    return _RECENT[-1][1]


def _numbers(plant: Plant) -> dict[str, Node]:
    """Formulas that give all definitions as outputs."""
    return {name: Name(name) for name in plant.structure.definitions if name not in plant.structure.outputs}
