"""Many hops to their highest point: two engines and two closed forms that must agree, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plant_helpers import hop_run, shipped, states, use_of
from test_plant_exact_hop import ExactHop, Rig

from sim_hal.plant.hops import Hops
from sim_hal.plant.simulate import Plant, SimulationError, compile_plant

SAND = "quartz_sand"


def with_three(plant: Plant) -> Plant:
    """Friction in the guide, drag of the air, soil that resists speed."""
    for physics_id, place, values in (
        ("sleeve_friction", "body_momentum", {"F_f": 3.0}),
        ("aerodynamic_drag_quadratic", "ballistic", {"cd_a": 0.05, "rho": 1.2}),
        ("soil_rate_dependence", "ground_contact", {"c_g": 60.0}),
    ):
        plant = plant.with_effect(use_of(plant, physics_id, place, values))
    return plant


def without_strength(plant: Plant) -> Plant:
    """An effect that does nothing, so that the plant is integrated."""
    return plant.with_effect(use_of(plant, "buoyancy", "ballistic", {"B": 0.0}))


@settings(max_examples=25, deadline=None)
@given(
    k=st.floats(1.5e4, 5e4),
    c=st.floats(0.0, 60.0),
    k_l=st.floats(6e4, 4e5),
    chi=st.floats(0.0, 0.95),
    s=st.floats(0.005, 0.045),
    g=st.floats(1.6, 10.0),
)
def test_exact_and_integrated_hops_agree(
    k: float, c: float, k_l: float, chi: float, s: float, g: float
) -> None:
    changed = {"k": k, "c": c, "g": g, f"{SAND}.k_l": k_l, f"{SAND}.chi": chi}
    plant = shipped("bb0b_hop").with_values(changed)
    exact = Hops(plant, SAND)
    integrated = Hops(without_strength(plant), SAND)
    assert exact.exact and not integrated.exact
    compression = np.array([s, 1.1 * s])
    assert np.allclose(exact.heights_m(compression), integrated.heights_m(compression), rtol=1e-9, atol=1e-12)


def test_the_height_is_that_of_the_piecewise_solution_by_matrix_exponentials() -> None:
    rig = Rig(m_b=5.393, m_l=2.139, g=8.874, k=3.06e4, c=18.0, k_l=9.5e4, chi=0.9, s=0.036)
    plant = shipped("bb0b_hop").with_values({f"{SAND}.k_l": 9.5e4, f"{SAND}.chi": 0.9})
    times = np.arange(0.0, 0.32, 2e-4)
    found = ExactHop(rig).at(times)
    centre = (rig.m_b * found[:, 2] + rig.m_l * found[:, 0]) / (rig.m_b + rig.m_l)
    near = int(np.argmax(centre))
    a, b, top = np.polyfit(times[near - 3 : near + 4] - times[near], centre[near - 3 : near + 4], 2)
    assert Hops(plant, SAND).heights_m(np.array([0.036]))[0] == pytest.approx(
        top - b * b / (4.0 * a) - centre[0], rel=1e-8
    )


def test_without_losses_the_spring_lifts_the_weight() -> None:
    plant = shipped("bb0b_hop").with_values({"c": 0.0, "steel.chi": 0.0, "steel.k_l": 1e9})
    value = {name: parameter.value for name, parameter in plant.parameters.items()}
    s = np.array([0.03])
    height = Hops(plant, "steel").heights_m(s)[0]
    weight = (value["m_b"] + value["m_l"]) * value["g"]
    given = 0.5 * value["k"] * s[0] ** 2 + value["m_b"] * value["g"] * s[0]
    # The foot rings on in flight: a bound, and that the most of it is there.
    assert 0.5 * given < weight * height < given


@pytest.mark.parametrize("name", ["bb0b_hop", "bb0b_hop_arm"])
def test_three_effects_reach_the_height_that_a_close_look_finds(name: str) -> None:
    plant = with_three(shipped(name))
    compression = np.array([0.025, 0.036])
    heights = Hops(plant, SAND).heights_m(compression)
    m_b, m_l = plant.parameters["m_b"].value, plant.parameters["m_l"].value
    radius = plant.parameters["L_CoM"].value
    for s, height in zip(compression, heights, strict=True):
        compiled = compile_plant(plant, relative_tolerance=1e-10)
        run = hop_run(np.arange(0.0, 0.45, 2e-5), compression=float(s))
        seen = dict(zip(compiled.state_names, compiled.states(compiled.values, run).T, strict=True))
        if plant.geometry == "arm":
            seen = {key: radius * np.sin(values / radius) for key, values in seen.items()}
        centre = (m_b * seen["z_b"] + m_l * seen["z_l"]) / (m_b + m_l)
        assert height == pytest.approx(centre.max() - centre[0], rel=1e-6)


def test_each_row_has_its_own_values_and_is_what_it_is_alone() -> None:
    hops = Hops(with_three(shipped("bb0b_hop")), SAND)
    rows = np.tile(hops.values, (300, 1))
    rows[:, hops.parameter_names.index("body_momentum.sleeve_friction.F_f")] = np.linspace(0.0, 20.0, 300)
    compression = np.linspace(0.02, 0.04, 300)
    together = hops.heights_m(compression, rows)
    some = [0, 17, 255, 256, 299]
    alone = [hops.heights_m(compression[i : i + 1], rows[i])[0] for i in some]
    assert together[some].tolist() == alone
    assert np.all(np.diff(hops.heights_m(np.full(300, 0.036), rows)) < 0.0)


def test_conditions_reach_the_soil() -> None:
    plant = shipped("bb0b_hop")
    use = use_of(plant, "soil_compaction", "ground_contact", {"a": 0.8, "b": 0.0, "n_c": 2.0})
    hops = Hops(plant.with_effect(use), SAND)
    s = np.array([0.034])
    assert hops.heights_m(s) == pytest.approx(Hops(plant, SAND).heights_m(s), rel=1e-9)
    stiffness = plant.surfaces[SAND]["k_l"].value * (1.0 + 0.8 * (1.0 - np.exp(-2.0)))
    stiffer = Hops(plant.with_values({f"{SAND}.k_l": stiffness}), SAND)
    assert hops.heights_m(s, hop_index=4.0) == pytest.approx(stiffer.heights_m(s), rel=1e-9)


def test_what_cannot_hop_is_refused_by_name() -> None:
    hops = Hops(shipped("bb0b_hop"), SAND)
    assert hops.heights_m(np.empty(0)).size == 0
    for wrong in (0.0, -0.01, np.nan, np.inf):
        with pytest.raises(SimulationError, match="spring_compression_m must be a finite number above 0"):
            hops.heights_m(np.array([0.03, wrong]))
    with pytest.raises(SimulationError, match="'granite'"):
        Hops(shipped("bb0b_hop"), "granite").heights_m(np.array([0.03]))
    values = hops.values.copy()
    values[hops.parameter_names.index("k")] = np.nan
    with pytest.raises(SimulationError, match="k = nan is not a finite number"):
        hops.heights_m(np.array([0.03]), values)
    assert states(shipped("bb0b_hop"), hop_run(np.array([0.0, 0.1])))["z_b"][1] > 0.0


def test_a_hop_that_never_turns_is_an_error_with_its_effects() -> None:
    plant = shipped("bb0b_hop")
    lifted = plant.with_effect(use_of(plant, "buoyancy", "ballistic", {"B": 80.0}))
    with pytest.raises(SimulationError, match=r"no highest until t = .*buoyancy"):
        Hops(lifted, SAND).heights_m(np.array([0.03]))
