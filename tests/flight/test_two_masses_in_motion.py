"""The estimator's two masses against fine stepping: ringing in flight, and what a push of the ground adds."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.optimize import brentq

from flight.contact import Contact, Ground, _free_step
from flight.ringing import Ringing, TwoMass

LEG_SHARE, STIFFNESS_1_S2, DAMPING_1_S, STEP_S = 0.284, 20_000.0, 12.0, 2e-5
ringings = st.builds(
    Ringing,
    st.floats(-0.1, 0.1),
    st.floats(80.0, 200.0),
    st.floats(0.0, 12.0),
    st.floats(-50, 50),
    st.floats(-50, 50),
)
ROBOT = TwoMass(LEG_SHARE, 8.874)


@given(ringings, st.floats(0.0, 0.3))
def test_the_compression_swings_freely_and_the_body_feels_it(ringing: Ringing, time_s: float) -> None:
    """delta'' = -omega_0^2 delta - 2 lambda delta', and the specific force is -(m_l/M) delta''."""
    delta, rate = ringing.compression(time_s, ROBOT)
    (felt,) = ringing.acceleration_m_s2(np.array((time_s,)))
    second = -ringing.stiffness_1_s2 * delta - 2.0 * ringing.decay_1_s * rate
    assert felt == pytest.approx(-LEG_SHARE * second, abs=1e-9)
    h = 1e-6
    before, after = (ringing.compression(time_s + d, ROBOT)[0] for d in (-h, h))
    assert (after - before) / (2 * h) == pytest.approx(rate, abs=1e-6)
    assert ringing.stiffness_1_s2 == pytest.approx(abs(ringing.pole) ** 2)


@given(ringings, st.floats(-0.2, 0.2))
def test_from_another_time_it_is_the_same_ringing(ringing: Ringing, time_s: float) -> None:
    times = np.linspace(-0.1, 0.3, 50)
    again = ringing.seen_from(time_s)
    assert (again.reference_s, again.pole) == (time_s, ringing.pole)
    np.testing.assert_allclose(
        again.acceleration_m_s2(times), ringing.acceleration_m_s2(times), rtol=1e-9, atol=1e-9
    )
    assert ringing.phasor(time_s).real == pytest.approx(ringing.acceleration_m_s2(np.array((time_s,)))[0])


@pytest.mark.parametrize("from_s", [0.0, 0.05])
def test_dry_friction_takes_its_share_at_each_turn_of_the_spring(from_s: float) -> None:
    """The spring with friction, stepped finely from `from_s` on, against the free ringing and friction's wave.

    The body's specific force is -(m_l/M) delta'', which friction shifts by its sign and so turns round in steps.
    """
    friction, step_s = 0.4, 1e-6
    free = Ringing(0.02, 120.0, 20.0, 80.0, 20.0)
    delta, rate = free.compression(from_s, ROBOT)
    sign = math.copysign(1.0, rate)
    delta -= sign * friction / (LEG_SHARE * free.stiffness_1_s2)
    seen = []
    for index in range(100_001):
        if index % 250 == 0:
            spring = free.stiffness_1_s2 * delta + 2.0 * free.decay_1_s * rate
            seen.append(LEG_SHARE * spring + math.copysign(friction, rate))
        pull = free.stiffness_1_s2 * delta + 2.0 * free.decay_1_s * rate
        rate -= step_s * (pull + math.copysign(friction, rate) / LEG_SHARE)
        delta += step_s * rate
    times = from_s + 250 * step_s * np.arange(len(seen))
    free_only, wave = free.acceleration_m_s2(times), friction * free.half_turns(times, from_s)
    assert np.abs(free_only - seen).max() > 1.0
    # a sample next to a turn may lie on its other side
    assert np.quantile(np.abs(free_only + wave - seen), 0.95) < 0.02


def test_looking_back_dry_friction_gives_what_it_will_have_taken() -> None:
    """Before `from_s` the wave is larger by two for each turn that is still to come before it."""
    free = Ringing(0.0, 100.0, 0.0, 10.0, 0.0)
    times = np.array((-0.9, -1.9, -2.9, 0.4, 1.4)) * math.pi / 100.0  # turns are at multiples of pi/omega
    found = free.half_turns(times, -1e-4)
    np.testing.assert_allclose(found / np.cos(100.0 * times), (0.0, 2.0, 4.0, -2.0, -4.0), atol=1e-9)


def test_a_turn_counts_from_itself_on_to_the_bit() -> None:
    """Turns at whole numbers; the one at `from_s` is still to come."""
    free = Ringing(0.0, math.pi, 0.0, 10.0, 0.0)
    times = np.array((0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5))
    wave = np.cos(math.pi * times)
    expected = np.array((2.0, 0.0, 0.0, 0.0, -2.0, -2.0, -4.0)) * wave
    np.testing.assert_allclose(free.half_turns(times, 2.0), expected, atol=1e-12)


@pytest.mark.parametrize("after_s", [0.0, 0.03, 0.06])
def test_a_short_look_at_a_turn_sees_it(after_s: float) -> None:
    """The turn is where the spring stands still, by the compression's own rate."""
    free = Ringing(0.02, 120.0, 20.0, 80.0, 20.0)
    turn_s = brentq(lambda t: free.compression(t, ROBOT)[1], after_s, after_s + math.pi / 120.0)
    times = turn_s + np.array((-1e-4, 1e-4))
    before, after = free.half_turns(times, turn_s - 1e-3)
    assert before == 0.0
    felt = free.acceleration_m_s2(times)[1]
    assert after == pytest.approx(-math.copysign(2.0, felt), rel=0.05)


@pytest.mark.parametrize(("stiffness_1_s2", "damping_1_s"), [(2e4, 12.0), (400.0, 30.0), (100.0, 19.96)])
def test_a_free_step_is_the_matrix_exponential(stiffness_1_s2: float, damping_1_s: float) -> None:
    step_s = 0.01
    rates = np.zeros((4, 4))
    rates[0, 1] = rates[2, 3] = 1.0
    rates[1, :2] = -stiffness_1_s2, -damping_1_s
    np.testing.assert_allclose(
        _free_step(step_s, stiffness_1_s2, damping_1_s), expm(rates * step_s), rtol=1e-6, atol=1e-12
    )


def test_the_first_push_is_that_of_the_first_depth_and_felt_by_half_its_impulse() -> None:
    """Nothing has moved yet: only the damper feels the push, on its way to the rate that it gives."""
    ground = Ground(np.array((4e4,)), np.array((40.0,)), np.array((1e4,)), True)
    felt = Contact(
        np.array(((1e-3,), (5e-3,))), STEP_S, ground, LEG_SHARE, STIFFNESS_1_S2, DAMPING_1_S
    ).felt_by_body()
    assert felt[0, 0] == pytest.approx(LEG_SHARE * DAMPING_1_S * 0.5 * STEP_S * 4e4 * 1e-3, rel=1e-12)


def integrated(
    ground: Ground, depth_m: np.ndarray, column: int, step_s: float = STEP_S, damping: float = DAMPING_1_S
) -> np.ndarray:
    """The same contact by a fine explicit integration of its equations, one ground alone."""
    stiff, soft, bears = ground.stiff_1_s2[column], ground.soft_1_s2[column], ground.yield_m_s2[column]
    fine = 20
    h = step_s / fine
    path = np.interp(np.arange((depth_m.size - 1) * fine + 1) / fine, np.arange(depth_m.size), depth_m)
    delta = rate = com = com_rate = 0.0
    deepest, felt = max(path[0], 0.0), []
    for index, free in enumerate(path):
        depth = free - ((1.0 - LEG_SHARE) * delta + com)
        deepest = max(deepest, depth)
        if ground.leaving:
            push = soft * depth + (stiff - soft) * deepest
        else:
            push = stiff * depth - max((stiff - soft) * (deepest - bears / stiff), 0.0)
        push = max(push, 0.0)
        acceleration = push - STIFFNESS_1_S2 * delta - damping * rate
        if index % fine == 0:
            felt.append(LEG_SHARE * (STIFFNESS_1_S2 * delta + damping * rate))
        rate += h * acceleration
        delta += h * rate
        com_rate += h * LEG_SHARE * push
        com += h * com_rate
    return np.array(felt)


def fall(steps: int) -> np.ndarray:
    """The foot's free path into the ground and out again, (steps, 2)."""
    tau = np.arange(steps) * STEP_S
    path = 0.8 * tau - 60.0 * tau**2
    return np.column_stack((path, path))


@pytest.mark.parametrize("leaving", [False, True])
def test_the_ground_s_push_is_felt_as_the_equations_say(leaving: bool) -> None:
    """Two grounds side by side, one that gives way and one that does not."""
    ground = Ground(np.array((4e4, 9e4)), np.array((40.0, 60.0)), np.array((1e4, 9e4)), leaving)
    depth = fall(800)
    felt = Contact(depth, STEP_S, ground, LEG_SHARE, STIFFNESS_1_S2, DAMPING_1_S).felt_by_body()
    assert felt.shape == depth.shape
    for column in range(2):
        expected = integrated(ground, depth[:, column], column)
        assert np.abs(expected).max() > 5.0
        np.testing.assert_allclose(felt[:, column], expected, atol=0.02 * np.abs(expected).max())


def test_a_foot_that_starts_in_the_ground_is_pushed_from_the_first_step() -> None:
    ground = Ground(np.array((4e4,)), np.array((40.0,)), np.array((1e4,)), False)
    depth = np.full((400, 1), 1e-3)
    felt = Contact(depth, STEP_S, ground, LEG_SHARE, STIFFNESS_1_S2, DAMPING_1_S).felt_by_body()
    expected = integrated(ground, depth[:, 0], 0)
    np.testing.assert_allclose(felt[:, 0], expected, atol=0.02 * np.abs(expected).max())


def test_a_foot_above_the_ground_feels_nothing() -> None:
    ground = Ground(np.array((4e4,)), np.array((40.0,)), np.array((1e4,)), False)
    felt = Contact(
        np.full((50, 1), -1e-3), STEP_S, ground, LEG_SHARE, STIFFNESS_1_S2, DAMPING_1_S
    ).felt_by_body()
    np.testing.assert_array_equal(felt, 0.0)


def test_backwards_in_time_damping_feeds() -> None:
    ground = Ground(np.array((4e4,)), np.array((40.0,)), np.array((1e4,)), True)
    depth = fall(800)[:, :1]
    felt = Contact(depth, STEP_S, ground, LEG_SHARE, STIFFNESS_1_S2, -DAMPING_1_S).felt_by_body()
    expected = integrated(ground, depth[:, 0], 0, damping=-DAMPING_1_S)
    np.testing.assert_allclose(felt[:, 0], expected, atol=0.02 * np.abs(expected).max())


def test_the_line_of_a_ground_is_its_two_slopes() -> None:
    """Force over depth on first loading (depth = deepest) and on the way back, in numbers."""

    def force(ground: Ground, depth: float, deepest: float) -> float:
        (slope,), (taken,), (above,), (least,) = ground.line()
        return float(max(slope * (depth + above) - taken * max(deepest + above, least), 0.0))

    crater = Ground(np.array((4.0,)), np.array((2.0,)), np.array((1.0,)), False)
    assert force(crater, 0.25, 0.25) == 1.0  # below the yield along the stiff slope
    assert force(crater, 1.0, 1.0) == 2.0 + 1.0 * (1.0 - 0.5)  # beyond it along the soft one
    assert force(crater, 0.75, 1.0) == 2.5 - 4.0 * 0.25  # back along the stiff one
    leaving = Ground(np.array((4.0,)), np.array((2.0,)), np.array((1.0,)), True)
    assert force(leaving, 1.0, 1.0) == 4.0
    assert force(leaving, 0.5, 1.0) == 4.0 - 1.0 * 0.5
