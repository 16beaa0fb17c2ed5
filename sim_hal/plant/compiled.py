"""A plant made ready to run: many runs with other parameter values need no further preparation."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sim_hal.plant import engine
from sim_hal.plant.assemble import assemble
from sim_hal.plant.compose import compose
from sim_hal.plant.engine import Limits, Machine, Schedule
from sim_hal.plant.expressions import Node
from sim_hal.plant.plant import Plant, check_use, check_values
from sim_hal.plant.program import Floats, Ints
from sim_hal.plant.run import (
    Run,
    SimulationError,
    check_times,
    prolonged,
    schedule,
)
from sim_hal.plant.starting import Starting
from sim_hal.plant.units import channel_unit

#: Error per step relative to each state (runs of the shipped rigs come out within 1e-7 of their outputs' ranges), a
#: floor for states that stay at zero, and a limit of work.
RELATIVE_TOLERANCE = 1e-6
_ABSOLUTE_TOLERANCE = 1e-13
_MAX_STEPS = 20_000_000
_AT_ONCE = 256  # runs whose workspace is held in memory together

_REASONS = {
    engine.NOT_FINITE: "the solution stops being a finite number",
    engine.STEP_VANISHED: "the equations change too fast to be followed (step size vanished)",
    engine.TOO_MANY_STEPS: "more than the allowed number of steps",
    engine.CHATTER: "modes change endlessly without time passing",
    engine.EMPTY_BAND: "dry friction is negative: forward and backward resistance add up to less than 0",
    engine.NO_GRIP: "two friction elements hold the same motion in different ways",
}


Rows = list[list[float]]
"""Outputs at some times, (n, n_outputs), as plain numbers."""


@dataclass(frozen=True)
class CompiledPlant(Starting):
    """Runs of one plant structure with any parameter values. Made by `compile_plant`.

    parameter_names, values: (n_par,), flat names and nominal values (SI). output_units by channel.
    balances: where a missing force may enter, by name.
    """

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
            if (
                self.plant.kind == "equations" and run.times_s.size > 1
            ):  # it may well have moved before the start
                step = float(run.times_s[1] - run.times_s[0])
                first, second = outputs[np.searchsorted(every, run.times_s[:2]), column]
                found[:, column] -= (second - first) / step * late[channel].before_s(run.times_s)
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

    def until(
        self, flag: str, values: Floats, run: Run, known: Mapping[str, Floats] | None = None
    ) -> tuple[Floats, Floats]:
        """States, (n, n_states), at the start and when a flag latches, for each row of `values` (n, n_par).

        `known` gives known quantities that differ from row to row, (n,) each. Raises `SimulationError`, also where
        the flag is never raised.
        """
        before, after = np.empty((2, len(values), len(self.state_names)))
        plan = self._plan(run, np.empty(0))
        for first in range(0, len(values), _AT_ONCE):
            some = slice(first, first + _AT_ONCE)
            own = {name: numbers[some] for name, numbers in (known or {}).items()}
            machine = self._machines(values[some], run, [{}] * len(values[some]), own)
            states = machine.starts[:, engine.STATE, : after.shape[1]]
            before[some] = states
            _, _, statuses = self._integrate(machine, plan, self.assembled.flags.index(flag))
            for row in np.flatnonzero(statuses != engine.STOPPED)[:1]:
                failure = self._failure(int(statuses[row]), machine, int(row), np.empty(0), plan.samples)
                late = f"{self.plant.name}: no {flag} until t = {run.times_s[-1]:.6g} s"
                raise failure or SimulationError(f"{late}{self._acting(machine.registers[row])}")
            after[some] = states
        return before, after

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

    def follow(self, machine: Machine, plan: Schedule) -> tuple[Floats, Floats]:
        """Run a prepared machine (of one run) through a schedule: outputs and states at its samples."""
        outputs, states, statuses = self._integrate(machine, plan)
        failure = self._failure(int(statuses[0]), machine, 0, outputs[0], plan.samples)
        if failure is not None:
            raise failure
        return outputs[0], states[0]

    def stepper(self, machine: Machine, plan: Schedule) -> Callable[[], Rows]:
        """What runs a machine (of one run) through a schedule, as its arrays are then: outputs at the samples."""
        outputs, states, statuses = self._results(1, len(plan.samples))
        program = self.assembled.program
        run = engine.integrate.bound(
            program.code, program.table, *machine, *plan, -1, outputs, states, statuses
        )

        seen, status = outputs[0], statuses.data

        def step() -> Rows:
            run()
            rows: Rows = seen.tolist()
            # a sum tells at once whether all are finite
            if status[0] != engine.OK or not math.isfinite(sum(map(sum, rows))):
                failure = self._failure(status[0], machine, 0, seen, plan.samples)
                if failure is not None:
                    raise failure
            return rows

        return step

    def _results(self, count: int, samples: int) -> tuple[Floats, Floats, Ints]:
        """Room for what `_integrate` gives."""
        outputs = np.empty((count, samples, len(self.output_names)))
        return outputs, np.empty((count, samples, len(self.state_names))), np.zeros(count, dtype=np.int64)

    def _integrate(self, machine: Machine, plan: Schedule, stop: int = -1) -> tuple[Floats, Floats, Ints]:
        """Outputs (n, n_samples, n_outputs), states (n, n_samples, n_states), statuses (n,) of n machines."""
        outputs, states, statuses = self._results(len(machine.registers), len(plan.samples))
        program = self.assembled.program
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
