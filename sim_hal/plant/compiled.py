"""A plant made ready to run: many runs with other parameter values need no further preparation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sim_hal.plant import engine
from sim_hal.plant.assemble import Assembled, assemble, fitted
from sim_hal.plant.compose import Model, compose
from sim_hal.plant.engine import Limits, Machine, Schedule
from sim_hal.plant.expressions import Name, Node
from sim_hal.plant.plant import Plant, check_use, check_values
from sim_hal.plant.program import Floats, Program
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
            return self._integrate(values, run, initial, run.times_s)[0]
        times = {channel: late[channel].seen_s(run.times_s) for channel in late}
        every = np.unique(np.concatenate([run.times_s, *times.values()]))
        outputs = self._integrate(values, prolonged(run, every[-1]), initial, every)[0]
        found = outputs[np.searchsorted(every, run.times_s)]
        for channel, seen in times.items():
            column = self.output_names.index(channel)
            found[:, column] = outputs[np.searchsorted(every, seen), column]
        return found

    def states(self, values: Floats, run: Run, initial: Mapping[str, float] | None = None) -> Floats:
        """States at the run's times, (n, n_states), SI."""
        return self._integrate(values, run, initial, run.times_s)[1]

    def run_with_states(
        self, values: Floats, run: Run, initial: Mapping[str, float] | None = None
    ) -> tuple[Floats, Floats]:
        """Outputs (n, n_outputs), delays of sensors left out, and states (n, n_states) at the run's times."""
        return self._integrate(values, run, initial, run.times_s)

    def rates(self, values: Floats, run: Run, time_s: float, state: Floats) -> Floats:
        """Rates of all states, (n_states,), at a time and state, friction in the mode that the state implies."""
        machine = self.machine(values, run, dict(zip(self.state_names, state, strict=True)))
        plan = schedule(self.plant.structure, run, self.assembled.flags, np.empty(0))
        at = max(int(np.searchsorted(plan.breaks, time_s, side="right")) - 1, 0)
        machine.clock[0] = time_s
        rate = np.empty(len(state))
        engine.start(self.assembled.program, machine)
        with np.errstate(all="ignore"):
            status = engine.open_segment(self.assembled.program, machine, plan, at, rate)
        self._check(status, machine)
        return rate

    def initial_values(self, values: Floats, run: Run) -> dict[str, float]:
        """Initial states by name; those to be fitted get a guess from the first samples, or 0."""
        registers = self._registers(values, run)
        found = {name: float(registers[place]) for name, place in self.assembled.initial.items()}
        for name in self.fitted_initial_states:
            found[name] = self._guess(name, run)
        return {name: found[name] for name in self.state_names}

    def machine(self, values: Floats, run: Run, initial: Mapping[str, float] | None = None) -> Machine:
        """The engine's moving parts at the start of a run."""
        check_times(run.times_s)
        registers = self._registers(values, run)
        start = self.initial_values(values, run)
        for name, value in (initial or {}).items():
            if name not in start:
                raise SimulationError(f"no state {name!r} to start at; states: {', '.join(start)}")
            start[name] = value
        program = self.assembled.program
        by_name = dict(zip(self.parameter_names, values, strict=True))
        absent = {name for name, own in self.model.strengths.items() if not any(by_name[key] for key in own)}
        state = np.array(list(start.values()), dtype=float)
        span = run.times_s[-1] - run.times_s[0]
        modes = [self._mode(element.strengths, by_name) for element in self.model.elements]
        modes += [engine.IDLE if name in absent else 0 for name in self.model.memories]
        for node in self.assembled.kinks:
            own = self.model.kinks.get(node)
            modes.append(engine.IDLE if own and not any(by_name[key] for key in own) else 0)
        for offset, place in enumerate(self.assembled.memory_initial):
            registers[program.layout.memory + offset] = registers[place]
        self._settle(registers, state, run.times_s[0], initial or {})
        return Machine(
            clock=np.array([run.times_s[0], 1e-5 * span if span > 0 else 1e-6, 0.0, 1e-4]),
            registers=registers,
            state=state,
            scale=np.abs(state),
            weight=np.array([0.0 if name in absent else 1.0 for name in start]),
            mode=np.array(modes, dtype=np.int64),
        )

    def _settle(self, registers: Floats, state: Floats, start_s: float, given: Mapping[str, float]) -> None:
        """Start the states that other states tell, such as a filter's, where those put them."""
        if not self.assembled.settled:
            return
        program = self.assembled.program
        layout = program.layout
        registers[layout.time] = start_s
        registers[layout.state : layout.state + len(state)] = state
        with np.errstate(all="ignore"):
            engine.execute(program.code, layout.sections[1], layout.sections[2], registers)
        for offset, name in enumerate(self.state_names):
            if name in self.assembled.settled and name not in given:
                state[offset] = registers[self.assembled.settled[name]]

    @staticmethod
    def _mode(strengths: tuple[str, ...] | None, values: Mapping[str, float]) -> int:
        return 0 if strengths is None or any(values[name] for name in strengths) else engine.OFF

    def _integrate(
        self, values: Floats, run: Run, initial: Mapping[str, float] | None, samples: Floats
    ) -> tuple[Floats, Floats]:
        machine = self.machine(values, run, initial)
        plan = schedule(self.plant.structure, run, self.assembled.flags, samples)
        return self.follow(machine, plan)

    def follow(self, machine: Machine, plan: Schedule) -> tuple[Floats, Floats]:
        """Run a prepared machine through a schedule: outputs and states at its samples."""
        outputs = np.empty((len(plan.samples), len(self.output_names)))
        states = np.empty((len(plan.samples), len(self.state_names)))
        with np.errstate(all="ignore"):
            engine.start(self.assembled.program, machine)
            status = engine.integrate(self.assembled.program, machine, plan, self.tolerances, outputs, states)
        self._check(status, machine)
        if not np.isfinite(outputs).all():
            row, column = np.argwhere(~np.isfinite(outputs))[0]
            raise SimulationError(
                f"{self.plant.name}: {self.output_names[column]} is not finite at t = {plan.samples[row]:.6f} s"
            )
        return outputs, states

    def _check(self, status: int, machine: Machine) -> None:
        if status != engine.OK:
            state = ", ".join(f"{n} = {v:.4g}" for n, v in zip(self.state_names, machine.state, strict=True))
            reason = f"{_REASONS[status]} at t = {machine.clock[0]:.6f} s"
            raise SimulationError(f"{self.plant.name}: {reason} ({state}){self._acting(machine)}")

    def _acting(self, machine: Machine) -> str:
        """In words, which effects the run had, with the values that it was made with."""
        first = self.assembled.program.layout.parameter
        place = {name: first + offset for offset, name in enumerate(self.assembled.parameters)}
        found = []
        for use in self.plant.effects:
            prefix = self.plant.prefix(use)
            values = {name: machine.registers[place[f"{prefix}.{name}"]] for name in use.parameters}
            found.append(f"{prefix} ({', '.join(f'{name} = {v:.4g}' for name, v in values.items())})")
        return f"; effects: {', '.join(found)}" if found else ""

    def _registers(self, values: Floats, run: Run) -> Floats:
        """The register file with all parameters, and what depends on them alone, filled in."""
        if len(values) != len(self.parameter_names):
            raise SimulationError(f"{len(values)} parameter values, {len(self.parameter_names)} expected")
        by_name = dict(zip(self.parameter_names, values, strict=True))
        if not np.isfinite(values).all():
            wrong = next(name for name, value in by_name.items() if not np.isfinite(value))
            raise SimulationError(f"{self.plant.name}: {wrong} = {by_name[wrong]} is not a finite number")
        by_name |= self._surface(by_name, run)
        program: Program = self.assembled.program
        registers = program.registers.copy()
        for offset, name in enumerate(self.assembled.parameters[:-1]):
            if name in by_name:
                value = by_name[name]
            elif name in self.plant.structure.known:
                value = self._known(name, run)
            else:
                value = np.nan  # optional and absent: nothing may use it
            registers[program.layout.parameter + offset] = value
        registers[program.layout.parameter + len(self.assembled.parameters) - 1] = run.times_s[0]
        with np.errstate(all="ignore"):
            engine.execute(program.code, 0, program.layout.sections[1], registers)
        return registers

    def _surface(self, by_name: Mapping[str, float], run: Run) -> dict[str, float]:
        """Parameters of the surface that the run's conditions name."""
        if not self.plant.surfaces:
            return {}
        surface = run.conditions.get("surface")
        if surface not in self.plant.surfaces:
            known = ", ".join(self.plant.surfaces)
            raise SimulationError(
                f"conditions.surface = {surface!r} is not in the plant file; known: {known}"
            )
        return {name: by_name[f"{surface}.{name}"] for name in self.plant.structure.surface_parameters}

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
        registers = self._registers(values, run)
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
