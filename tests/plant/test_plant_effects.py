"""Each effect of the catalogue: acts where it says, has the size it says, and is nothing at zero strength."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from plant_helpers import block, hop_run, plant_of, pushed, shipped, simulate, states, use_of

from sim_hal.plant import effects
from sim_hal.plant.effects import manual
from sim_hal.plant.effects.base import Effect, EffectParameter, Form, prior
from sim_hal.plant.plant import EffectUse, Plant
from sim_hal.plant.simulate import PlantError, Run, catalogue, compile_plant, load_plant, save_plant

TIMES = np.arange(0.0, 2.0, 0.005)
DRIVE = Run(TIMES, {"motor_voltage_v": np.where(TIMES < 1.2, 9.0, np.where(TIMES < 1.6, -4.0, 2.0))})
HOP = hop_run(np.arange(0.0, 0.3, 0.0006), hop_index=2.0, tilt_deg=20.0)
PUSH = pushed(TIMES, 8.0 * np.sin(6.0 * TIMES))
RIGS = {"drive": ("bb0b_drive", DRIVE), "hop": ("bb0b_hop", HOP)}
SCALES = {
    "F": 4.0,
    "A_sin": 0.08,
    "A_cos": 0.08,
    "M": 2.0,
    "V": 0.6,
    "T": 2.0,
    "Y": 0.2,
    "X": 0.2,
    "X_low": -0.1,
    "X_high": 0.1,
    "X_mid": 0.0,
    "P": 0.01,
}
DRIVE_SCALES = SCALES | {
    "F": 5e-3,
    "A_sin": 1e-4,
    "A_cos": 1e-4,
    "M": 2e-6,
    "V": 600.0,
    "X": 2.5e-3,
    "X_low": 0.0,
    "X_high": 2.5e-3,
    "X_mid": 1.2e-3,
    "P": 1.2e-4,
}


def rig(name: str) -> tuple[Plant, Run, dict[str, float]]:
    if name == "block":
        return plant_of(block("push_n - k * q")), PUSH, SCALES
    plant = shipped(RIGS[name][0])
    scales = DRIVE_SCALES if name == "drive" else SCALES
    return plant, RIGS[name][1], scales | {key: item.value for key, item in plant.parameters.items()}


def readings(values: np.ndarray) -> dict[str, float]:
    return {"Y": float(np.ptp(values)), "Y_max": float(np.max(np.abs(values))), "S": 1e-3}


def uses(name: str) -> Iterator[tuple[Effect, EffectUse, Form]]:
    """Every effect in every place of a rig, at its start values."""
    plant, run, scales = rig(name)
    nominal = simulate(plant, run)
    for effect in catalogue().values():
        for equation, channel in plant.places(effect):
            balance = plant.balance(effect, equation)
            form = plant.form(effect, None if effect.kind == "sensor" else balance, channel)
            assert form is not None
            own = scales | ({} if channel is None else readings(nominal[channel]))
            values = {item.name: prior(item, own)[0] for item in form.parameters}
            yield effect, use_of(plant, effect.physics_id, equation, values, channel), form


CASES = [
    pytest.param(name, use, form, id=f"{name}-{use.physics_id}-{use.channel or use.equation}")
    for name in ("block", "drive", "hop")
    for _, use, form in uses(name)
]


@pytest.mark.parametrize(("name", "use", "form"), CASES)
def test_the_effect_acts_and_is_nothing_at_zero_strength(name: str, use: EffectUse, form: Form) -> None:
    plant, run, _ = rig(name)
    nominal = simulate(plant, run)
    acting = plant.with_effect(use)
    changed = simulate(acting, run)
    assert all(np.isfinite(values).all() for values in changed.values())
    moved = max(np.max(np.abs(changed[key] - nominal[key])) / np.ptp(nominal[key]) for key in nominal)
    assert moved > 1e-6
    strengths = [item.name for item in form.parameters if item.strength]
    assert strengths
    absent = simulate(acting.with_values({f"{plant.prefix(use)}.{key}": 0.0 for key in strengths}), run)
    for key, values in nominal.items():
        assert np.array_equal(values, absent[key])


@pytest.mark.parametrize("name", ["block", "drive", "hop"])
def test_every_effect_has_its_place_on_some_rig(name: str) -> None:
    found = {use.physics_id for rig_name in ("block", "drive", "hop") for _, use, _ in uses(rig_name)}
    assert found == set(catalogue())
    for _, use, _ in uses(name):
        assert use.equation


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_zero_strength_is_nothing_whatever_the_shape(data: st.DataObject) -> None:
    """Widths, time constants and the like anywhere in their range: not a bit of any channel changes."""
    name = data.draw(st.sampled_from(("block", "drive", "hop")))
    plant, run, scales = rig(name)
    _, use, form = data.draw(st.sampled_from(list(uses(name))), label="use")
    values = dict.fromkeys(use.parameters, 0.0)
    for item in form.parameters:
        if not item.strength:
            _, low, high = prior(item, scales | {"Y_max": 1.0, "S": 1e-3})
            values[item.name] = data.draw(st.floats(low, high), label=item.name)
    absent = plant.with_effect(use_of(plant, use.physics_id, use.equation, values, use.channel))
    nominal = simulate(plant, run)
    for key, found in simulate(absent, run).items():
        assert np.array_equal(found, nominal[key])


@pytest.mark.parametrize("name", ["block", "drive", "hop"])
def test_all_effects_of_a_rig_together_in_any_order(name: str, tmp_path: Path) -> None:
    """Each in its own place: dry friction on body, leg and between them would hold two motions by three forces."""
    plant, run, _ = rig(name)
    alone = len(plant.structure.balances) == 1
    chosen = [(use, form) for effect, use, form in uses(name) if alone or use.equation == effect.equation]
    forward = backward = plant
    for use, _ in chosen:
        forward = forward.with_effect(use)
    for use, _ in reversed(chosen):
        backward = backward.with_effect(use)
    first, second = simulate(forward, run), simulate(backward, run)
    for key, values in first.items():
        assert np.isfinite(values).all()
        assert np.array_equal(values, second[key])
    save_plant(forward, tmp_path / "plant.yaml")
    again = simulate(load_plant(tmp_path / "plant.yaml"), run)
    assert all(np.array_equal(first[key], again[key]) for key in first)
    strengths = [
        f"{plant.prefix(use)}.{p.name}" for use, form in chosen for p in form.parameters if p.strength
    ]
    absent, nominal = simulate(forward.with_values(dict.fromkeys(strengths, 0.0)), run), simulate(plant, run)
    assert all(np.array_equal(nominal[key], absent[key]) for key in nominal)


def coasting(physics_id: str, values: dict[str, float]) -> Any:
    """Speeds of the block, thrown at 1 m/s, with one effect."""
    plant = plant_of(block())
    with_it = plant.with_effect(use_of(plant, physics_id, "force_balance", values))
    return states(with_it, pushed(TIMES, 0.0), {"v": 1.0})["v"]


def test_sizes_of_friction_in_closed_form() -> None:
    assert np.allclose(
        coasting("coulomb_friction", {"F_c": 1.6}), np.maximum(0.0, 1.0 - 0.8 * TIMES), atol=1e-9
    )
    assert np.allclose(coasting("viscous_friction", {"F_v": 3.0}), np.exp(-1.5 * TIMES), atol=1e-8)
    assert np.allclose(coasting("quadratic_friction", {"F_q": 3.0}), 1.0 / (1.0 + 1.5 * TIMES), atol=1e-8)
    assert np.allclose(coasting("asymmetric_friction", {"F_o": 3.0}), 1.0 - 1.5 * TIMES, atol=1e-10)
    assert np.allclose(coasting("aerodynamic_drag_linear", {"d": 3.0}), np.exp(-1.5 * TIMES), atol=1e-8)
    drag = coasting("aerodynamic_drag_quadratic", {"cd_a": 2.0, "rho": 1.2})
    assert np.allclose(drag, 1.0 / (1.0 + 0.6 * TIMES), atol=1e-8)
    assert np.allclose(coasting("buoyancy", {"B": 3.0}), 1.0 + 1.5 * TIMES, atol=1e-10)


def test_stribeck_friction_holds_more_than_it_slides() -> None:
    plant = plant_of(block())
    with_it = plant.with_effect(
        use_of(plant, "stribeck_friction", "force_balance", {"F_s": 1.0, "v_s": 0.05})
    )
    assert np.all(states(with_it, pushed(TIMES, 0.99))["q"] == 0.0)
    fast = simulate(with_it, pushed(TIMES, 0.0), {"v": 1.0})["acceleration_m_s2"]
    assert np.allclose(fast, 0.0, atol=1e-12)  # no drag far above v_s


def test_friction_at_a_place_acts_there_only() -> None:
    plant = plant_of(block())
    bump = use_of(
        plant, "position_dependent_friction", "force_balance", {"F_p": 4.0, "x_p": 0.5, "w_p": 0.05}
    )
    compiled = compile_plant(plant.with_effect(bump), relative_tolerance=1e-9)
    speed = compiled.states(compiled.values, pushed(TIMES, 0.0), {"v": 1.0})[:, 1]
    lost = 4.0 * 0.05 * np.sqrt(np.pi)  # the bump's area is the energy taken
    assert speed[-1] == pytest.approx(np.sqrt(1.0 - lost), abs=1e-8)


def test_load_friction_and_inertia_in_closed_form() -> None:
    plant = plant_of(block())
    rubbing = plant.with_effect(use_of(plant, "load_dependent_friction", "force_balance", {"mu": 0.25}))
    assert np.allclose(states(rubbing, pushed(TIMES, 2.0))["v"], 0.75 * TIMES, atol=1e-10)
    heavy = plant.with_effect(use_of(plant, "added_inertia", "force_balance", {"m_a": 0.5}))
    assert np.allclose(states(heavy, pushed(TIMES, 2.0))["v"], 2.0 / 2.5 * TIMES, atol=1e-10)
    light = plant.with_effect(use_of(plant, "coulomb_friction", "force_balance", {"F_c": 1.0}))
    both = light.with_effect(use_of(plant, "added_inertia", "force_balance", {"m_a": 0.5}))
    assert np.allclose(states(both, pushed(TIMES, 2.0))["v"], 1.0 / 2.5 * TIMES, atol=1e-10)


def test_ripple_is_conservative() -> None:
    plant = plant_of(block())
    values = {"F_sin": 1.5, "F_cos": 0.5, "period": 0.1}
    rippled = plant.with_effect(use_of(plant, "torque_ripple", "force_balance", values))
    found = states(rippled, pushed(TIMES, 0.0), {"v": 1.0})
    wave = 2 * np.pi / 0.1
    potential = (1.5 * np.cos(wave * found["q"]) - 0.5 * np.sin(wave * found["q"])) / wave
    assert np.allclose(found["v"] ** 2 + potential, 1.0 + 1.5 / wave, atol=1e-8)


def test_presliding_is_a_spring_at_first_and_dry_friction_in_the_end() -> None:
    plant = plant_of(block())
    dahl = plant.with_effect(
        use_of(plant, "presliding_hysteresis", "force_balance", {"F_d": 1.0, "s_p": 0.01})
    )
    small = simulate(dahl, pushed(TIMES, 0.0), {"v": 1e-3})
    turn = np.flatnonzero(small["speed_m_s"] < 0)[0]
    assert TIMES[turn] == pytest.approx(np.pi / 2 / np.sqrt(100.0 / 2.0), rel=0.05)  # stiffness F_d / s_p
    far = simulate(dahl, pushed(TIMES, 0.0), {"v": 3.0})
    assert far["acceleration_m_s2"][-1] == pytest.approx(-0.5, rel=1e-6)


def steady_current(physics_id: str, values: dict[str, float], voltage: float = 6.0) -> float:
    """Current of the drive with its shaft held by dry friction."""
    plant = shipped("bb0b_drive").with_values({"tau_c": 1.0})
    effect = catalogue()[physics_id]
    with_it = plant.with_effect(use_of(plant, physics_id, effect.equation, values))
    run = Run(np.array([0.0, 0.1]), {"motor_voltage_v": np.array([voltage, voltage])})
    return float(simulate(with_it, run)["motor_current_a"][-1])


def test_electrical_effects_at_standstill() -> None:
    assert steady_current("brush_voltage_drop", {"U_b": 0.5}) == pytest.approx(5.5 / 3.3, rel=1e-6)
    assert steady_current("brush_voltage_drop", {"U_b": 0.5}, -6.0) == pytest.approx(-5.5 / 3.3, rel=1e-6)
    assert steady_current("brush_voltage_drop", {"U_b": 0.5}, 0.4) == 0.0
    assert steady_current("dead_time", {"U_d": 0.5}, -6.0) == pytest.approx(-5.5 / 3.3, rel=1e-6)
    assert steady_current("dead_time", {"U_d": 0.5}, 0.4) == pytest.approx(0.0, abs=1e-12)
    assert steady_current("supply_sag", {"R_s": 0.4, "U_s": 12.0}) == pytest.approx(6.0 / 3.4, rel=1e-6)


def test_a_held_winding_warms_up() -> None:
    plant = shipped("bb0b_drive").with_values({"tau_c": 1.0})
    values = {"alpha": 0.004, "R_th": 20.0, "C_th": 0.05}
    warm = plant.with_effect(use_of(plant, "winding_heating", "electrical", values))
    run = Run(np.array([0.0, 60.0]), {"motor_voltage_v": np.array([3.0, 3.0])})
    current = simulate(warm, run)["motor_current_a"][-1]
    resistance = 3.0 / current
    assert resistance == pytest.approx(3.3 * (1.0 + 0.004 * 20.0 * resistance * current**2), rel=1e-6)


def test_a_delayed_release_opens_later_by_as_much() -> None:
    plant = shipped("bb0b_hop")
    late = plant.with_effect(use_of(plant, "release_delay", "latch", {"delay": 0.003}))
    reading, shifted = simulate(plant, HOP), simulate(late, HOP)
    first, second = (
        np.flatnonzero(np.abs(v["body_acceleration_m_s2"] - 8.874) > 1.0)[0] for v in (reading, shifted)
    )
    assert second - first == pytest.approx(0.003 / 0.0006, abs=1)


def test_sensor_faults_change_the_reading_and_nothing_else() -> None:
    plant = shipped("bb0b_hop")
    nominal = simulate(plant, HOP)
    channel = "spring_compression_m"
    expected = {
        "sensor_scale": ({"scale": 0.1}, 1.1 * nominal[channel]),
        "sensor_bias": ({"bias": 0.001}, nominal[channel] + 0.001),
        "sensor_drift": ({"drift": 0.01}, nominal[channel] + 0.01 * HOP.times_s),
    }
    for physics_id, (values, reading) in expected.items():
        faulty = simulate(plant.with_effect(use_of(plant, physics_id, "sensor", values, channel)), HOP)
        assert np.allclose(faulty[channel], reading, rtol=1e-12, atol=1e-15)
        for other in set(nominal) - {channel}:
            assert np.array_equal(faulty[other], nominal[other])
    late = use_of(plant, "sensor_delay", "sensor", {"delay": 0.0012}, channel)  # two samples
    delayed = simulate(plant.with_effect(late), HOP)[channel]
    assert np.allclose(delayed[2:], nominal[channel][:-2], rtol=0, atol=1e-9)


def test_statements_and_taxonomy_agree() -> None:
    path = Path(__file__).resolve().parents[2] / "../shared/physics-taxonomy.yaml"
    if not path.is_file():
        pytest.skip("the taxonomy is not at hand")
    taxonomy = yaml.safe_load(path.read_text())["physics"]
    no_effects = {"parameter_out_of_tolerance", "unlisted"}  # verdicts of a diagnosis
    assert set(taxonomy) == set(catalogue()) | no_effects
    for physics_id, effect in catalogue().items():
        entry = dict(taxonomy[physics_id])
        assert effect.equation == entry.pop("where")
        # A comma in an unquoted sentence splits it: the rest stands as keys without a value.
        assert effect.says == ", ".join([entry.pop("says"), *entry])


def test_every_effect_enters_its_own_equation_on_a_rig_that_has_it() -> None:
    """On the drive or the hop, an axis or a drop: where the taxonomy puts it, with all its scales at hand."""
    bodies = "{format: 1, plant: p, kind: %s, parameters: {m: {value: 1, std: 0, unit: kg}%s}}"
    rigs = [shipped("bb0b_drive"), shipped("bb0b_hop"), plant_of(bodies % ("axis", ""))]
    rigs.append(plant_of(bodies % ("drop", ", g: {value: 9.81, std: 0, unit: m/s^2}")))
    for physics_id, effect in catalogue().items():
        places = {equation for plant in rigs[:2] for equation, _ in plant.places(effect)}
        assert effect.equation in places, physics_id
        where = {equation for plant in rigs for equation, _ in plant.places(effect)}
        assert where <= {effect.equation, *(name for plant in rigs for name in plant.structure.balances)}
    assert len(catalogue()) == 49


def test_sentences_take_the_values() -> None:
    for effect in catalogue().values():
        for form in effect.forms:
            said = effect.describe({item.name: 1.25 for item in form.parameters})
            assert "1.25" in said and "{" not in said


def test_a_package_adds_an_effect_by_an_entry_point(monkeypatch: pytest.MonkeyPatch) -> None:
    own = Effect(
        physics_id="unlisted",
        equation="any",
        says="none of the names fits; a formula is given",
        sentence="A force cubic in speed acts, {a}.",
        citation="test",
        forms=(
            Form(
                (EffectParameter("a", "force/velocity**3", "1", "0", "2", strength=True),),
                force="-a * v ** 3",
            ),
        ),
    )
    monkeypatch.setattr(EntryPoint, "load", lambda self: own)
    monkeypatch.setattr(effects, "entry_points", lambda group: [EntryPoint("mine", "x:y", group)])
    catalogue.cache_clear()
    try:
        assert np.allclose(coasting("unlisted", {"a": 1.0}), 1.0 / np.sqrt(1.0 + TIMES), atol=1e-8)
        monkeypatch.setattr(EntryPoint, "load", lambda self: (own, "no effect"))
        catalogue.cache_clear()
        with pytest.raises(PlantError, match="not an Effect"):
            catalogue()
    finally:
        monkeypatch.undo()
        catalogue.cache_clear()


@pytest.mark.parametrize(
    ("physics_id", "equation", "channel", "values", "words"),
    [
        ("wishful_thinking", "force_balance", None, {}, "is not known; known: added_inertia"),
        (
            "coulomb_friction",
            "kinematics",
            None,
            {"F_c": 1.0},
            "is no balance it can enter; known: force_balance",
        ),
        ("coulomb_friction", "force_balance", None, {"F": 1.0}, "parameters must be F_c; look at F, F_c"),
        ("sensor_bias", "sensor", "noise_m", {"bias": 1.0}, "is no output of the plant; known: position_m"),
        ("backlash", "transmission", None, {"width": 1.0}, "cannot act on a plant of kind equations"),
    ],
)
def test_an_effect_that_cannot_act_is_refused(
    physics_id: str, equation: str, channel: str | None, values: dict[str, float], words: str
) -> None:
    plant = plant_of(block())
    with pytest.raises(PlantError, match=words):
        plant.with_effect(use_of(plant, physics_id, equation, values, channel))


def test_the_same_effect_twice_in_one_place_is_refused() -> None:
    plant = plant_of(block())
    use = use_of(plant, "viscous_friction", "force_balance", {"F_v": 1.0})
    with pytest.raises(PlantError, match="viscous_friction stands there twice"):
        plant.with_effect(use).with_effect(use)


def test_names_of_parameters_carry_the_equation_where_there_are_several() -> None:
    one = plant_of(block())
    one = one.with_effect(use_of(one, "coulomb_friction", "force_balance", {"F_c": 1.0}))
    assert compile_plant(one).parameter_names == ("m", "k", "coulomb_friction.F_c")
    hop = shipped("bb0b_hop")
    hop = hop.with_effect(use_of(hop, "sleeve_friction", "body_momentum", {"F_f": 1.0}))
    names = compile_plant(hop).parameter_names
    assert "quartz_sand.k_l" in names and names[-1] == "body_momentum.sleeve_friction.F_f"
    assert hop.with_values({names[-1]: 2.5}).effects[0].parameters["F_f"].value == 2.5


def test_the_manual_lists_every_effect_with_its_formulas() -> None:
    text = (Path(__file__).resolve().parents[2] / "docs" / "plants.md").read_text()
    listed = [
        line for line in text.splitlines() if line.startswith("| `") and line.split("`")[1] in catalogue()
    ]
    assert listed == manual.rows()  # `python -m sim_hal.plant.effects.manual` prints them
