"""What is unphysical, unknown or too stiff is refused by name; nothing becomes a silent NaN."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from plant_helpers import block, hop_run, plant_of, pushed, shipped, simulate, use_of

from sim_hal.plant.engine import CLOCK, STEPS, Limits
from sim_hal.plant.simulate import Plant, PlantError, Run, SimulationError, catalogue, compile_plant

TIMES = np.arange(0.0, 0.3, 0.003)
DRIVE = Run(TIMES, {"motor_voltage_v": np.full(TIMES.shape, 9.0)})

OUTSIDE = [
    (
        "drive",
        "string_creep",
        "spring_force",
        {"compliance": 1e-6, "tau": 0.0},
        "string_creep.tau: 0.0 must be above 0",
    ),
    (
        "drive",
        "coulomb_friction",
        "drive_torque",
        {"F_c": -1e-4},
        "coulomb_friction.F_c: -0.0001 must not be below 0",
    ),
    (
        "drive",
        "presliding_hysteresis",
        "drive_torque",
        {"s_p": 1.0, "share": 1.5},
        "presliding_hysteresis.share: 1.5 must not be above 1",
    ),
    (
        "hop",
        "soil_compaction",
        "ground_contact",
        {"a": 1.0, "b": 1.1, "n_c": 2.0},
        "soil_compaction.b: 1.1 must not be",
    ),
    ("hop", "reel_inertia", "latch", {"m_r": float("nan")}, "reel_inertia.m_r: nan is not a finite number"),
]


@pytest.mark.parametrize(("rig", "physics_id", "equation", "values", "words"), OUTSIDE)
def test_unphysical_values_are_refused_by_name(
    rig: str, physics_id: str, equation: str, values: dict[str, float], words: str
) -> None:
    plant = shipped(f"bb0b_{rig}")
    with pytest.raises(PlantError, match=words):
        plant.with_effect(use_of(plant, physics_id, equation, values))


def test_a_file_and_a_later_value_are_held_to_the_same_limits() -> None:
    size = "{F_c: {value: %s, std: 0, unit: N}}"
    effect = f"{{physics_id: coulomb_friction, equation: force_balance, parameters: {size}}}"
    text = block(extra=f"effects: [{effect}]")
    with pytest.raises(
        PlantError, match=r"test\.yaml: effects: coulomb_friction\.F_c: -1\.0 must not be below 0"
    ):
        plant_of(text % "-1.0")
    with pytest.raises(PlantError, match=r"coulomb_friction\.F_c: -2\.0 must not be below 0"):
        compile_plant(plant_of(text % "1.0").with_values({"coulomb_friction.F_c": -2.0}))


def test_every_range_of_the_catalogue_is_physical() -> None:
    """Starts of 0 and plain numbers as limits: what a search may try is never refused."""
    for effect in catalogue().values():
        for parameter in (p for form in effect.forms for p in form.parameters):
            for text in (parameter.start, parameter.low, parameter.high, *parameter.also):
                try:
                    value = float(text)
                except ValueError:
                    continue  # scaled to the rig; all scales are positive
                assert parameter.fault(value) is None, (effect.physics_id, parameter.name, text)
            if parameter.above is not None and parameter.above >= 0.0:
                assert not parameter.low.startswith("-") and parameter.low != "0"


def test_a_run_that_cannot_be_held_names_the_effects_with_their_values() -> None:
    plant = shipped("bb0b_hop")
    stiff = plant.with_effect(use_of(plant, "soil_rate_dependence", "ground_contact", {"c_g": 1e11}))
    compiled = compile_plant(stiff)
    compiled = replace(compiled, tolerances=Limits(1e-8, 1e-13, 50_000))
    with pytest.raises(SimulationError, match=r"ground_contact\.soil_rate_dependence \(c_g = 1e\+11\)"):
        compiled.run(compiled.values, hop_run(TIMES))


def test_a_value_that_is_no_number_is_refused_by_name() -> None:
    compiled = compile_plant(shipped("bb0b_drive"))
    values = compiled.values.copy()
    values[compiled.parameter_names.index("eta")] = np.nan
    with pytest.raises(SimulationError, match="eta = nan is not a finite number"):
        compiled.run(values, DRIVE)


SIZES = st.floats(min_value=-30.0, max_value=30.0, allow_nan=False).map(lambda exponent: 10.0**exponent)


@pytest.mark.parametrize("rig", ["block", "drive", "hop"])
@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_any_values_give_numbers_or_a_refusal(rig: str, data: st.DataObject) -> None:
    plant = plant_of(block("push_n - k * q")) if rig == "block" else shipped(f"bb0b_{rig}")
    run = {"block": pushed(TIMES, 3.0), "drive": DRIVE, "hop": hop_run(TIMES, hop_index=2.0, tilt_deg=20.0)}[
        rig
    ]
    places = [(effect, *place) for effect in catalogue().values() for place in plant.places(effect)]
    effect, equation, channel = data.draw(st.sampled_from(places))
    balance = None if effect.kind == "sensor" else plant.balance(effect, equation)
    form = plant.form(effect, balance, channel)
    assert form is not None
    values = {item.name: data.draw(SIZES, label=item.name) for item in form.parameters}
    try:
        odd = plant.with_effect(use_of(plant, effect.physics_id, equation, values, channel))
        compiled = compile_plant(odd)
        compiled = replace(compiled, tolerances=Limits(1e-8, 1e-13, 20_000))
        outputs = compiled.run(compiled.values, run)
    except (PlantError, SimulationError) as error:
        assert effect.physics_id in str(error) or "not finite" in str(error)
    else:
        assert np.isfinite(outputs).all()


def test_weak_effects_are_close_to_none() -> None:
    """A strength of 1e-6 of its start moves nothing by more than a thousandth: there is no jump at zero."""
    plant = shipped("bb0b_hop")
    run = hop_run(TIMES, hop_index=2.0, tilt_deg=20.0)
    nominal = simulate(plant, run)
    for physics_id, values in {
        "structural_flexure": {"mu": 1e-7, "f": 60.0, "zeta": 0.02},
        "soil_added_mass": {"m_a": 1e-7, "y_p": 5e-4},
        "reel_inertia": {"m_r": 1e-7},
        "soil_compaction": {"a": 1e-7, "b": 1e-7, "n_c": 2.0},
        "foot_slip": {"s": 1e-7, "mu": 0.1},
    }.items():
        effect = catalogue()[physics_id]
        weak = simulate(plant.with_effect(use_of(plant, physics_id, effect.equation, values)), run)
        for channel, reading in nominal.items():
            assert np.allclose(weak[channel], reading, rtol=0, atol=1e-3 * np.ptp(reading)), physics_id


def steps_of(plant: Plant, run: Run) -> float:
    """Steps that the integrator tried."""
    compiled = compile_plant(plant)
    machine = compiled.machine(compiled.values, run)
    compiled.follow(machine, compiled._plan(run, run.times_s))
    return float(machine.starts[0, CLOCK, STEPS])


def test_a_drag_that_sets_in_at_rest_takes_no_tiny_steps() -> None:
    """The leg rests where the lock opens, and the drag acts from there on: no jump just behind a step's start."""
    plant, run = shipped("bb0b_hop"), hop_run(np.array([0.0, 0.066]))  # before the drag has faded
    plant = plant.with_effect(use_of(plant, "sleeve_friction", "body_momentum", {"F_f": 3.0}))
    dragged = plant.with_effect(use_of(plant, "latch_drag", "latch", {"F_d": 25.0, "t_f": 0.012}))
    assert steps_of(dragged, run) < 1.2 * steps_of(plant, run)
