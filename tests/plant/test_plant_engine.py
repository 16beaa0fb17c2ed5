"""The integrator against closed forms: smooth motion, stick and slip, flags, memories, and its refusals."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from plant_helpers import block, hop_run, plant_of, pushed, shipped, simulate, states, use_of

from sim_hal.plant.simulate import PlantError, Run, SimulationError, compile_plant

LENGTH = "l: {value: 1.0, std: 0, unit: m}"
UNEVEN = np.cumsum(np.concatenate([[0.0], 0.001 + 0.009 * np.random.default_rng(1).random(400)]))


def test_inductive_circuit_follows_its_exponential() -> None:
    plant = plant_of("""
format: 1
name: coil
kind: equations
inputs: {supply_v: {unit: V, interpolation: hold}}
states: {i: {unit: A, initial: 0}}
parameters: {R: {value: 3.3, std: 0, unit: ohm}, L: {value: 0.8e-3, std: 0, unit: H}}
equations: {mesh: {state: i, rate: (supply_v - R * i) / L, balance: true, per_force: 1 / L}}
outputs: {coil_a: {value: i}}
""")
    found = simulate(plant, Run(UNEVEN, {"supply_v": np.full(UNEVEN.shape, 6.0)}))["coil_a"]
    assert np.allclose(found, 6.0 / 3.3 * (1.0 - np.exp(-UNEVEN * 3.3 / 0.8e-3)), rtol=0, atol=2e-8)
    assert compile_plant(plant).balances["mesh"].unit == "V"


def test_damped_oscillator_at_uneven_times() -> None:
    plant = plant_of(block("push_n - k * q - 0.2 * m * v * w", "", "w: {value: 1.0, std: 0, unit: 1/s}"))
    found = simulate(plant, pushed(UNEVEN, 0.0), {"q": 0.1})["position_m"]
    decay, omega = 0.1, np.sqrt(25.0 - 0.01)
    wave = np.cos(omega * UNEVEN) + decay / omega * np.sin(omega * UNEVEN)
    assert np.allclose(found, 0.1 * np.exp(-decay * UNEVEN) * wave, rtol=0, atol=1e-8)


def test_inputs_linear_between_samples_are_integrated_exactly() -> None:
    times = np.array([0.0, 0.3, 1.0])
    found = simulate(plant_of(block()), pushed(times, np.array([0.0, 3.0, 3.0])))
    assert np.allclose(found["speed_m_s"], [0.0, 0.225, 0.225 + 1.05], rtol=0, atol=1e-12)
    assert np.allclose(found["acceleration_m_s2"], [0.0, 1.5, 1.5], rtol=0, atol=1e-12)


def test_held_input_acts_from_its_own_sample_on() -> None:
    plant = plant_of(block().replace("linear", "hold"))
    times = np.array([0.0, 0.5, 1.0])
    found = simulate(plant, pushed(times, np.array([2.0, 4.0, 0.0])))
    assert np.allclose(found["speed_m_s"], [0.0, 0.5, 1.5], rtol=0, atol=1e-12)
    assert np.allclose(found["acceleration_m_s2"], [1.0, 2.0, 0.0], rtol=0, atol=1e-12)


def test_a_missing_sample_is_bridged() -> None:
    times = np.array([0.0, 0.5, 1.0])
    whole = simulate(plant_of(block()), pushed(times, np.array([0.0, 1.0, 2.0])))
    gap = simulate(plant_of(block()), pushed(times, np.array([0.0, np.nan, 2.0])))
    assert np.array_equal(whole["position_m"], gap["position_m"])


def rubbed(level: float = 1.0) -> str:
    """The block on a spring and a dry floor."""
    friction = f"friction: {{force_balance: {{forward: {level} * f, backward: {level} * f}}}}"
    return block("push_n - k * q", friction, "f: {value: 1.0, std: 0, unit: N}")


def test_free_swing_with_dry_friction_loses_the_same_each_half_period() -> None:
    # Each half period takes 2 f/k off the amplitude; the block stops where k|q| <= f, and stays there exactly.
    plant = plant_of(rubbed())
    times = np.linspace(0.0, 6.0, 601)
    found = states(plant, pushed(times, 0.0), {"q": 0.095})
    half = np.pi / 5.0
    at_turns = states(plant, pushed(np.array([0.0, half, 2 * half]), 0.0), {"q": 0.095})["q"]
    assert np.allclose(at_turns, [0.095, -0.055, 0.015], rtol=0, atol=1e-9)
    rest = found["q"][times > 2 * half + 1e-3]
    assert np.all(found["v"][times > 2 * half + 1e-3] == 0.0)
    assert np.all(rest == rest[0])


def test_stick_holds_exactly_and_breaks_away_at_the_band() -> None:
    # A slow ramp: nothing moves, to the bit, until the push has reached the friction.
    plant = plant_of(rubbed())
    times = np.linspace(0.0, 4.0, 801)
    found = states(plant, pushed(times, 0.5 * times))
    stuck = times <= 2.0
    assert np.all(found["q"][stuck] == 0.0) and np.all(found["v"][stuck] == 0.0)
    later = times[~stuck] - 2.0
    exact = 0.5 / 50.0 * (later - np.sin(5.0 * later) / 5.0)
    moving = later < 2 * np.pi / 5.0  # until the block comes to rest again
    assert np.allclose(found["q"][~stuck][moving], exact[moving], rtol=0, atol=1e-9)


def test_friction_on_a_moving_belt_sticks_to_the_belt() -> None:
    contact = """
balances:
  contact: {equation: force_balance, per_force: {v: 1 / m}, velocity: v - belt, position: q}
friction: {contact: {forward: f, backward: f}}
"""
    values = "f: {value: 5.0, std: 0, unit: N}\n  belt: {value: 0.05, std: 0, unit: m/s}"
    times = np.linspace(0.0, 1.9, 96)
    found = states(plant_of(block("-k * q", contact, values)), pushed(times, 0.0), {"v": 0.05})
    assert np.all(found["v"] == 0.05)  # carried along until k q reaches f, at t = 2 s
    assert np.allclose(found["q"], 0.05 * times, rtol=0, atol=1e-12)


def test_two_blocks_rub_on_each_other_and_keep_their_momentum() -> None:
    plant = plant_of("""
format: 1
name: pair
kind: equations
states:
  v: {unit: m/s, initial: 1.0}
  w: {unit: m/s, initial: 0.0}
parameters: {m: {value: 1.0, std: 0, unit: kg}, n: {value: 3.0, std: 0, unit: kg}, f: {value: 2.0, std: 0, unit: N}}
equations:
  first: {state: v, rate: 0, balance: true, per_force: 1 / m}
  second: {state: w, rate: 0, balance: true, per_force: 1 / n}
balances:
  between: {per_force: {v: 1 / m, w: -1 / n}, velocity: v - w}
friction: {between: {forward: f, backward: f}}
outputs: {first_m_s: {value: v}, second_m_s: {value: w}}
""")
    times = np.linspace(0.0, 1.0, 101)
    found = states(plant, Run(times))
    assert np.allclose(found["v"] + 3.0 * found["w"], 1.0, rtol=0, atol=1e-14)
    joined = times > 0.376  # 1 / (f/m + f/n) = 0.375 s
    assert np.allclose(found["v"][joined], 0.25, rtol=0, atol=1e-12)
    assert np.all(np.abs(found["v"] - found["w"])[joined] < 1e-15)


def test_a_flag_latches_when_its_condition_is_first_met() -> None:
    text = block("where(far, 0, push_n)", "flags: {far: {when: q >= 0.25 * l}}", LENGTH)
    found = simulate(plant_of(text), pushed(np.linspace(0.0, 2.0, 21), 2.0))
    # q = t²/2 reaches 0.25 at t = sqrt(0.5) with v = sqrt(0.5); from there on no force.
    assert found["speed_m_s"][-1] == pytest.approx(np.sqrt(0.5), abs=1e-9)
    assert found["position_m"][-1] == pytest.approx(0.25 + np.sqrt(0.5) * (2.0 - np.sqrt(0.5)), abs=1e-9)


def test_a_flag_may_wait_for_another() -> None:
    flags = "flags: {far: {when: q >= 0.25 * l}, late: {when: far and since(far) >= w}}"
    text = block("where(late, 0, push_n)", flags, f"{LENGTH}\n  w: {{value: 0.2, std: 0, unit: s}}")
    found = simulate(plant_of(text), pushed(np.linspace(0.0, 2.0, 21), 2.0))
    assert found["speed_m_s"][-1] == pytest.approx(np.sqrt(0.5) + 0.2, abs=1e-9)


def test_running_maximum_is_the_largest_value_so_far() -> None:
    text = block("-k * q", "memories: {top: {unit: m, lower: q, initial: 0}}").replace(
        "outputs:", "outputs:\n  top_m: {value: top}", 1
    )
    times = np.linspace(0.0, 3.0, 301)
    found = simulate(plant_of(text), pushed(times, 0.0), {"v": 0.5})
    exact = 0.1 * np.sin(5.0 * times)
    assert np.allclose(
        found["top_m"], np.maximum.accumulate(np.where(times < np.pi / 10, exact, 0.1)), atol=1e-9
    )


def test_play_follows_only_beyond_its_gap() -> None:
    play = "memories: {follower: {unit: m, lower: q - 0.03 * l, upper: q + 0.03 * l, initial: 0}}"
    text = block("-k * q", play, LENGTH).replace("outputs:", "outputs:\n  follower_m: {value: follower}", 1)
    times = np.linspace(0.0, 2.0, 401)
    found = simulate(plant_of(text), pushed(times, 0.0), {"v": 0.5})
    follower, exact = 0.0, []
    for value in 0.1 * np.sin(5.0 * np.linspace(0.0, 2.0, 40001)):
        follower = min(max(follower, value - 0.03), value + 0.03)
        exact.append(follower)
    assert np.allclose(found["follower_m"], exact[::100], rtol=0, atol=1e-7)


def test_what_blows_up_is_refused_in_words() -> None:
    explosive = plant_of(block("push_n + k * q * q / l", "", LENGTH))
    with pytest.raises(SimulationError, match=r"block: .* at t = \d"):
        simulate(explosive, pushed(np.array([0.0, 100.0]), 1.0))
    infinite = plant_of(block("push_n", "", LENGTH).replace("rate(v)}", "rate(v) / (q / l * 0)}"))
    with pytest.raises(SimulationError, match="acceleration_m_s2 is not finite at t"):
        simulate(infinite, pushed(np.array([0.0, 1.0]), 1.0))


def test_negative_dry_friction_is_refused_in_words() -> None:
    with pytest.raises(SimulationError, match="dry friction is negative"):
        simulate(plant_of(rubbed(-1.0)), pushed(np.array([0.0, 1.0]), 1.0))


def test_an_endless_run_stops_at_its_limit_of_steps() -> None:
    compiled = compile_plant(plant_of(block("push_n - k * q")))
    limited = compiled.__class__(**{**vars(compiled), "tolerances": compiled.tolerances._replace(steps=50)})
    with pytest.raises(SimulationError, match="more than the allowed number of steps"):
        limited.run(limited.values, pushed(np.array([0.0, 100.0]), 1.0))


@pytest.mark.parametrize(
    ("run", "words"),
    [
        (Run(np.array([0.0, 0.0])), "increase"),
        (Run(np.array([])), "at least one sample"),
        (Run(np.array([0.0, 1.0])), "lacks the input 'push_n'"),
        (Run(np.array([0.0, 1.0]), {"push_n": np.array([1.0])}), "has 1 samples"),
        (Run(np.array([0.0, 1.0]), {"push_n": np.array([np.nan, np.nan])}), "no finite values"),
    ],
)
def test_a_run_that_cannot_be_is_refused_in_words(run: Run, words: str) -> None:
    with pytest.raises(SimulationError, match=words):
        simulate(plant_of(block()), run)


def test_initial_value_from_the_first_samples_of_a_channel() -> None:
    text = block().replace("q: {unit: m, initial: 0}", "q: {unit: m, initial: position_m}")
    plant = plant_of(text.replace("v: {unit: m/s, initial: 0}", "v: {unit: m/s, initial: fit}"))
    times = np.linspace(0.0, 0.19, 20)
    noise = np.random.default_rng(3).normal(0.0, 1e-4, 20)
    run = Run(times, {"push_n": np.zeros(20)}, first_samples={"position_m": 0.3 + 0.7 * times + noise})
    compiled = compile_plant(plant)
    assert compiled.fitted_initial_states == ("v",)
    start = compiled.initial_values(compiled.values, run)
    # Five sigma of the quadratic's value and slope at its first point.
    assert start["q"] == pytest.approx(0.3, abs=5 * 0.7e-4)
    assert start["v"] == pytest.approx(0.7, abs=5 * 2e-3)
    with pytest.raises(SimulationError, match="first samples of position_m"):
        compiled.run(compiled.values, Run(times, {"push_n": np.zeros(20)}))


def test_rates_at_a_point_and_a_missing_force() -> None:
    compiled = compile_plant(plant_of(rubbed()), missing_force="force_balance")
    assert compiled.state_names == ("q", "v", "missing_force")
    run = pushed(np.array([0.0, 1.0]), 3.0)
    moving = compiled.rates(compiled.values, run, 0.5, np.array([0.01, 0.2, 0.4]))
    assert np.allclose(moving, [0.2, (3.0 - 0.5 - 1.0 + 0.4) / 2.0, 0.0], rtol=1e-14)
    stuck = compiled.rates(compiled.values, run, 0.5, np.array([0.05, 0.0, 0.4]))
    assert np.allclose(stuck, 0.0, atol=1e-15)
    with pytest.raises(PlantError, match="no balance that a missing force may enter"):
        compile_plant(plant_of(rubbed()), missing_force="kinematics")


def test_effects_of_zero_strength_change_no_bit() -> None:
    plant = plant_of(rubbed())
    run = pushed(UNEVEN, 3.0 * np.sin(9.0 * UNEVEN))
    nothing = [
        use_of(plant, "coulomb_friction", "force_balance", {"F_c": 0.0}),
        use_of(plant, "viscous_friction", "force_balance", {"F_v": 0.0}),
        use_of(plant, "stribeck_friction", "force_balance", {"F_s": 0.0, "v_s": 0.1}),
        use_of(plant, "quadratic_friction", "force_balance", {"F_q": 0.0}),
        use_of(plant, "added_inertia", "force_balance", {"m_a": 0.0}),
        use_of(plant, "presliding_hysteresis", "force_balance", {"F_d": 0.0, "s_p": 1e-3}),
        use_of(plant, "sensor_scale", "sensor", {"scale": 0.0}, "position_m"),
        use_of(plant, "sensor_delay", "sensor", {"delay": 0.0}, "speed_m_s"),
    ]
    nominal = simulate(plant, run)
    for use in nothing:
        with_it = simulate(plant.with_effect(use), run)
        for channel, values in nominal.items():
            assert np.array_equal(values, with_it[channel]), (use.physics_id, channel)


def test_the_order_of_effects_does_not_matter_to_the_bit() -> None:
    plant = plant_of(rubbed())
    run = pushed(UNEVEN, 6.0 * np.sin(9.0 * UNEVEN))
    uses = [
        use_of(plant, "coulomb_friction", "force_balance", {"F_c": 0.3}),
        use_of(plant, "viscous_friction", "force_balance", {"F_v": 0.7}),
        use_of(plant, "stribeck_friction", "force_balance", {"F_s": 0.4, "v_s": 0.02}),
        use_of(plant, "asymmetric_friction", "force_balance", {"F_o": 0.2}),
        use_of(plant, "added_inertia", "force_balance", {"m_a": 0.11}),
        use_of(plant, "sensor_bias", "sensor", {"bias": 0.01}, "position_m"),
        use_of(plant, "sensor_scale", "sensor", {"scale": 0.03}, "position_m"),
    ]
    forward = backward = plant
    for use in uses:
        forward = forward.with_effect(use)
    for use in reversed(uses):
        backward = backward.with_effect(use)
    first, second = simulate(forward, run), simulate(backward, run)
    for channel, values in first.items():
        assert np.array_equal(values, second[channel])
    assert not np.allclose(first["position_m"], simulate(plant, run)["position_m"], atol=1e-4)


WITHOUT_COMPILER = """
import sys
sys.modules["llvmlite"] = None
sys.path[:0] = [sys.argv[1]]
import numpy as np
from plant_helpers import hop_run, shipped, simulate
found = simulate(shipped("bb0b_hop"), hop_run(np.arange(0.0, 0.07, 0.001)))
print(" ".join(repr(float(value)) for value in found["spring_compression_m"]))
"""


def test_without_a_compiler_the_same_comes_out_slower_and_that_is_said() -> None:
    folder = str(Path(__file__).parent)
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_COMPILER, folder], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("llvmlite is not installed: simulations run some hundred times slower") == 1
    plain = np.array([float(text) for text in done.stdout.split()])
    compiled = simulate(shipped("bb0b_hop"), hop_run(np.arange(0.0, 0.07, 0.001)))["spring_compression_m"]
    assert np.allclose(plain, compiled, rtol=0, atol=1e-12)
