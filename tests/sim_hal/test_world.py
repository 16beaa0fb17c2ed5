"""The simulated robot against closed forms, and the sequence of lock, string and hop."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from sim_helpers import Opener, hop, let_run

from hal.config import config_path
from sim_hal.plant.simulate import Plant, load_plant


def values(name: str) -> dict[str, float]:
    """Parameter values of a shipped plant."""
    plant: Plant = load_plant(config_path("plant", name))
    return {key: parameter.value for key, parameter in plant.parameters.items()}


DRIVE = values("bb0b_drive.yaml")
HOP = values("bb0b_hop.yaml")
TRAVEL_PER_RAD_M = DRIVE["p"] / (2 * math.pi * DRIVE["N"])


def test_slack_drive_runs_at_the_speed_of_the_closed_form(open_board: Opener) -> None:
    """Steady: K i = b ω + τ_c and u = R i + K ω."""
    board = open_board(initial={"nut_position_m": -0.002, "latch_closed": False})
    let_run(board, 0.6, 6.0)
    start_m, start_s = board.nut_encoder.read().position_m, board.nut_encoder.read().time_s
    currents = []
    for _ in range(100):
        let_run(board, 0.005, 6.0)
        currents.append(board.motor_current.read().current_a)
    end = board.nut_encoder.read()
    damping = DRIVE["b"] + DRIVE["K"] ** 2 / DRIVE["R"]
    omega = (DRIVE["K"] * 6.0 / DRIVE["R"] - DRIVE["tau_c"]) / damping
    current_a = (DRIVE["b"] * omega + DRIVE["tau_c"]) / DRIVE["K"]
    assert (end.position_m - start_m) / (end.time_s - start_s) == pytest.approx(
        omega * TRAVEL_PER_RAD_M, rel=1e-5
    )
    assert np.mean(currents) == pytest.approx(current_a, abs=5 * 0.002 / math.sqrt(100))


def test_loaded_drive_draws_the_current_that_the_spring_asks_for(open_board: Opener) -> None:
    """Quasi-static: K i = b ω + τ_c + r F/η with F = k s, the speed read off the encoder."""
    board = open_board(initial={"nut_position_m": 0.02, "latch_closed": True})
    let_run(board, 0.2, 8.0)
    first, currents, forces = board.nut_encoder.read(), [], []
    for _ in range(60):
        let_run(board, 0.005, 8.0)
        currents.append(board.motor_current.read().current_a)
        forces.append(DRIVE["k"] * board.world.spring_compression_m)
    last = board.nut_encoder.read()
    omega = (last.position_m - first.position_m) / (last.time_s - first.time_s) / TRAVEL_PER_RAD_M
    torque = DRIVE["b"] * omega + DRIVE["tau_c"] + TRAVEL_PER_RAD_M * np.mean(forces) / DRIVE["eta"]
    assert np.mean(currents) == pytest.approx(torque / DRIVE["K"], abs=5 * 0.002 / math.sqrt(60))


def test_found_loaded_the_spring_holds_what_the_string_imposes(open_board: Opener, loaded: Any) -> None:
    """s = x/(1 + k/k_m); without voltage the screw does not give way at this load or it goes back home."""
    board = open_board(initial=loaded)
    expected_m = 0.038 / (1.0 + DRIVE["k"] / DRIVE["k_m"])
    assert board.world.spring_compression_m == pytest.approx(expected_m, rel=1e-6)
    assert board.spring.read().compression_m[0] == pytest.approx(expected_m, abs=5 * 20e-6)


def test_a_hop_stores_and_releases_the_stated_energy(open_board: Opener, loaded: Any) -> None:
    board = open_board(initial=loaded)
    compression_m = board.world.spring_compression_m
    hop(board)
    truth = board.world.hops[0]
    f_grav_m = HOP["m_b"] * HOP["g"] / HOP["k"]
    stored_j = 0.5 * HOP["k"] * ((f_grav_m + compression_m) ** 2 - f_grav_m**2)
    assert truth.spring_compression_m == compression_m
    assert truth.energy_used_j == pytest.approx(stored_j, rel=1e-12)
    rise_s = -HOP["L_em"] / HOP["R_em"] * math.log(1.0 - HOP["i_trip"] * HOP["R_em"] / HOP["u_em"])
    assert truth.opening_s - truth.fire_s == pytest.approx(rise_s, abs=1e-6)
    assert truth.c3 == 0.0  # the steel reference itself


def flight_level_m_s2(board: Any, rho_share: float) -> float:
    """Constant part of the accelerometer in flight, its ringing fitted away by its own closed form."""
    truth = board.world.hops[-1]
    reading = board.accelerometer.read()
    times = np.array(reading.times_s)
    inside = (times > truth.take_off_s + 0.002) & (times < truth.touchdown_s - 0.002)
    t, a = times[inside] - truth.take_off_s, np.array(reading.specific_force_m_s2)[inside]
    reduced_kg = HOP["m_b"] * HOP["m_l"] / (HOP["m_b"] + HOP["m_l"])
    decay = HOP["c"] / (2 * reduced_kg)
    omega = math.sqrt(HOP["k"] / reduced_kg - decay**2)
    ringing = np.exp(-decay * t)
    basis = np.column_stack([np.ones_like(t), ringing * np.cos(omega * t), ringing * np.sin(omega * t)])
    solution = np.linalg.lstsq(basis, a, rcond=None)[0]
    assert math.hypot(solution[1], solution[2]) > 20.0 * rho_share  # it does ring: several g
    return float(solution[0])


DEEP_FIFO = {
    "accelerometer": {
        "step": 0.00957,
        "depth": 100_000,
        "modes": [{"rate_hz": 1666.0, "noise_std": 0.035, "low": -313.8, "high": 313.8}],
    }
}


def test_in_flight_the_vertical_robot_reads_zero_on_average(open_board: Opener, loaded: Any) -> None:
    board = open_board(initial=loaded, sensors=DEEP_FIFO)
    hop(board)
    assert flight_level_m_s2(board, 1.0) == pytest.approx(0.0, abs=0.02)


def test_in_flight_the_arm_reads_what_its_radius_leaves(open_board: Opener, loaded: Any) -> None:
    """At ρ = L the reading is (g_local − g) cos θ with g = M g_local L²/I: +0.94 m/s², less the cosine."""
    board = open_board(initial=loaded, sensors=DEEP_FIFO, plants={"hop": "plant/bb0b_hop_arm.yaml"})
    let_run(board, 0.1)
    assert np.mean(board.accelerometer.read().specific_force_m_s2) == pytest.approx(9.81, abs=0.02)
    hop(board)
    assert flight_level_m_s2(board, 1.0) == pytest.approx(9.81 - HOP["g"], abs=0.02)


def test_the_lock_takes_the_string_only_at_home_and_without_magnet(open_board: Opener) -> None:
    board = open_board(initial={"nut_position_m": -0.0005, "latch_closed": False})
    board.magnet.switch_on()
    let_run(board, 1.0, -6.0, until=lambda: board.world.at_home)
    let_run(board, 0.1)
    assert board.switches.read().at_home
    assert not board.switches.read().latch_closed
    board.magnet.switch_off()
    let_run(board, 0.1)
    assert board.switches.read().latch_closed
    let_run(board, 2.0, 8.0)
    assert board.world.spring_compression_m > 0.001  # now the nut pulls on the springs


def test_with_the_lock_open_the_nut_pulls_on_nothing(open_board: Opener) -> None:
    board = open_board(initial={"nut_position_m": 0.010, "latch_closed": False})
    let_run(board, 1.0, 8.0)
    assert board.world.nut_position_m > 0.011
    assert board.world.spring_compression_m == 0.0


def test_a_magnet_pulse_too_short_to_trip_releases_nothing(open_board: Opener, loaded: Any) -> None:
    board = open_board(initial=loaded)
    board.magnet.switch_on()
    let_run(board, 0.005)
    board.magnet.switch_off()
    let_run(board, 0.2)
    assert board.world.latch_closed
    assert not board.world.hops
    assert board.world.spring_compression_m > 0.03


def test_after_a_hop_the_robot_stands_relaxed_and_can_hop_again(open_board: Opener, loaded: Any) -> None:
    spots = [{"surface": "quartz_sand"}, {"surface": "quartz_sand"}, {"surface": "syar"}]
    board = open_board(initial=loaded, spots=spots)
    hop(board)
    let_run(board, 0.2)
    board.spring.read()
    let_run(board, 0.2)
    assert max(map(abs, board.spring.read().compression_m)) < 6 * 20e-6
    assert not board.switches.read().latch_closed
    assert board.world.conditions["hop_index"] == 1.0
    let_run(board, 40.0, -11.0, until=lambda: board.world.latch_closed)
    let_run(board, 4.0, 11.0, until=lambda: board.world.spring_compression_m > 0.008)
    hop(board)
    assert [truth.spot.surface for truth in board.world.hops] == ["quartz_sand", "quartz_sand"]
    assert board.world.conditions == {
        "temperature_c": 20.0, "surface": "syar", "foot": 1.0, "tilt_deg": 0.0, "hop_index": 0.0
    }  # fmt: skip


def test_an_end_stop_holds_the_nut_and_the_motor_stalls(open_board: Opener) -> None:
    board = open_board(initial={"nut_position_m": -0.0025, "latch_closed": False})
    let_run(board, 1.0, -6.0)
    assert board.world.nut_position_m == pytest.approx(-0.003, abs=1e-9)
    assert board.motor_current.read().current_a == pytest.approx(-6.0 / 3.3, abs=0.02)
    let_run(board, 0.5, 6.0)
    assert board.world.nut_position_m > -0.0029
