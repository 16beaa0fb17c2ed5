"""The built-in kinds against what their equations say in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from plant_helpers import hop_run, plant_of, shipped, simulate, states, use_of

from sim_hal.plant.expressions import Name
from sim_hal.plant.simulate import Plant, PlantError, Run, SimulationError, Simulator, compile_plant

DENSE = np.arange(0.0, 0.3, 0.0002)


def hop_values(**changes: float) -> dict[str, float]:
    plant = shipped("bb0b_hop")
    return {name: parameter.value for name, parameter in plant.parameters.items()} | changes


def test_the_latch_opens_when_the_magnet_current_trips() -> None:
    found = simulate(shipped("bb0b_hop"), hop_run(DENSE))
    opening = -0.06 / 8.0 * np.log(1.0 - 0.9 * 8.0 / 12.0)
    assert opening == pytest.approx(0.0069, abs=5e-5)  # the figure that the specification gives
    after = DENSE[np.flatnonzero(np.abs(np.diff(found["spring_compression_m"])) > 0)[0]]
    assert after == pytest.approx(0.05 + opening, abs=0.0002)
    current = np.where(DENSE > 0.05, 1.5 * (1.0 - np.exp(-(DENSE - 0.05) * 8.0 / 0.06)), 0.0)
    assert np.allclose(found["magnet_current_a"], current, rtol=0, atol=1e-8)
    simulator = Simulator(
        shipped("bb0b_hop"),
        conditions={"surface": "syar"},
        known={"spring_compression_m": 0.03},
        events={"fire_command": 0.05},
    )
    simulator.advance(0.1)
    assert simulator.flag_time_s("opened") == pytest.approx(0.05 + opening, abs=1e-9)


def test_before_the_opening_everything_rests() -> None:
    times = np.linspace(0.0, 0.0565, 100)
    found = states(shipped("bb0b_hop"), hop_run(times))
    for name in ("z_l", "z_b", "v_l", "v_b"):
        assert np.all(found[name] == found[name][0])
    reading = simulate(shipped("bb0b_hop"), hop_run(times))["body_acceleration_m_s2"]
    assert np.all(reading == 8.874)


def lossless() -> dict[str, float]:
    return {"c": 0.0}


def test_flight_is_two_masses_on_a_spring() -> None:
    plant = shipped("bb0b_hop").with_values(lossless())
    found = states(plant, hop_run(DENSE))
    flying = (found["z_l"] > 1e-3) & (DENSE < 0.25)
    first = np.flatnonzero(flying)[0]
    t = DENSE[flying] - DENSE[first]
    mb, ml, k, g = 5.393, 2.139, 30600.0, 8.874
    centre = (mb * found["z_b"] + ml * found["z_l"]) / (mb + ml)
    speed = (mb * found["v_b"] + ml * found["v_l"]) / (mb + ml)
    ballistic = centre[first] + speed[first] * t - 0.5 * g * t**2
    assert np.allclose(centre[flying], ballistic, rtol=0, atol=1e-9)
    delta, rate = found["z_l"] - found["z_b"], found["v_l"] - found["v_b"]
    omega = np.sqrt(k * (1 / mb + 1 / ml))
    ringing = delta[first] * np.cos(omega * t) + rate[first] / omega * np.sin(omega * t)
    assert np.allclose(delta[flying], ringing, rtol=0, atol=2e-9)


def test_without_losses_energy_stays() -> None:
    plant = shipped("bb0b_hop").with_values(lossless())
    found = states(plant, hop_run(np.arange(0.0, 0.8, 0.0005), "steel"))
    mb, ml, k, g, k_l = 5.393, 2.139, 30600.0, 8.874, 5e7
    kinetic = 0.5 * mb * found["v_b"] ** 2 + 0.5 * ml * found["v_l"] ** 2
    height = mb * g * found["z_b"] + ml * g * found["z_l"]
    spring = 0.5 * k * (found["z_l"] - found["z_b"]) ** 2
    ground = 0.5 * k_l * np.minimum(found["z_l"], 0.0) ** 2
    energy = kinetic + height + spring + ground
    assert np.max(np.abs(energy / energy[0] - 1.0)) < 1e-6


@pytest.mark.parametrize("surface", ["steel", "syar", "quartz_sand", "expanded_clay", "quartz_aggregate"])
def test_unloading_returns_the_share_that_the_soil_does_not_keep(surface: str) -> None:
    plant = shipped("bb0b_hop")
    compiled = compile_plant(plant, extra={"y": Name("penetration"), "f": Name("ground_force")})
    found = compiled.run(compiled.values, hop_run(np.arange(0.05, 0.1, 2e-6), surface))
    y, f = (found[:, compiled.output_names.index(name)] for name in "yf")
    lifted = np.flatnonzero((f == 0.0) & (np.arange(len(f)) > np.argmax(y)))[0]
    y, f = y[: lifted + 1], f[: lifted + 1]
    top = int(np.argmax(y))
    work = np.diff(y) * 0.5 * (f[1:] + f[:-1])
    loaded = 0.5 * plant.surfaces[surface]["k_l"].value * y[top] ** 2
    chi = plant.surfaces[surface]["chi"].value
    assert -np.sum(work[top:]) == pytest.approx((1.0 - chi) * loaded, rel=2e-3)
    assert y[-1] == pytest.approx(chi * y[top], rel=2e-3, abs=2e-5)


def test_a_second_landing_in_the_same_hop_meets_the_residual_sinkage() -> None:
    plant = shipped("bb0b_hop")
    simulator = Simulator(
        plant,
        conditions={"surface": "quartz_sand"},
        known={"spring_compression_m": 0.036},
        events={"fire_command": 0.05},
    )
    deepest, loads = 0.0, []
    while simulator.time_s < 0.8:
        simulator.advance(simulator.time_s + 1e-3)
        now = simulator.outputs()
        deepest = max(deepest, now["penetration"])
        loads.append((now["penetration"], now["ground_force"], deepest))
    y, f, top = np.array(loads).T
    left = plant.surfaces["quartz_sand"]["chi"].value * top
    bare = (y > 0) & (y < 0.95 * left)  # within the residual sinkage there is nothing to press on
    assert bare.any() and np.all(f[bare] == 0.0)


def test_on_the_arm_the_sensor_reads_the_difference_of_gravities_in_flight() -> None:
    times = np.arange(0.0, 0.3, 0.0006)
    for name, expected in (("bb0b_hop_arm", 9.81 - 8.874), ("bb0b_hop", 0.0)):
        plant = shipped(name).with_values({"c": 300.0})  # the ringing dies out before the landing
        reading = simulate(plant, hop_run(times))["body_acceleration_m_s2"]
        flying = states(plant, hop_run(times))["z_l"] > 0.01
        assert reading[0] == pytest.approx(9.81 if "arm" in name else 8.874, rel=1e-3)
        assert np.allclose(reading[flying & (times > 0.17)], expected, atol=0.02)
        assert np.sum(flying & (times > 0.17)) > 30


DRIVE_TIMES = np.arange(0.0, 12.0, 0.005)


def drive(voltage: float | np.ndarray) -> Run:
    return Run(DRIVE_TIMES, {"motor_voltage_v": np.broadcast_to(voltage, DRIVE_TIMES.shape).astype(float)})


def test_a_steadily_tensioning_drive_draws_what_its_load_asks() -> None:
    found = simulate(shipped("bb0b_drive"), drive(10.0))
    force = 30600.0 * found["spring_compression_m"]
    r = 0.002 / (2 * np.pi * 84)
    speed = np.gradient(found["nut_position_m"], DRIVE_TIMES) / r
    inertia = 2.2e-6 * np.gradient(speed, DRIVE_TIMES)
    balance = (0.001 + 1.5e-6 * speed + r * force / 0.72 + inertia) / 0.0137
    late = (DRIVE_TIMES > 2.0) & (DRIVE_TIMES < 11.9)
    assert np.allclose(found["motor_current_a"][late], balance[late], rtol=0, atol=1e-5)


def test_a_tensioned_drive_holds_by_its_own_loss_and_does_not_creep() -> None:
    voltage = np.where(DRIVE_TIMES < 4.0, 10.0, np.where(DRIVE_TIMES < 5.0, 0.5, 0.55))
    found = states(shipped("bb0b_drive"), drive(voltage))
    # 0.5 V give K i = 2.1e-3 N·m, 0.55 V 2.3e-3, inside the band from r F η_b − τ_c to r F/η + τ_c.
    still = DRIVE_TIMES > 4.5
    assert np.all(found["omega"][still] == 0.0)
    assert np.all(found["theta"][still] == found["theta"][still][0])


def test_a_tensioned_drive_runs_back_when_the_load_beats_its_loss() -> None:
    voltage = np.where(DRIVE_TIMES < 10.0, 12.0, 0.0)
    found = states(shipped("bb0b_drive"), drive(voltage))
    assert found["theta"][-1] < found["theta"].max() - 5.0
    r = 0.002 / (2 * np.pi * 84)
    force = r * found["theta"][-1] / (1 / 30600 + 1 / 190000)
    assert r * force * 0.55 > 1e-3  # the figure behind it


def test_a_slack_string_carries_nothing() -> None:
    run = Run(
        np.array([0.0, 0.5]), {"motor_voltage_v": np.array([0.0, 0.0])}, known={"nut_position_m": -0.004}
    )
    found = simulate(shipped("bb0b_drive"), run)
    assert np.all(found["spring_compression_m"] == 0.0)
    assert np.allclose(found["nut_position_m"], -0.004, rtol=0, atol=1e-15)


def test_axis_and_drop() -> None:
    axis = plant_of("{format: 1, plant: cart, kind: axis, parameters: {m: {value: 2.0, std: 0.1, unit: kg}}}")
    times = np.array([0.0, 1.0, 2.0])
    run = Run(
        times, {"force_n": np.array([1.0, -1.0, 0.0])}, known={"position_m": 0.5, "velocity_m_s": -0.25}
    )
    found = simulate(axis, run)
    assert np.allclose(found["position_m"], [0.5, 0.5, 0.5], rtol=0, atol=1e-12)
    assert np.allclose(found["acceleration_m_s2"], [0.5, -0.5, 0.0], rtol=0, atol=1e-12)
    drop = plant_of(
        "{format: 1, plant: ball, kind: drop, parameters: "
        "{m: {value: 0.1, std: 0, unit: kg}, g: {value: 9.81, std: 0, unit: m/s^2}}}"
    )
    falling = Run(times, known={"height_m": 40.0, "velocity_m_s": 1.0})
    assert np.allclose(
        simulate(drop, falling)["height_m"], 40.0 + times - 4.905 * times**2, rtol=0, atol=1e-10
    )
    dragged = drop.with_effect(
        use_of(drop, "aerodynamic_drag_quadratic", "ballistic", {"cd_a": 0.01, "rho": 1.2})
    )
    terminal = np.sqrt(0.1 * 9.81 / (0.5 * 1.2 * 0.01))
    speeds = states(dragged, Run(np.array([0.0, 60.0]), known={"height_m": 0.0, "velocity_m_s": 0.0}))["dz"]
    assert speeds[-1] == pytest.approx(-terminal, rel=1e-6)


def test_a_run_that_says_too_little_is_refused_in_words() -> None:
    with pytest.raises(
        SimulationError, match=r"conditions\.surface = None is not in the plant file; known: steel"
    ):
        simulate(shipped("bb0b_hop"), Run(DENSE, known={"spring_compression_m": 0.03}))
    with pytest.raises(SimulationError, match=r"does not give state\.spring_compression_m"):
        simulate(shipped("bb0b_hop"), Run(DENSE, conditions={"surface": "syar"}))
    with pytest.raises(SimulationError, match="no state 'w' to start at"):
        simulate(shipped("bb0b_hop"), hop_run(DENSE), {"w": 1.0})


def test_the_missing_force_enters_each_place_that_the_kind_names() -> None:
    for name, run in (("bb0b_hop", hop_run(DENSE)), ("bb0b_drive", drive(8.0))):
        plant = shipped(name)
        nominal = compile_plant(plant)
        reference = nominal.run(nominal.values, run)
        for balance in nominal.balances:
            compiled = compile_plant(plant, missing_force=balance)
            zero = compiled.run(compiled.values, run)
            assert np.allclose(zero, reference, rtol=0, atol=1e-12 + 1e-12 * np.abs(reference).max())
            scale = {"N": 5.0, "N*m": 2e-4, "V": 0.5}[compiled.balances[balance].unit]
            pushed = compiled.run(compiled.values, run, {"missing_force": scale})
            assert np.abs(pushed - reference).max() > 1e-5, balance


def test_a_simulator_steps_as_the_whole_run_goes() -> None:
    voltage = np.where(DRIVE_TIMES < 1.0, 9.0, -3.0)
    whole = simulate(shipped("bb0b_drive"), drive(voltage))
    simulator = Simulator(shipped("bb0b_drive"))
    for index in range(400):
        reading = simulator.outputs()
        for channel, values in whole.items():
            assert reading[channel] == pytest.approx(values[index], rel=1e-7, abs=1e-9)
        simulator.advance(DRIVE_TIMES[index + 1], {"motor_voltage_v": voltage[index]})
    assert simulator.time_s == DRIVE_TIMES[400]


def late_drive(physics_id: str, **values: float) -> Plant:
    plant = shipped("bb0b_drive")
    return plant.with_effect(use_of(plant, physics_id, "sensor", values, "nut_position_m"))


@pytest.mark.parametrize("traced", [False, True])
def test_a_simulator_reads_a_late_channel_late(traced: bool) -> None:
    late = late_drive("sensor_delay", delay=0.01)  # two of the steps: on what was remembered
    whole = simulate(late, drive(9.0))
    simulator = Simulator(late, definitions=False)
    simulator.advance(0.0, {"motor_voltage_v": 9.0})
    for index in range(1, 200):
        if traced:
            (row,) = simulator.trace([DRIVE_TIMES[index]])
        else:
            simulator.advance(DRIVE_TIMES[index])
            row = simulator.values()
        for channel, value in zip(simulator.names, row, strict=True):
            assert value == pytest.approx(whole[channel][index], rel=1e-7, abs=1e-9)


def test_a_simulator_cannot_read_what_is_to_come() -> None:
    early = late_drive("clock_skew", skew=0.01)
    with pytest.raises(SimulationError, match="nut_position_m is early"):
        Simulator(early)


def test_a_simulator_that_tells_no_definitions_says_the_same_of_the_outputs() -> None:
    told, silent = Simulator(shipped("bb0b_drive")), Simulator(shipped("bb0b_drive"), definitions=False)
    assert silent.names == tuple(shipped("bb0b_drive").structure.outputs) != told.names
    for time_s, voltage in ((0.4, 9.0), (0.7, -3.0)):
        for simulator in (told, silent):
            simulator.advance(time_s, {"motor_voltage_v": voltage})
        everything = told.outputs()
        assert silent.outputs() == {name: everything[name] for name in silent.names}


def test_an_event_can_be_set_while_the_simulator_runs() -> None:
    simulator = Simulator(
        shipped("bb0b_hop"), conditions={"surface": "syar"}, known={"spring_compression_m": 0.03}
    )
    simulator.advance(0.1)
    assert not simulator.flag("opened") and simulator.flag_time_s("opened") is None
    simulator.set_event("fire_command", 0.1)
    simulator.advance(0.2)
    assert simulator.flag("opened")
    for call, words in (
        (lambda: simulator.set_event("fire_command", 0.1), "in the past"),
        (lambda: simulator.set_event("lunch", 0.3), "no event 'lunch'; events: fire_command"),
        (lambda: simulator.advance(0.1), "cannot go back"),
        (lambda: simulator.advance(0.3, {"motor_voltage_v": 1.0}), "no input 'motor_voltage_v'"),
        (lambda: simulator.flag("open"), "no flag 'open'"),
    ):
        with pytest.raises(SimulationError, match=words):
            call()


def test_a_kind_or_geometry_that_is_not_there_is_refused() -> None:
    for text, words in (
        ("{format: 1, plant: x, kind: rocket}", "kind = 'rocket' is not known; known here: equations, axis"),
        ("{format: 1, plant: x, kind: drop, geometry: arm}", "geometry = 'arm' is not known for kind drop"),
    ):
        with pytest.raises(PlantError, match=words):
            plant_of(text)
