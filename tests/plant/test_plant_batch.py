"""Many parameter sets at once: what each gives alone, to the bit, and its own error where one cannot be run."""

from __future__ import annotations

import numpy as np
import pytest
from plant_helpers import hop_run, shipped, use_of

from sim_hal.plant.simulate import CompiledPlant, Run, SimulationError, compile_plant


def drive() -> tuple[CompiledPlant, Run]:
    """The drive that creeps, warms up and sticks."""
    plant = shipped("bb0b_drive")
    for physics_id, place, values in (
        ("stribeck_friction", "drive_torque", {"F_s": 1.5e-3, "v_s": 20.0}),
        ("winding_heating", "electrical", {"alpha": 0.0039, "R_th": 15.0, "C_th": 20.0}),
        ("string_creep", "spring_force", {"compliance": 5e-7, "tau": 5.0}),
    ):
        plant = plant.with_effect(use_of(plant, physics_id, place, values))
    times = np.arange(0.0, 1.5, 0.005)
    volts = np.where(times < 1.0, 6.0 * np.sin(9.0 * times), 0.0)
    return compile_plant(plant), Run(times, {"motor_voltage_v": np.round(volts, 2)})


def test_a_batch_is_its_runs_to_the_bit() -> None:
    compiled, run = drive()
    rows = compiled.values * (1.0 + 0.02 * np.random.default_rng(3).normal(size=(12, compiled.values.size)))
    starts = [{"omega": 10.0 * i} for i in range(12)]
    together = compiled.run_batch(rows, run, starts)
    for row, start, found in zip(rows, starts, together, strict=True):
        assert not isinstance(found, SimulationError)
        assert np.array_equal(found, compiled.run(row, run, start))


def test_rows_may_have_runs_of_their_own() -> None:
    compiled = compile_plant(shipped("bb0b_hop"))
    times = np.arange(0.0, 0.3, 1e-3)
    runs = [hop_run(times, compression=s) for s in (0.02, 0.03)]
    order = [runs[0], runs[1], runs[0]]
    found = compiled.run_batch(np.tile(compiled.values, (3, 1)), order)
    for run, outputs in zip(order, found, strict=True):
        assert np.array_equal(outputs, compiled.run(compiled.values, run))
    assert not np.array_equal(found[0], found[1])


def test_a_row_that_cannot_be_run_has_its_error_and_harms_no_other() -> None:
    compiled, run = drive()
    short = compiled.tolerances._replace(steps=400)
    limited = CompiledPlant(**{**vars(compiled), "tolerances": short})
    quiet = Run(run.times_s, {"motor_voltage_v": np.zeros_like(run.times_s)})
    rows = np.tile(compiled.values, (3, 1))
    found = limited.run_batch(rows, [quiet, run, quiet])
    assert isinstance(found[1], SimulationError)
    with pytest.raises(SimulationError, match=r"more than the allowed number of steps .*stribeck_friction"):
        raise found[1]
    assert np.array_equal(found[0], compiled.run(rows[0], quiet))
    assert np.array_equal(found[2], found[0])


def test_rows_without_their_runs_are_refused() -> None:
    compiled, run = drive()
    with pytest.raises(SimulationError, match="2 rows of values, 1 runs, 2 initial states"):
        compiled.run_batch(np.tile(compiled.values, (2, 1)), [run])
