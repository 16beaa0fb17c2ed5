"""What the accelerometer must read around an end of a flight: derivatives, and fits of the model's own samples."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from flight.edge_fit import fit_edges
from flight.edge_model import GROUND, TAKE_OFF, TOUCHDOWN, E, EdgeData, model
from flight.heartbeat import Heartbeat
from flight.ringing import Ringing, TwoMass

ROBOT = TwoMass(0.284, 3.71)
EDGE_S, NOISE_M_S2 = 0.1, 0.03
ENDS = [(way, hard) for way in (TAKE_OFF, TOUCHDOWN) for hard in (False, True)]


def truth(hard: bool) -> np.ndarray:
    """Parameters (11,) of a ground and of the ringing beside it."""
    p = np.zeros(len(E))
    p[E.TIME], p[E.STIFF] = EDGE_S, 15.5 if hard else 13.2
    p[E.YIELD], p[E.SOFT] = math.log(60.0), 12.0
    p[E.OMEGA], p[E.DECAY], p[E.COSINE], p[E.SINE], p[E.OFFSET] = 140.0, 6.0, -20.0, 35.0, 0.02
    return p


def end_of_flight(way: float, hard: bool, rubs: bool = False) -> EdgeData:
    """60 ms of flight and 4 ms of contact, without any ground's sign in the samples."""
    times = EDGE_S - way * np.arange(-0.004, 0.06, 6.1e-4)
    p, std = truth(hard), np.full(len(E), 1e3)
    std[E.FRICTION] = 1.0 if rubs else 1e-9
    spring = Ringing(EDGE_S, p[E.OMEGA], p[E.DECAY], p[E.COSINE], p[E.SINE])
    # The foot leaves at 0.4 m/s, or comes down as fast.
    foot = (1.0 - ROBOT.leg_share) * spring.compression(EDGE_S, ROBOT)[1]
    return EdgeData(
        np.sort(times),
        np.zeros(times.size),
        NOISE_M_S2,
        way,
        hard,
        ROBOT,
        -way * 0.4 - foot,
        EDGE_S,
        spring,
        p,
        std,
    )


@pytest.mark.parametrize(("way", "hard"), ENDS)
@pytest.mark.parametrize("rubs", [False, True])
def test_the_jacobian_is_that_of_the_residuals(way: float, hard: bool, rubs: bool) -> None:
    """By differences on both sides; with two points side by side, neither disturbs the other.

    Of the ringing, in flight: the foot's path into the ground is taken to be known there.
    """
    data = end_of_flight(way, hard, rubs)
    at = truth(hard)
    at[E.FRICTION] = 0.05 if rubs else 0.0
    left, jacobian = model(data, np.array((at + 1e-3, at)))
    alone = model(data, at[None])
    np.testing.assert_allclose(left[1], alone[0][0], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(jacobian[1], alone[1][0], rtol=1e-6, atol=1e-6)
    for name in E:
        step = 1e-6 if name is E.TIME else 1e-4
        # A sample between two steps of the edge's time has its own edge: those are left out.
        into_s = way * (data.times_s - EDGE_S)
        told = np.abs(into_s) > 2.0 * step if name in GROUND else into_s < -2.0 * step
        moved = [at.copy(), at.copy()]
        moved[0][name] -= step
        moved[1][name] += step
        low, high = model(data, np.array(moved))[0]
        expected = (low - high) / (2.0 * step)
        size = max(float(np.abs(expected).max()), 1e-6)
        if name is E.FRICTION and not rubs:
            assert not jacobian[1, name].any()
        else:
            off = np.abs(jacobian[1, name][told] - expected[told])
            assert np.mean(off < 0.02 * size) > 0.98  # where the foot bounces, one may lie on the kink


@pytest.mark.parametrize(("way", "hard"), ENDS)
def test_what_does_not_act_on_the_ground_moves_no_sample(way: float, hard: bool) -> None:
    data = end_of_flight(way, hard)
    (before,), _ = model(data, truth(hard)[None])
    for name in GROUND:
        at = truth(hard)
        at[name] += 0.3 if name is not E.TIME else 1e-3
        (after,), _ = model(data, at[None])
        assert np.any(before != after) == (name in data.acting)


@pytest.mark.parametrize(("way", "hard"), ENDS)
def test_in_flight_the_ground_does_nothing(way: float, hard: bool) -> None:
    data = end_of_flight(way, hard)
    (left,), (jacobian,) = model(data, truth(hard)[None])
    flying = way * (data.times_s - EDGE_S) < -1e-4
    assert flying.any()
    assert np.abs(jacobian[: len(GROUND)][:, ~flying]).max() > 1.0
    assert not jacobian[: len(GROUND)][:, flying].any()
    free = data.spring.acceleration_m_s2(data.times_s) + truth(hard)[E.OFFSET]
    np.testing.assert_allclose(left[flying], -free[flying] / NOISE_M_S2, rtol=1e-9)


@pytest.mark.parametrize(("way", "hard"), ENDS)
def test_an_edge_is_found_where_the_samples_have_it(way: float, hard: bool) -> None:
    """Samples by the model itself, with noise: the fit is off by what its sigma says, over several draws."""
    data, at = end_of_flight(way, hard), truth(hard)
    std = np.full(len(E), 0.3)
    std[[E.TIME, E.OMEGA, E.DECAY, E.SPEED, E.FRICTION]] = 4e-3, 2.0, 1.0, 0.01, 1e-9
    std[[E.COSINE, E.SINE]] = math.inf
    samples = -NOISE_M_S2 * model(data, at[None])[0][0]
    rng, off = np.random.default_rng(5), []
    for _ in range(12):
        seen = replace(data, motion_m_s2=samples + NOISE_M_S2 * rng.normal(size=samples.size), prior_std=std)
        starts = np.repeat(at[None], 3, axis=0)
        starts[:, E.TIME] += (-3e-4, 1e-4, 4e-4)
        best = min(fit_edges(seen, starts, Heartbeat()), key=lambda edge: edge.cost)
        off.append((best.time_s - EDGE_S) / math.sqrt(best.covariance[E.TIME, E.TIME]))
    assert 0.4 < float(np.sqrt(np.mean(np.square(off)))) < 1.6
