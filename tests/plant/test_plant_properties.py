"""What must hold whatever the numbers: energy, momentum, contact and stiction, on hops, drives and a plain block."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from plant_helpers import block, hop_run, plant_of, pushed, shipped, states, use_of

from sim_hal.plant.expressions import Name, Node, parse, rename
from sim_hal.plant.simulate import Plant, Run, catalogue, compile_plant

quickly = settings(max_examples=8, deadline=None, suppress_health_check=list(HealthCheck))
HOP = hop_run(np.arange(0.0, 0.6, 5e-4), hop_index=2.0, tilt_deg=20.0)
SWING = pushed(np.arange(0.0, 3.0, 0.005), 0.0)

#: Energy of the two masses, their spring and the soil under the foot (what unloading would give back).
ENERGY = (
    "0.5 * body_mass * v_b ** 2 + 0.5 * leg_mass * v_l ** 2 + g * (body_mass * z_b + leg_mass * z_l)"
    " + 0.5 * k * delta ** 2 + 0.5 * contact_force ** 2 * unloading_share / contact_stiffness"
)
BLOCK_ENERGY = "0.5 * m * v ** 2 + 0.5 * k * q ** 2"


def with_effect(plant: Plant, physics_id: str, **values: float) -> Plant:
    effect = catalogue()[physics_id]
    return plant.with_effect(use_of(plant, physics_id, plant.places(effect)[0][0], values))


def looked_at(
    plant: Plant, run: Run, initial: Mapping[str, float] | None = None, **formulas: str
) -> dict[str, Any]:
    """Further formulas along a run; `own_NAME` is a name of the plant's last effect."""
    prefix = plant.prefix(plant.effects[-1]) if plant.effects else ""

    def symbol(name: str) -> Node:
        return Name(f"{prefix}.{name.removeprefix('own_')}") if name.startswith("own_") else Name(name)

    nodes = {name: rename(parse(text), symbol) for name, text in formulas.items()}
    compiled = compile_plant(
        plant, extra=nodes, relative_tolerance=1e-10
    )  # samples between steps are interpolated
    return dict(zip(compiled.output_names, compiled.run(compiled.values, run, initial).T, strict=True))


def hop_energy(plant: Plant, more: str) -> Any:
    """Energy from the opening on [J]."""
    found = looked_at(plant, HOP, energy=f"{ENERGY} + {more}", since="where(opened, since(opened), -elapsed)")
    return found["energy"][found["since"] > 0.0]


def block_energy(plant: Plant, more: str) -> Any:
    """Energy of the block on its spring, thrown at 1 m/s [J]."""
    return looked_at(plant, SWING, {"v": 1.0}, energy=f"{BLOCK_ENERGY} + {more}")["energy"]


FLEXED = (
    "own_mu * body_mass * (0.5 * own_v_f ** 2 - 0.5 * v_b ** 2"
    " + 0.5 * (2 * pi * own_f * own_q_f) ** 2 + g * own_q_f)"
)
STOPPED = "0.5 * own_k_e * max(0, own_delta_e - delta) ** 2"
SOIL_MOVED = "0.5 * own_m_a * where(contact_force > 0, min(1, penetration / own_y_p), 0) * v_l ** 2"

#: What keeps all energy, and where beside `ENERGY`.
CONSERVATIVE = {
    "release_delay": ({"delay": 0.004}, "0"),
    "reel_inertia": ({"m_r": 0.4}, "0.5 * own_m_r * own_reel_speed ** 2"),
    "progressive_spring": ({"a": 0.05, "n": 2.0, "x_r": 0.01}, "k * own_a * delta ** 4 / (4 * own_x_r ** 2)"),
    "leg_end_stop": ({"k_e": 3e5, "c_e": 0.0, "delta_e": 0.002}, STOPPED),
    "structural_flexure": ({"mu": 0.1, "f": 50.0, "zeta": 0.0}, FLEXED),
    "mass_distribution": ({"m_s": 0.3}, "0"),
    "soil_hardening": ({"n": 0.5, "y_r": 0.01}, "0"),
    "buoyancy": ({"B": 6.0}, "-own_B * z_b"),
}
#: What takes energy; with soil that takes none of its own but where the effect is about that.
DISSIPATIVE: dict[str, tuple[dict[str, float], float, str]] = {
    "latch_drag": ({"F_d": 20.0, "t_f": 0.01}, 0.0, "0"),
    "sleeve_friction": ({"F_f": 5.0}, 0.0, "0"),
    "leg_end_stop": ({"k_e": 3e5, "c_e": 60.0, "delta_e": 0.002}, 0.0, STOPPED),
    "structural_flexure": ({"mu": 0.1, "f": 50.0, "zeta": 0.05}, 0.0, FLEXED),
    "spring_hysteresis": ({"h": 0.05}, 0.0, "0"),
    "soil_rate_dependence": ({"c_g": 200.0}, 0.0, "0"),
    "soil_hardening": ({"n": 0.5, "y_r": 0.01}, 0.7, "0"),
    "soil_added_mass": ({"m_a": 0.4, "y_p": 5e-4}, 0.0, SOIL_MOVED),
    "soil_adhesion": ({"F_a": 20.0, "d_a": 1e-3}, 0.0, "0"),
    "soil_compaction": ({"a": 0.5, "b": 0.3, "n_c": 2.0}, 0.9, "0"),
    "foot_slip": ({"s": 3.0, "mu": 0.1}, 0.0, "0"),
    "aerodynamic_drag_quadratic": ({"cd_a": 0.5, "rho": 1.2}, 0.0, "0"),
    "aerodynamic_drag_linear": ({"d": 0.5}, 0.0, "0"),
    "hinge_friction": ({"F_h": 1.0}, 0.0, "0"),
}
BLOCK_CONSERVATIVE = {
    "end_stop": ({"k_e": 500.0, "x_e": 0.1}, "0.5 * own_k_e * max(0, q - own_x_e) ** 2"),
    "progressive_spring": ({"k_3": 300.0}, "own_k_3 * q ** 4 / 4"),
    "buoyancy": ({"B": 1.5}, "-own_B * q"),
    "asymmetric_friction": ({"F_o": 1.5}, "own_F_o * q"),
    "added_inertia": ({"m_a": 0.7}, "0.5 * own_m_a * v ** 2"),
}
BLOCK_DISSIPATIVE = {
    "coulomb_friction": ({"F_c": 0.5}, "0"),
    "viscous_friction": ({"F_v": 0.5}, "0"),
    "stribeck_friction": ({"F_s": 0.8, "v_s": 0.1}, "0"),
    "quadratic_friction": ({"F_q": 0.5}, "0"),
    "position_dependent_friction": ({"F_p": 1.0, "x_p": 0.05, "w_p": 0.05}, "0"),
    "load_dependent_friction": ({"mu": 0.1}, "0"),
    "presliding_hysteresis": ({"F_d": 0.5, "s_p": 0.01}, "0.5 * own_F_d * own_s_p * own_z ** 2"),
    "warm_up_friction": ({"F_w": 1.0, "W_0": 0.5}, "0"),
    "aerodynamic_drag_linear": ({"d": 0.5}, "0"),
    "aerodynamic_drag_quadratic": ({"cd_a": 0.5, "rho": 1.2}, "0"),
}
RIGS = st.fixed_dictionaries(
    {
        "m_b": st.floats(2.0, 10.0),
        "m_l": st.floats(0.8, 5.0),
        "g": st.floats(1.0, 12.0),
        "k": st.floats(1e4, 1e5),
        "quartz_sand.k_l": st.floats(5e4, 1e7),
    }
)


def elastic(rig: Mapping[str, float], c: float = 0.0, chi: float = 0.0) -> Plant:
    return shipped("bb0b_hop").with_values({**rig, "c": c, "quartz_sand.chi": chi})


def put_in(rig: Mapping[str, float]) -> float:
    return 0.5 * rig["k"] * 0.036**2


@quickly
@given(rig=RIGS)
def test_a_hop_without_losses_keeps_its_energy(rig: dict[str, float]) -> None:
    energy = hop_energy(elastic(rig), "0")
    assert np.ptp(energy) < 1e-6 * put_in(rig)


@pytest.mark.parametrize("physics_id", CONSERVATIVE)
@quickly
@given(rig=RIGS)
def test_what_takes_nothing_keeps_all_energy_of_a_hop(physics_id: str, rig: dict[str, float]) -> None:
    values, more = CONSERVATIVE[physics_id]
    energy = hop_energy(with_effect(elastic(rig), physics_id, **values), more)
    assert np.ptp(energy) < 1e-6 * put_in(rig)


@pytest.mark.parametrize("physics_id", DISSIPATIVE)
@quickly
@given(rig=RIGS)
def test_what_dissipates_makes_the_energy_of_a_hop_fall(physics_id: str, rig: dict[str, float]) -> None:
    values, chi, more = DISSIPATIVE[physics_id]
    energy = hop_energy(with_effect(elastic(rig, 0.0, chi), physics_id, **values), more)
    assert np.max(np.diff(energy)) < 1e-6 * put_in(rig)
    assert energy[0] - energy[-1] > 1e-5 * put_in(rig)


@quickly
@given(rig=RIGS, c=st.floats(1.0, 100.0), chi=st.floats(0.05, 0.95))
def test_damper_and_soil_take_energy_at_every_instant(rig: dict[str, float], c: float, chi: float) -> None:
    energy = hop_energy(elastic(rig, c, chi), "0")
    assert np.max(np.diff(energy)) < 1e-6 * put_in(rig)
    assert energy[0] - energy[-1] > 1e-4 * put_in(rig)


@pytest.mark.parametrize("physics_id", BLOCK_CONSERVATIVE)
def test_what_takes_nothing_keeps_all_energy_of_a_block(physics_id: str) -> None:
    values, more = BLOCK_CONSERVATIVE[physics_id]
    energy = block_energy(with_effect(plant_of(block("push_n - k * q")), physics_id, **values), more)
    assert np.ptp(energy) < 1e-6 * energy[0]


@pytest.mark.parametrize("physics_id", BLOCK_DISSIPATIVE)
def test_what_dissipates_makes_the_energy_of_a_block_fall(physics_id: str) -> None:
    values, more = BLOCK_DISSIPATIVE[physics_id]
    energy = block_energy(with_effect(plant_of(block("push_n - k * q")), physics_id, **values), more)
    assert np.max(np.diff(energy)) < 1e-7 * energy[0]
    assert energy[0] - energy[-1] > 1e-3 * energy[0]


def test_every_effect_with_a_force_of_its_own_has_its_energy_looked_at() -> None:
    """What is left out drives or steers the plant from outside, or is no mechanics at all."""
    looked_at_here = {*CONSERVATIVE, *DISSIPATIVE, *BLOCK_CONSERVATIVE, *BLOCK_DISSIPATIVE}
    of_the_drive = {
        *("winding_heating", "brush_voltage_drop", "supply_sag", "dead_time", "torque_constant_saturation"),
        *("backlash", "lead_error", "string_creep", "string_stiffening", "string_slack", "torque_ripple"),
    }
    physical = {name for name, effect in catalogue().items() if effect.kind == "physics"}
    assert physical == looked_at_here | of_the_drive


INTERNAL = (
    "latch_drag",
    "reel_inertia",
    "sleeve_friction",
    "leg_end_stop",
    "spring_hysteresis",
    "mass_distribution",
)


@pytest.mark.parametrize("physics_id", ["", *INTERNAL, "soil_rate_dependence", "soil_adhesion"])
def test_the_ground_alone_changes_the_momentum_through_lift_off_and_touchdown(physics_id: str) -> None:
    plant = shipped("bb0b_hop")
    values = (CONSERVATIVE.get(physics_id) or DISSIPATIVE.get(physics_id) or ({},))[0]
    if physics_id:
        plant = with_effect(plant, physics_id, **values)
    run = hop_run(np.arange(0.0, 0.45, 5e-5))
    found = looked_at(
        plant,
        run,
        push="ground_force - (body_mass + leg_mass) * g",
        momentum="body_mass * v_b + leg_mass * v_l",
        rate="body_mass * rate(v_b) + leg_mass * rate(v_l)",
        lifted="where(contact_force > 0, 0, 1)",
        since="where(opened, since(opened), -elapsed)",
    )
    found = {name: column[found["since"] > 0.0] for name, column in found.items()}
    assert np.sum(np.abs(np.diff(found["lifted"]))) >= 2  # lift-off and touchdown
    assert np.allclose(found["rate"], found["push"], rtol=0, atol=1e-9 * np.abs(found["push"]).max())
    impulse = np.concatenate([[0.0], np.cumsum(0.5 * 5e-5 * (found["push"][1:] + found["push"][:-1]))])
    assert np.allclose(found["momentum"] - found["momentum"][0], impulse, rtol=0, atol=0.01)
    assert np.ptp(found["momentum"]) > 5.0


ON_THE_GROUND = [name for name, effect in catalogue().items() if effect.equation == "ground_contact"]


@pytest.mark.parametrize("physics_id", ON_THE_GROUND)
@quickly
@given(rig=RIGS, chi=st.floats(0.0, 0.95))
def test_the_ground_pulls_by_adhesion_alone(physics_id: str, rig: dict[str, float], chi: float) -> None:
    values = DISSIPATIVE[physics_id][0]
    plant = with_effect(elastic(rig, 18.0, chi), physics_id, **values)
    found = looked_at(plant, HOP, force="ground_force", speed="v_l")
    if physics_id == "soil_adhesion":
        assert np.min(found["force"]) >= -values["F_a"]
        assert np.all(found["speed"][found["force"] < 0.0] > 0.0) and np.min(found["force"]) < 0.0
    else:
        assert np.min(found["force"]) >= 0.0


@pytest.mark.parametrize("physics_id", ["", "soil_hardening", "soil_compaction"])
@quickly
@given(k_l=st.floats(5e4, 1e6), chi=st.floats(0.05, 0.95))
def test_unloading_returns_the_share_that_the_soil_does_not_keep(
    physics_id: str, k_l: float, chi: float
) -> None:
    plant = shipped("bb0b_hop").with_values({"quartz_sand.k_l": k_l, "quartz_sand.chi": chi})
    kept = chi
    if physics_id:
        values = DISSIPATIVE[physics_id][0]
        plant = with_effect(plant, physics_id, **values)
        kept = chi * (1.0 - 0.3 * (1.0 - np.exp(-1.0))) if physics_id == "soil_compaction" else chi
    run = hop_run(np.arange(0.0565, 0.1, 4e-6), hop_index=2.0)
    found = looked_at(plant, run, y="penetration", f="contact_force")
    y, f = found["y"], found["f"]
    top = int(np.argmax(y))
    lifted = top + int(np.flatnonzero(f[top:] == 0.0)[0])
    work = np.diff(y) * 0.5 * (f[1:] + f[:-1])
    stiffness, power = f[top] / y[top], 0.5 if physics_id == "soil_hardening" else 0.0
    put_into_soil = stiffness * y[top] ** 2 / (2.0 + power)
    assert -np.sum(work[top:lifted]) == pytest.approx((1.0 - kept) * put_into_soil, rel=5e-3)


@quickly
@given(share=st.floats(0.05, 0.95), tension_v=st.floats(6.0, 12.0))
@pytest.mark.parametrize(
    "physics_id", ["", "presliding_hysteresis", "coulomb_friction", "stribeck_friction", "end_stop"]
)
def test_what_sticks_does_not_creep(physics_id: str, share: float, tension_v: float) -> None:
    """Held anywhere within the transmission's own band, from r F eta_b to r F/eta, the nut stays to the bit."""
    plant = shipped("bb0b_drive")
    effects = {
        "presliding_hysteresis": {"s_p": 0.5, "share": 1.0},
        "coulomb_friction": {"F_c": 3e-4},
        "stribeck_friction": {"F_s": 3e-4, "v_s": 30.0},
        "end_stop": {"k_e": 1e6, "x_e": 0.02},
    }
    if physics_id:
        plant = with_effect(plant, physics_id, **effects[physics_id])
    times = np.arange(0.0, 12.0, 0.01)
    first = Run(times[times < 6.0], {"motor_voltage_v": np.full(600, tension_v)})
    torque = looked_at(plant, first, torque="load_torque")["torque"][-1]
    torque *= 1.0 if physics_id != "end_stop" else 0.999
    hold_v = 3.3 / 0.0137 * torque * (0.55 + share * (1 / 0.72 - 0.55))
    found = states(plant, Run(times, {"motor_voltage_v": np.where(times < 6.0, tension_v, hold_v)}))
    held = times > 8.0
    assert np.all(found["omega"][held] == 0.0)
    assert np.all(found["theta"][held] == found["theta"][held][0])


@quickly
@given(energy_j=st.floats(5.0, 60.0), m_b=st.floats(2.0, 10.0), m_l=st.floats(0.5, 5.0))
def test_equations_a1_to_a3_in_the_stiff_limit(energy_j: float, m_b: float, m_l: float) -> None:
    """Body speed √(2E/m_b) when the springs relax (A1), the robot's m_b/M of it (A2), E m_b/M left to jump (A3)."""
    k = 3e8
    plant = shipped("bb0b_hop").with_values({"c": 0.0, "k": k, "m_b": m_b, "m_l": m_l, "steel.k_l": 1e14})
    times = np.concatenate([[0.0], np.linspace(0.05685, 0.0585, 30000)])
    run = hop_run(times, "steel", float(np.sqrt(2.0 * energy_j / k)))
    found = looked_at(plant, run, v_b="v_b", v_l="v_l")
    fastest = found["v_b"].max()
    robot = ((m_b * found["v_b"] + m_l * found["v_l"]) / (m_b + m_l)).max()  # gravity takes over from here on
    assert fastest == pytest.approx(np.sqrt(2.0 * energy_j / m_b), rel=2e-3)
    assert robot == pytest.approx(fastest * m_b / (m_b + m_l), rel=2e-3)
    assert 0.5 * (m_b + m_l) * robot**2 == pytest.approx(energy_j * m_b / (m_b + m_l), rel=5e-3)
