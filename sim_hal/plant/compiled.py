"""A plant made ready to run: many runs with other parameter values need no further preparation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from sim_hal.plant import engine
from sim_hal.plant.assemble import Assembled, assemble, fitted
from sim_hal.plant.compose import Model, compose
from sim_hal.plant.engine import Limits, Machine, Schedule
from sim_hal.plant.expressions import Name, Node
from sim_hal.plant.plant import Plant, check_use, check_values
from sim_hal.plant.program import Floats, Ints, Program
from sim_hal.plant.run import (
    Lateness,
    Run,
    SimulationError,
    check_times,
    prolonged,
    schedule,
    smoothed_start,
)
from sim_hal.plant.structure import Balance
from sim_hal.plant.units import channel_unit

#: Error per step relative to each state; with a floor for states that stay at zero, and a limit of work.
RELATIVE_TOLERANCE = 1e-8
_ABSOLUTE_TOLERANCE = 1e-13
_MAX_STEPS = 20_000_000
_FIRST_STEP_S = 0.01  # tried first, if the run is long enough
_AT_ONCE = 256  # runs whose workspace is held in memory together

_REASONS = {
    engine.NOT_FINITE: "the solution stops being a finite number",
    engine.STEP_VANISHED: "the equations change too fast to be followed (step size vanished)",
    engine.TOO_MANY_STEPS: "more than the allowed number of steps",
    engine.CHATTER: "modes change endlessly without time passing",
    engine.EMPTY_BAND: "dry friction is negative: forward and backward resistance add up to less than 0",
    engine.NO_GRIP: "two friction elements hold the same motion in different ways",
}


@dataclass(frozen=True)
class CompiledPlant:
    """Runs of one plant structure with any parameter values. Made by `compile_plant`.

    parameter_names, values: (n_par,), flat names and nominal values (SI). output_units by channel.
    balances: where a missing force may enter, by name.
    """

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

    def run(self, values: Floats, run: Run, initial: Mapping[str, float] | None = None) -> Floats:
        """Outputs at the run's times, (n, n_outputs), SI; `initial` overrides initial states by name.

        Raises `SimulationError` with words.
        """
        late = self.lateness(values, run)
        if not late:
            return self.run_with_states(values, run, initial)[0]
        times = {channel: late[channel].seen_s(run.times_s) for channel in late}
        every = np.unique(np.concatenate([run.times_s, *times.values()]))
        longer = prolonged(run, every[-1])
        outputs = self.follow(self.machine(values, longer, initial), self._plan(longer, every))[0]
        found = outputs[np.searchsorted(every, run.times_s)]
        for channel, seen in times.items():
            column = self.output_names.index(channel)
            found[:, column] = outputs[np.searchsorted(every, seen), column]
        return found

    def run_batch(
        self, values: Floats, runs: Run | Sequence[Run], initial: Sequence[Mapping[str, float]] | None = None
    ) -> list[Floats | SimulationError]:
        """Many runs at once: for each row of `values` (n, n_par) the outputs as `run` gives them, to the bit.

        `runs` and `initial` are one for each row; one run may serve for all. In place of a run that could not be
        carried out stands its error.
        """
        own = [runs] * len(values) if isinstance(runs, Run) else list(runs)
        starts = [{}] * len(values) if initial is None else list(initial)
        if not len(values) == len(own) == len(starts):
            raise SimulationError(
                f"{len(values)} rows of values, {len(own)} runs, {len(starts)} initial states"
            )
        found: list[Floats | SimulationError] = [SimulationError("not run")] * len(values)
        for run in dict.fromkeys(own):
            rows = [row for row, other in enumerate(own) if other is run]
            for first in range(0, len(rows), _AT_ONCE):
                some = rows[first : first + _AT_ONCE]
                for row, outputs in zip(some, self._together(values, run, starts, some), strict=True):
                    found[row] = outputs
        return found

    def _together(
        self, values: Floats, run: Run, starts: Sequence[Mapping[str, float]], rows: list[int]
    ) -> list[Floats | SimulationError]:
        """Some rows that share a run; late sensors need times of their own, and go one by one."""
        if self.assembled.delays or self.assembled.skews:
            return [self._alone(values[row], run, starts[row]) for row in rows]
        machine = self._machines(values[rows], run, [starts[row] for row in rows])
        outputs, _, statuses = self._integrate(machine, self._plan(run, run.times_s))
        return [
            self._failure(int(statuses[i]), machine, i, outputs[i], run.times_s) or outputs[i]
            for i in range(len(rows))
        ]

    def _alone(self, values: Floats, run: Run, initial: Mapping[str, float]) -> Floats | SimulationError:
        try:
            return self.run(values, run, initial)
        except SimulationError as error:
            return error

    def starts(self, values: Floats, run: Run, known: Mapping[str, Floats] | None = None) -> Floats:
        """States at the start, (n, n_states), for each row of `values`; `known` as for `until`."""
        return self._start(self._registers(values, run, known or {}), run)

    def until(
        self, flag: str, values: Floats, run: Run, known: Mapping[str, Floats] | None = None
    ) -> tuple[Floats, Floats]:
        """When a flag latches, (n,) s, and the states then, (n, n_states), for each row of `values` (n, n_par).

        `known` gives known quantities that differ from row to row, (n,) each. Raises `SimulationError`, also where
        the flag is never raised.
        """
        times, states = np.empty(len(values)), np.empty((len(values), len(self.state_names)))
        plan = self._plan(run, np.empty(0))
        for first in range(0, len(values), _AT_ONCE):
            some = slice(first, first + _AT_ONCE)
            own = {name: numbers[some] for name, numbers in (known or {}).items()}
            machine = self._machines(values[some], run, [{}] * len(values[some]), own)
            _, _, statuses = self._integrate(machine, plan, self.assembled.flags.index(flag))
            for row in np.flatnonzero(statuses != engine.STOPPED)[:1]:
                failure = self._failure(int(statuses[row]), machine, int(row), np.empty(0), plan.samples)
                late = f"{self.plant.name}: no {flag} until t = {run.times_s[-1]:.6g} s"
                raise failure or SimulationError(f"{late}{self._acting(machine.registers[row])}")
            times[some] = machine.starts[:, engine.CLOCK, engine.TIME]
            states[some] = machine.starts[:, engine.STATE, : states.shape[1]]
        return times, states

    def states(self, values: Floats, run: Run, initial: Mapping[str, float] | None = None) -> Floats:
        """States at the run's times, (n, n_states), SI."""
        return self.run_with_states(values, run, initial)[1]

    def run_with_states(
        self, values: Floats, run: Run, initial: Mapping[str, float] | None = None
    ) -> tuple[Floats, Floats]:
        """Outputs (n, n_outputs), delays of sensors left out, and states (n, n_states) at the run's times."""
        return self.follow(self.machine(values, run, initial), self._plan(run, run.times_s))

    def rates(self, values: Floats, run: Run, time_s: float, state: Floats) -> Floats:
        """Rates of all states, (n_states,), at a time and state, friction in the mode that the state implies."""
        machine = self.machine(values, run, dict(zip(self.state_names, state, strict=True)))
        plan = self._plan(run, np.empty(0))
        at = max(int(np.searchsorted(plan.breaks, time_s, side="right")) - 1, 0)
        inputs = plan.inputs[at : at + 1] + plan.slopes[at : at + 1] * (time_s - plan.breaks[at])
        here = Schedule(np.array([time_s]), inputs, plan.slopes[at : at + 1], plan.events, np.empty(0))
        self.follow(machine, here)
        found: Floats = machine.room[engine.RATE, : len(state)].copy()
        return found

    def _plan(self, run: Run, samples: Floats) -> Schedule:
        check_times(run.times_s)
        return schedule(self.plant.structure, run, self.assembled.flags, samples)

    def initial_values(self, values: Floats, run: Run) -> dict[str, float]:
        """Initial states by name; those to be fitted get a guess from the first samples, or 0."""
        state = self._start(self._registers(values[np.newaxis], run), run)
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
        with np.errstate(all="ignore"):
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
        modes = np.zeros((len(values), len(found)), dtype=np.int64)
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

    def follow(self, machine: Machine, plan: Schedule) -> tuple[Floats, Floats]:
        """Run a prepared machine (of one run) through a schedule: outputs and states at its samples."""
        outputs, states, statuses = self._integrate(machine, plan)
        failure = self._failure(int(statuses[0]), machine, 0, outputs[0], plan.samples)
        if failure is not None:
            raise failure
        return outputs[0], states[0]

    def _integrate(self, machine: Machine, plan: Schedule, stop: int = -1) -> tuple[Floats, Floats, Ints]:
        """Outputs (n, n_samples, n_outputs), states (n, n_samples, n_states), statuses (n,) of n machines."""
        count, samples = len(machine.registers), len(plan.samples)
        outputs = np.empty((count, samples, len(self.output_names)))
        states = np.empty((count, samples, len(self.state_names)))
        statuses = np.zeros(count, dtype=np.int64)
        program = self.assembled.program
        with np.errstate(all="ignore"):
            engine.integrate(program.code, program.table, *machine, *plan, stop, outputs, states, statuses)
        return outputs, states, statuses

    def _failure(
        self, status: int, machine: Machine, row: int, outputs: Floats, times: Floats
    ) -> SimulationError | None:
        """What went wrong in a run, in words, or None."""
        if status != engine.OK:
            room = machine.starts[row]
            pairs = zip(self.state_names, room[engine.STATE], strict=False)
            state = ", ".join(f"{name} = {value:.4g}" for name, value in pairs)
            reason = f"{_REASONS[status]} at t = {room[engine.CLOCK, engine.TIME]:.6f} s"
            return SimulationError(
                f"{self.plant.name}: {reason} ({state}){self._acting(machine.registers[row])}"
            )
        if not np.isfinite(outputs).all():
            sample, column = np.argwhere(~np.isfinite(outputs))[0]
            what = f"{self.output_names[column]} is not finite at t = {times[sample]:.6f} s"
            return SimulationError(f"{self.plant.name}: {what}")
        return None

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
        parameters[:, len(self.assembled.parameters) - 1] = run.times_s[0]
        with np.errstate(all="ignore"):
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
            late[channel] = Lateness(float(run.times_s[0]), delay, skew)
        return late


def compile_plant(
    plant: Plant,
    *,
    missing_force: str | None = None,
    extra: Mapping[str, Node] | None = None,
    relative_tolerance: float = RELATIVE_TOLERANCE,
) -> CompiledPlant:
    """Make a plant ready to run.

    `missing_force` names a balance that gets a constant unknown force as a further state of that name (unit: the
    balance's force); `extra` adds formulas of the plant's symbols to the outputs; `relative_tolerance` is the error
    allowed per integration step. Raises `PlantError`.
    """
    for use in plant.effects:
        check_values(plant, use, check_use(plant, use))
    model = compose(plant, missing_force)
    outputs = {**model.outputs, **(extra or {})}
    assembled = assemble(model, outputs, plant.source)
    flat = plant.flat()
    return CompiledPlant(
        plant=plant,
        model=model,
        assembled=assembled,
        parameter_names=tuple(flat),
        values=np.array([parameter.value for parameter in flat.values()], dtype=float),
        output_names=tuple(outputs),
        output_units=tuple(channel_unit(name) if name in model.outputs else "" for name in outputs),
        tolerances=Limits(relative_tolerance, _ABSOLUTE_TOLERANCE, _MAX_STEPS),
    )


def probes(plant: Plant, balance: str) -> dict[str, Node]:
    """Formulas for `extra`: velocity, position and load of a balance, as far as it has them."""
    place = plant.structure.balances[balance]
    found = {"velocity": place.velocity, "position": place.position, "load": place.load}
    return {f"{balance}.{name}": node for name, node in found.items() if node is not None}
