"""The size of each effect of screw, springs, string, release, mechanism, soil and sensors, in closed form."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from plant_helpers import block, hop_run, plant_of, pushed, shipped, simulate, use_of

from sim_hal.plant.expressions import Node, parse
from sim_hal.plant.simulate import Plant, Run, catalogue, compile_plant

TIMES = np.arange(0.0, 4.0, 0.005)
DRIVE = Run(TIMES, {"motor_voltage_v": np.where(TIMES < 2.5, 9.0, np.where(TIMES < 3.2, -6.0, 8.0))})
HOP = hop_run(np.arange(0.0, 0.3, 0.0003))
R = 0.002 / (2 * np.pi * 84)
K, K_M = 30600.0, 190000.0
STEP = np.arange(0.0, 1.0, 0.005)


def with_effect(plant: Plant, physics_id: str, channel: str | None = None, /, **values: float) -> Plant:
    effect = catalogue()[physics_id]
    equation = effect.equation
    if not any(place == equation for place, _ in plant.places(effect)):
        equation = plant.places(effect)[0][0]
    return plant.with_effect(use_of(plant, physics_id, equation, values, channel))


def looked_at(plant: Plant, run: Run, **formulas: str) -> dict[str, Any]:
    """Channels and further formulas."""
    nodes: dict[str, Node] = {name: parse(text) for name, text in formulas.items()}
    compiled = compile_plant(plant, extra=nodes)
    return dict(zip(compiled.output_names, compiled.run(compiled.values, run).T, strict=True))


def drive(physics_id: str, **values: float) -> dict[str, Any]:
    plant = with_effect(shipped("bb0b_drive"), physics_id, **values)
    return looked_at(plant, DRIVE, force="string_force", torque="load_torque")


def test_a_lead_error_repeats_with_the_screw_and_does_no_work_of_its_own() -> None:
    found = drive("lead_error", e_sin=3e-5, e_cos=-2e-5)
    turn = found["nut_position_m"] / R / 84.0
    travel = R * 84.0 * turn + 3e-5 * np.sin(turn) - 2e-5 * (np.cos(turn) - 1.0)
    force = np.maximum(0.0, travel) / (1 / K + 1 / K_M)
    assert np.allclose(found["spring_compression_m"], force / K, rtol=0, atol=1e-12)
    per_radian = R + (3e-5 * np.cos(turn) + 2e-5 * np.sin(turn)) / 84.0
    assert np.allclose(found["torque"], per_radian * force, rtol=0, atol=1e-12)
    assert np.ptp(turn) > 2 * np.pi  # more than one turn


def test_a_stop_holds_the_nut() -> None:
    found = drive("end_stop", k_e=5e7, x_e=0.003)
    nut = found["nut_position_m"]
    assert np.allclose(found["torque"], R * (found["force"] + 5e7 * np.maximum(0.0, nut - 0.003)), atol=1e-12)
    assert 0.003 < nut.max() < 0.0032 < simulate(shipped("bb0b_drive"), DRIVE)["nut_position_m"].max()


@pytest.mark.parametrize("n", [1.0, 2.0])
def test_a_progressive_spring_shares_the_travel_with_the_string(n: float) -> None:
    found = drive("progressive_spring", a=0.3, n=n, x_r=0.002)
    s = found["spring_compression_m"]
    assert np.allclose(found["force"], K * s * (1.0 + 0.3 * (s / 0.002) ** n), rtol=1e-9, atol=1e-9)
    assert np.allclose(s + found["force"] / K_M, found["nut_position_m"], rtol=0, atol=1e-10)


def test_hysteretic_springs_take_more_than_they_give() -> None:
    found = drive("spring_hysteresis", h=0.1, d_h=2e-5)
    s, force = found["spring_compression_m"], found["force"]
    assert np.allclose(s + force / K_M, found["nut_position_m"], rtol=0, atol=1e-12)
    stiffness = force[1:] / s[1:] / K
    tensioned, let_back = (TIMES[1:] > 1.0) & (TIMES[1:] < 2.4), (TIMES[1:] > 3.0) & (TIMES[1:] < 3.15)
    assert np.allclose(stiffness[tensioned], 1.1, rtol=0, atol=1e-6)
    assert np.allclose(stiffness[let_back], 0.9, rtol=0, atol=1e-6)


def test_a_slack_and_a_soft_string() -> None:
    found = drive("string_slack", x_0=0.001)
    assert np.allclose(
        found["force"], np.maximum(0.0, found["nut_position_m"] - 0.001) / (1 / K + 1 / K_M), rtol=1e-12
    )
    found = drive("string_stiffening", soft=0.4, x_s=0.0008)
    x = found["nut_position_m"]
    toe = 0.4 * 0.0008 * (1.0 - np.exp(-x / 0.0008))
    assert np.allclose(found["force"], (x - toe) / (1 / K + 1 / K_M), rtol=1e-9)


@pytest.mark.parametrize(("order", "turns"), [(1.0, 1.0), (1.0 / 84.0, 84.0)])
def test_a_ripple_repeats_with_the_motor_or_the_screw(order: float, turns: float) -> None:
    plant = shipped("bb0b_drive")
    rippled = with_effect(plant, "torque_ripple", F_sin=2e-4, F_cos=1e-4, order=order)
    balance = {"angle": "theta", "acceleration": "rate(omega)", "nominal": "(K * i - b * omega) / J"}
    found = looked_at(rippled, DRIVE, speed="omega", load="load_torque", **balance)
    forward = found["speed"] > 1.0
    friction = (1e-3 + found["load"] / 0.72) / 2.2e-6
    force = 2.2e-6 * (found["acceleration"] - found["nominal"] + friction)[forward]
    angle = found["angle"][forward] / turns
    assert np.allclose(force, 2e-4 * np.sin(angle) + 1e-4 * np.cos(angle), rtol=0, atol=1e-12)


def test_mass_that_moves_with_the_leg_is_mass_of_the_leg() -> None:
    plant = shipped("bb0b_hop")
    moved = simulate(with_effect(plant, "mass_distribution", m_s=0.2), HOP)
    stated = simulate(plant.with_values({"m_b": 5.193, "m_l": 2.339}), HOP)
    for channel, values in stated.items():
        assert np.allclose(moved[channel], values, rtol=0, atol=1e-7 * np.ptp(values))


def test_a_flexible_body_rings_at_the_frequency_of_the_free_pair() -> None:
    soft = shipped("bb0b_hop").with_values({"k": 100.0, "c": 0.0})
    ringing = with_effect(soft, "structural_flexure", mu=0.2, f=40.0, zeta=0.0)
    times = np.arange(0.07, 0.2, 1e-4)
    run = hop_run(np.concatenate([[0.0], times]), compression=0.5)
    found = simulate(ringing, run)["body_acceleration_m_s2"][1:]
    free = 2 * np.pi * 40.0 / np.sqrt(0.8)
    slow = [(times - 0.13) ** power for power in range(4)]  # what the soft spring does meanwhile
    basis = np.column_stack([np.cos(free * times), np.sin(free * times), *slow])
    left = found - basis @ np.linalg.lstsq(basis, found, rcond=None)[0]
    assert np.ptp(found) > 1.0 and np.max(np.abs(left)) < 1e-2 * np.ptp(found)


def test_soil_that_moves_with_the_foot_makes_it_heavier() -> None:
    plant = with_effect(shipped("bb0b_hop"), "soil_added_mass", m_a=0.5, y_p=5e-4)
    found = looked_at(
        plant, HOP, a="rate(v_l)", f="ground_force", s="spring_force + damping_force", y="penetration"
    )
    acting = (found["y"] > 5e-4) & (found["f"] > 0.0) & (HOP.times_s > 0.06)
    assert acting.sum() > 20
    wanted = (found["f"] - found["s"] - 2.139 * 8.874) / 2.639
    assert np.allclose(found["a"][acting], wanted[acting], rtol=1e-12)
    flying = (found["y"] < -1e-3) & (HOP.times_s > 0.06)
    assert np.allclose(found["a"][flying], -(found["s"] / 2.139 + 8.874)[flying], rtol=1e-9)


def test_adhesion_takes_the_work_of_its_pull() -> None:
    """∫ F_a g/d_a exp(1 − g/d_a) dg over all gaps is e F_a d_a."""
    plant = shipped("bb0b_hop").with_values({"c": 0.0})
    run = hop_run(np.arange(0.0, 0.12, 1e-4))

    def energy(rig: Plant) -> Any:
        found = looked_at(rig, run, v_b="v_b", v_l="v_l", z_b="z_b", z_l="z_l", spring="0.5 * k * delta ** 2")
        kinetic = 0.5 * 5.393 * found["v_b"] ** 2 + 0.5 * 2.139 * found["v_l"] ** 2
        return kinetic + found["spring"] + 8.874 * (5.393 * found["z_b"] + 2.139 * found["z_l"])

    without, sticky = energy(plant), energy(with_effect(plant, "soil_adhesion", F_a=20.0, d_a=5e-4))
    assert without[-1] - sticky[-1] == pytest.approx(np.e * 20.0 * 5e-4, rel=1e-3)


def test_compaction_and_slip_are_another_soil() -> None:
    plant = shipped("bb0b_hop").with_values({"quartz_sand.k_l": 9.5e4, "quartz_sand.chi": 0.9})
    done = 1.0 - np.exp(-3.0 / 2.0)
    packed = with_effect(plant, "soil_compaction", a=0.8, b=0.5, n_c=2.0)
    stiffer = plant.with_values(
        {"quartz_sand.k_l": 9.5e4 * (1 + 0.8 * done), "quartz_sand.chi": 0.9 * (1 - 0.5 * done)}
    )
    tilt = np.radians(20.0)
    yielding = 1.0 + 4.0 * np.sin(tilt) * (np.sin(tilt) - 0.1 * np.cos(tilt))
    slipping = with_effect(plant, "foot_slip", s=4.0, mu=0.1)
    softer = plant.with_values({"quartz_sand.k_l": 9.5e4 / yielding, "quartz_sand.chi": 1.0 - 0.1 / yielding})
    times = HOP.times_s
    for changed, other, run in (
        (packed, stiffer, hop_run(times, hop_index=3.0)),
        (packed, plant, hop_run(times)),
        (slipping, softer, hop_run(times, tilt_deg=-20.0)),
        (slipping, plant, hop_run(times, tilt_deg=3.0)),
    ):
        wanted = simulate(other, run)
        for channel, values in simulate(changed, run).items():
            assert np.allclose(values, wanted[channel], rtol=0, atol=1e-6 * np.ptp(wanted[channel]))


def test_a_recording_may_tell_the_hop_index_by_its_state_too() -> None:
    packed = with_effect(shipped("bb0b_hop"), "soil_compaction", a=0.8, b=0.5, n_c=2.0)
    by_condition = simulate(packed, hop_run(HOP.times_s, hop_index=2.0))
    run = hop_run(HOP.times_s, hop_index=5.0)
    by_state = Run(
        run.times_s, events=run.events, known={**run.known, "hop_index": 2.0}, conditions=run.conditions
    )
    assert all(
        np.array_equal(by_condition[key], values) for key, values in simulate(packed, by_state).items()
    )


def test_hinge_friction_slows_the_body_and_leaves_the_leg() -> None:
    plant = with_effect(shipped("bb0b_hop"), "hinge_friction", F_h=0.7)
    found = looked_at(
        plant,
        HOP,
        a_b="rate(v_b)",
        a_l="rate(v_l)",
        f="ground_force",
        s="spring_force + damping_force",
        v="v_b",
    )
    moving = (np.abs(found["v"]) > 0.01) & (HOP.times_s > 0.06)
    force = 5.393 * (found["a_b"] + 8.874) - found["s"]
    assert np.allclose(force[moving], -0.7 * np.sign(found["v"][moving]), rtol=0, atol=1e-9)
    leg = 2.139 * (found["a_l"] + 8.874) + found["s"]
    assert np.allclose(leg[moving], found["f"][moving], rtol=0, atol=1e-9)


def thrown(physics_id: str, channel: str, **values: float) -> Any:
    """What a channel of the block reads that is pushed with 4 N (2 m/s²) from rest."""
    return simulate(with_effect(plant_of(block()), physics_id, channel, **values), pushed(STEP, 4.0))[channel]


def test_a_filtered_channel_follows_its_first_order_answer() -> None:
    tau = 0.07
    late = 1.0 - np.exp(-STEP / tau)
    assert np.allclose(
        thrown("sensor_bandwidth", "acceleration_m_s2", tau=tau, share=1.0), 2.0 * late, atol=1e-8
    )
    speed = 2.0 * (STEP - tau * late)
    assert np.allclose(thrown("sensor_bandwidth", "speed_m_s", tau=tau, share=1.0), speed, atol=1e-8)
    position = 2.0 * (0.5 * STEP**2 - tau * STEP + tau**2 * late)
    assert np.allclose(thrown("sensor_bandwidth", "position_m", tau=tau, share=1.0), position, atol=1e-8)
    half = thrown("sensor_bandwidth", "speed_m_s", tau=tau, share=0.5)
    assert np.allclose(half, 0.5 * (speed + 2.0 * STEP), atol=1e-8)


def test_a_filtered_accelerometer_feels_friction_and_starts_where_it_rests() -> None:
    """A rate with set-valued friction in it, and gravity: both parts of the reading are filtered."""
    plant = with_effect(shipped("bb0b_hop"), "sleeve_friction", F_f=20.0)
    channel = "body_acceleration_m_s2"
    times = np.arange(0.0, 0.3, 2e-5)
    sharp = simulate(plant, hop_run(times))[channel]
    slow = simulate(with_effect(plant, "sensor_bandwidth", channel, tau=0.004, share=1.0), hop_run(times))[
        channel
    ]
    assert np.allclose(slow[times < 0.05], 8.874, rtol=0, atol=1e-9)
    wanted = np.empty_like(sharp)
    wanted[0] = sharp[0]
    keep = np.exp(-2e-5 / 0.004)
    for n in range(1, len(times)):
        wanted[n] = keep * wanted[n - 1] + (1 - keep) * 0.5 * (sharp[n] + sharp[n - 1])
    assert np.allclose(slow, wanted, rtol=0, atol=0.6)  # of 200 m/s²: the steps fall between samples
    assert np.sqrt(np.mean((slow - wanted) ** 2)) < 0.1


def test_a_clipped_a_tilted_and_a_skewed_channel() -> None:
    assert np.allclose(
        thrown("sensor_saturation", "speed_m_s", limit=0.5, share=1.0),
        np.minimum(2.0 * STEP, 0.5),
        atol=1e-12,
    )
    tilted = thrown("sensor_misalignment", "acceleration_m_s2", beta=0.2)
    assert np.allclose(tilted, 2.0 * np.cos(0.2), rtol=1e-12)
    for skew in (0.05, -0.05):  # a slow clock's last reading lies beyond the run
        assert np.allclose(thrown("clock_skew", "position_m", skew=skew), (STEP * (1 + skew)) ** 2, atol=1e-9)
    hop = shipped("bb0b_hop")
    straight = looked_at(hop, HOP, v="v_b")
    channel = "body_acceleration_m_s2"
    turned = simulate(with_effect(hop, "sensor_misalignment", channel, beta=-0.3), HOP)[channel]
    wanted = straight[channel] * np.cos(0.3) - straight["v"] ** 2 / 1.413 * np.sin(0.3)
    assert np.allclose(turned, wanted, rtol=0, atol=1e-12)


def test_a_tilted_axis_is_offered_for_accelerations_alone() -> None:
    places = shipped("bb0b_hop").places(catalogue()["sensor_misalignment"])
    assert places == (("sensor", "body_acceleration_m_s2"),)
