"""A part of a recording means what the whole one means: time since the start goes on in it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plant_helpers import block, plant_of, use_of

from sim_hal.plant.simulate import Plant, Run, compile_plant

TIMES = 0.01 * np.arange(400)
CUT = 150


def driven() -> Run:
    return Run(TIMES, {"push_n": 3.0 * np.sin(4.0 * TIMES)})


def part_of(run: Run, origin_s: float | None) -> Run:
    inputs = {name: values[CUT:] for name, values in run.inputs.items()}
    return replace(run, times_s=TIMES[CUT:], inputs=inputs, origin_s=origin_s)


def rig(physics_id: str, **values: float) -> Plant:
    plant = plant_of(block(extra="", force="push_n - k * q"))
    return plant.with_effect(use_of(plant, physics_id, "sensor", values, "position_m"))


def whole_and_part(plant: Plant, origin_s: float | None) -> tuple[np.ndarray, np.ndarray]:
    """Positions from the cut on, read from the whole run and from the part that starts where the whole one is."""
    compiled = compile_plant(plant)
    whole = compiled.run(compiled.values, driven())
    start = dict(zip(compiled.state_names, compiled.states(compiled.values, driven())[CUT], strict=True))
    part = compiled.run(compiled.values, part_of(driven(), origin_s), start)
    return whole[CUT:, 0], part[:, 0]


@pytest.mark.parametrize(
    ("physics_id", "values"), [("sensor_drift", {"drift": 0.02}), ("clock_skew", {"skew": 0.03})]
)
def test_a_part_reads_what_the_whole_run_reads_and_without_its_origin_it_does_not(
    physics_id: str, values: dict[str, float]
) -> None:
    # a clock that is off by 3 % of up to 4 s looks beyond the part's end, where nothing is simulated
    seen = slice(0, -15 if physics_id == "clock_skew" else None)
    whole, part = whole_and_part(rig(physics_id, **values), TIMES[0])
    assert np.allclose(part[seen], whole[seen], rtol=0, atol=1e-7)
    whole, part = whole_and_part(rig(physics_id, **values), None)
    assert np.abs(part - whole)[seen].max() > 0.01


def test_a_plant_without_such_an_effect_does_not_ask_where_the_recording_began() -> None:
    whole, part = whole_and_part(plant_of(block(force="push_n - k * q")), -7.0)
    assert np.allclose(part, whole, rtol=0, atol=1e-7)


def test_a_run_that_says_it_is_whole_is_the_same_to_the_bit() -> None:
    compiled = compile_plant(rig("clock_skew", skew=-0.03))
    plain, said = (
        compiled.run(compiled.values, replace(driven(), origin_s=s)) for s in (None, float(TIMES[0]))
    )
    assert np.array_equal(plain, said)
