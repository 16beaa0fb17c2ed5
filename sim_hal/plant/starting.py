"""How a run begins: parameters, initial states, memories and modes, for one or many sets of values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from sim_hal.plant import engine
from sim_hal.plant.assemble import Assembled, fitted
from sim_hal.plant.compose import Model
from sim_hal.plant.engine import Limits, Machine
from sim_hal.plant.expressions import Name
from sim_hal.plant.plant import Plant
from sim_hal.plant.program import Floats, Ints, Program
from sim_hal.plant.run import Lateness, Run, SimulationError, check_times, smoothed_start
from sim_hal.plant.structure import Balance

_FIRST_STEP_S = 0.01  # tried first, if the run is long enough


@dataclass(frozen=True)
class Starting:
    """A plant with all that is needed to start runs of it."""

    plant: Plant
    model: Model
    assembled: Assembled
    parameter_names: tuple[str, ...]
    values: Floats
    output_names: tuple[str, ...]
    output_units: tuple[str, ...]
    tolerances: Limits

    @property
    def state_names(self) -> tuple[str, ...]:
        return tuple(self.model.states)

    @property
    def balances(self) -> dict[str, Balance]:
        return dict(self.plant.structure.balances)

    @property
    def fitted_initial_states(self) -> tuple[str, ...]:
        """States with `initial: fit`."""
        return fitted(self.model.states)

    @property
    def settled_states(self) -> dict[str, str]:
        """States that start where others put them, such as a filter's, and the channel or state that they follow."""
        return {name: settled.follows for name, settled in self.model.settled.items()}

    def initial_values(self, values: Floats, run: Run) -> dict[str, float]:
        """Initial states by name; those to be fitted get a guess from the first samples, or 0."""
        registers = self._registers(values[np.newaxis], run)
        state = self._start(registers, run)
        self._settle(registers, state, run.times_s[0], [{}])
        return dict(zip(self.state_names, state[0].tolist(), strict=True))

    def _start(self, registers: Floats, run: Run) -> Floats:
        """Initial states (n, n_states)."""
        state = np.empty((len(registers), len(self.state_names)))
        for column, name in enumerate(self.state_names):
            place = self.assembled.initial.get(name)
            state[:, column] = self._guess(name, run) if place is None else registers[:, place]
        return state

    def machine(self, values: Floats, run: Run, initial: Mapping[str, float] | None = None) -> Machine:
        """The engine's moving parts at the start of a run."""
        return self._machines(values[np.newaxis], run, [initial or {}])

    def _machines(
        self,
        values: Floats,
        run: Run,
        initial: Sequence[Mapping[str, float]],
        known: Mapping[str, Floats] | None = None,
    ) -> Machine:
        """The engine's moving parts at the start of several runs."""
        check_times(run.times_s)
        registers = self._registers(values, run, known or {})
        layout = self.assembled.program.layout
        state = self._start(registers, run)
        for row, own in enumerate(initial):
            for name, value in own.items():
                if name not in self.state_names:
                    raise SimulationError(
                        f"no state {name!r} to start at; states: {', '.join(self.state_names)}"
                    )
                state[row, self.state_names.index(name)] = value
        for offset, place in enumerate(self.assembled.memory_initial):
            registers[:, layout.memory + offset] = registers[:, place]
        self._settle(registers, state, run.times_s[0], initial)
        span = run.times_s[-1] - run.times_s[0]
        starts = np.zeros((len(values), engine.LASTING, engine.columns_of(layout)))
        limits = self.tolerances
        clock = [run.times_s[0], min(0.05 * span, _FIRST_STEP_S) if span > 0 else 1e-3, 0.0]
        starts[:, engine.CLOCK, :6] = [*clock, limits.relative, limits.absolute, limits.steps]
        starts[:, engine.STATE, : layout.ns] = state
        starts[:, engine.SCALE, : layout.ns] = np.abs(state)
        for column, name in enumerate(self.state_names):
            starts[:, engine.WEIGHT, column] = self._present(values, self.model.strengths.get(name))
        room = np.zeros((engine.rows_of(layout), engine.columns_of(layout)))
        return Machine(registers, self._modes(values), starts, room)

    def _settle(
        self, registers: Floats, state: Floats, start_s: float, given: Sequence[Mapping[str, float]]
    ) -> None:
        """Start the states that other states tell, such as a filter's, where those put them."""
        if not self.assembled.settled:
            return
        program = self.assembled.program
        layout = program.layout
        registers[:, layout.time] = start_s
        registers[:, layout.state : layout.state + state.shape[1]] = state
        engine.execute_rows(program.code, layout.modal, layout.derivative, registers)
        for name, place in self.assembled.settled.items():
            own = np.array([name in names for names in given])
            column = self.state_names.index(name)
            state[:, column] = np.where(own, state[:, column], registers[:, place])

    def _modes(self, values: Floats) -> Ints:
        """Modes (n, n_modes) of friction elements, memories and kinks: those without strength are left out."""
        model = self.model
        found = [(element.strengths, engine.OFF) for element in model.elements]
        found += [(model.strengths.get(name), engine.IDLE) for name in model.memories]
        found += [(model.kinks.get(node), engine.IDLE) for node in self.assembled.kinks]
        modes = np.zeros((len(values), engine.modes_of(self.assembled.program.layout)), dtype=np.int64)
        for column, (strengths, off) in enumerate(found):
            modes[:, column] = np.where(self._present(values, strengths), 0, off)
        return modes

    def _present(self, values: Floats, strengths: tuple[str, ...] | None) -> NDArray[np.bool_]:
        """In which rows something has a strength; what has none of its own always is there."""
        if not strengths:
            return np.ones(len(values), dtype=bool)
        own = values[:, [self._index[name] for name in strengths]]
        return np.asarray(np.any(own != 0.0, axis=1))

    @cached_property
    def _index(self) -> dict[str, int]:
        return {name: number for number, name in enumerate(self.parameter_names)}

    def _acting(self, registers: Floats) -> str:
        """In words, which effects a run had, with the values that it was made with."""
        first = self.assembled.program.layout.parameter
        place = {name: first + offset for offset, name in enumerate(self.assembled.parameters)}
        found = []
        for use in self.plant.effects:
            prefix = self.plant.prefix(use)
            values = {name: registers[place[f"{prefix}.{name}"]] for name in use.parameters}
            found.append(f"{prefix} ({', '.join(f'{name} = {v:.4g}' for name, v in values.items())})")
        return f"; effects: {', '.join(found)}" if found else ""

    def _registers(
        self, values: Floats, run: Run, known: Mapping[str, Floats] = MappingProxyType({})
    ) -> Floats:
        """Register files (n, n_registers) with all parameters, and what depends on them alone, filled in."""
        if values.shape[1] != len(self.parameter_names):
            raise SimulationError(f"{values.shape[1]} parameter values, {len(self.parameter_names)} expected")
        if not np.isfinite(values).all():
            row, column = np.argwhere(~np.isfinite(values))[0]
            wrong = f"{self.parameter_names[column]} = {values[row, column]}"
            raise SimulationError(f"{self.plant.name}: {wrong} is not a finite number")
        surface = self._surface(run)
        program: Program = self.assembled.program
        registers = np.tile(program.registers, (len(values), 1))
        parameters = registers[:, program.layout.parameter :]
        names = [surface.get(name, name) for name in self.assembled.parameters[:-1]]
        for offset, name in enumerate(names):
            if name in self._index:
                parameters[:, offset] = values[:, self._index[name]]
            elif name in known:
                parameters[:, offset] = known[name]
            elif name in self.plant.structure.known:
                parameters[:, offset] = self._known(name, run)
            else:
                parameters[:, offset] = np.nan  # optional and absent: nothing may use it
        parameters[:, len(self.assembled.parameters) - 1] = run.began_s
        engine.execute_rows(program.code, 0, program.layout.modal, registers)
        return registers

    def _surface(self, run: Run) -> dict[str, str]:
        """Flat names of the parameters of the surface that the run's conditions name."""
        if not self.plant.surfaces:
            return {}
        surface = run.conditions.get("surface")
        if surface not in self.plant.surfaces:
            known = ", ".join(self.plant.surfaces)
            raise SimulationError(
                f"conditions.surface = {surface!r} is not in the plant file; known: {known}"
            )
        return {name: f"{surface}.{name}" for name in self.plant.structure.surface_parameters}

    def _known(self, name: str, run: Run) -> float:
        """A known quantity of the start: from the sidecar, or smoothed from its channel, or its default."""
        if name in run.known:
            return float(run.known[name])
        condition = run.conditions.get(name)
        if isinstance(condition, (int, float)):
            return float(condition)
        channel = name.removeprefix("first(").removesuffix(")")
        if channel in run.first_samples:
            return smoothed_start(run.times_s, run.first_samples[channel])[0]
        default = self.plant.structure.known[name].default
        if default is None:
            what = f"first samples of {channel}" if name != channel else f"state.{name}"
            raise SimulationError(f"{self.plant.name}: the run does not give {what}, needed for the start")
        return default

    def _guess(self, name: str, run: Run) -> float:
        """Slope of the channel whose state has this state as its rate, else 0."""
        for other, rate in self.model.rates.items():
            start = self.model.states[other].initial
            if rate == Name(name) and isinstance(start, Name) and start.id.startswith("first("):
                channel = start.id.removeprefix("first(").removesuffix(")")
                if channel in run.first_samples:
                    return smoothed_start(run.times_s, run.first_samples[channel])[1]
        return 0.0

    def lateness(self, values: Floats, run: Run) -> dict[str, Lateness]:
        """How late each channel is that is late at all."""
        where = self.assembled
        if not where.delays and not where.skews:
            return {}
        registers = self._registers(values[np.newaxis], run)[0]
        late = {}
        for channel in dict.fromkeys((*where.delays, *where.skews)):
            delay, skew = (
                float(registers[places[channel]]) if channel in places else 0.0
                for places in (where.delays, where.skews)
            )
            late[channel] = Lateness(float(run.times_s[0]), run.began_s, delay, skew)
        return late
