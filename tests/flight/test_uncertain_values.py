"""Uncertain values against linear algebra: sums, products, means, and what is learnt from a measurement."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flight import settings as flight_settings
from flight.energy import RigConstants, analysis_energy, height_of_energy_m
from flight.uncertain import Uncertain, learnt, mean_of

NAMES = ("a", "b", "c")
numbers = st.floats(0.1, 10.0)
signed = st.floats(-3.0, 3.0)
uncertain = st.builds(
    Uncertain, numbers, st.dictionaries(st.sampled_from(NAMES), signed, min_size=1, max_size=3)
)


def vector(value: Uncertain) -> np.ndarray:
    """Contributions in the order of `NAMES`."""
    return np.array([value.parts.get(name, 0.0) for name in NAMES])


@given(uncertain, uncertain)
def test_contributions_follow_the_derivatives(x: Uncertain, y: Uncertain) -> None:
    u, v = vector(x), vector(y)
    for found, value, parts in (
        (x + y, x.value + y.value, u + v),
        (x - y, x.value - y.value, u - v),
        (x * y, x.value * y.value, y.value * u + x.value * v),
        (x / y, x.value / y.value, u / y.value - x.value / y.value**2 * v),
        (x**2.0, x.value**2, 2.0 * x.value * u),
        (-x, -x.value, -u),
        (2.0 + x, 2.0 + x.value, u),
        (2.0 - x, 2.0 - x.value, -u),
        (2.0 * x, 2.0 * x.value, 2.0 * u),
        (2.0 / x, 2.0 / x.value, -2.0 / x.value**2 * u),
    ):
        assert found.value == pytest.approx(value, rel=1e-12)
        np.testing.assert_allclose(vector(found), parts, rtol=1e-9, atol=1e-12)


@given(uncertain, uncertain)
def test_sigma_and_covariance_are_those_of_the_vectors(x: Uncertain, y: Uncertain) -> None:
    assert x.sigma == pytest.approx(float(np.linalg.norm(vector(x))))
    assert x.covariance(y) == pytest.approx(float(vector(x) @ vector(y)), abs=1e-12)
    assert x.sigma_of(["a", "nobody"]) == pytest.approx(abs(x.parts.get("a", 0.0)))


def test_values_without_a_common_source_do_not_vary_together() -> None:
    assert Uncertain.of(1.0, 2.0, "a").covariance(Uncertain.of(1.0, 3.0, "b")) == 0.0
    assert Uncertain.of(1.0, 2.0, "a").covariance(Uncertain.of(1.0, 3.0, "a")) == 6.0


def test_one_more_source_adds_in_quadrature_and_leaves_the_value() -> None:
    x = Uncertain.of(4.0, 3.0, "x")
    assert x.with_part("x", 4.0) == Uncertain(4.0, {"x": 5.0})
    assert x.with_part("y", 4.0) == Uncertain(4.0, {"x": 3.0, "y": 4.0})


def test_the_mean_of_one_is_itself_and_of_none_is_refused_in_words() -> None:
    assert mean_of([Uncertain(4.0, {"x": 0.5})]) == Uncertain(4.0, {"x": 0.5})
    assert mean_of([Uncertain(1.0), Uncertain(2.0)]).value == 1.5
    with pytest.raises(ValueError, match=r"^the mean of no values was asked for$"):
        mean_of([])


@given(st.lists(uncertain, min_size=1, max_size=3), st.integers(0, 2), st.floats(0.1, 2.0), signed)
def test_what_is_learnt_is_the_conditional_normal_distribution(
    values: list[Uncertain], which: int, sigma: float, off: float
) -> None:
    predicted = values[which % len(values)] * 2.0 + 1.0
    seen = Uncertain.of(predicted.value + off, sigma, "seen")
    found = learnt(values, predicted, seen)
    prior = np.array([vector(value) for value in values])
    gain = prior @ vector(predicted) / (vector(predicted) @ vector(predicted) + sigma**2)
    covariance = prior @ prior.T - np.outer(gain, prior @ vector(predicted))
    for index, (value, after) in enumerate(zip(values, found, strict=True)):
        assert after.value == pytest.approx(value.value + gain[index] * off, abs=1e-9)
        assert after.sigma**2 == pytest.approx(covariance[index, index], abs=1e-9)
        for other, also in enumerate(found):
            assert after.covariance(also) == pytest.approx(covariance[index, other], abs=1e-9)


def test_nothing_is_learnt_where_nothing_was_uncertain() -> None:
    values = (Uncertain(1.0), Uncertain(2.0, {"a": 0.1}))
    assert learnt(values, Uncertain(3.0), Uncertain(4.0)) == values


def test_a_measurement_without_error_settles_what_it_measured() -> None:
    (after,) = learnt([Uncertain(1.0, {"a": 0.5})], Uncertain(1.0, {"a": 0.5}), Uncertain(1.25))
    assert after.value == pytest.approx(1.25)
    assert after.sigma == pytest.approx(0.0, abs=1e-15)


def test_the_rigs_constants_carry_their_own_sources() -> None:
    rig = flight_settings.load().rig
    found = RigConstants.of(rig)
    for value, number, share, source in (
        (found.body_mass_kg, rig.body_mass_kg, rig.mass_std_share, "body_mass"),
        (found.leg_mass_kg, rig.leg_mass_kg, rig.mass_std_share, "leg_mass"),
        (found.stiffness_n_m, rig.spring_stiffness_n_m, rig.spring_stiffness_std_share, "spring_stiffness"),
        (found.gravity_m_s2, rig.gravity_m_s2, rig.gravity_std_share, "gravity"),
    ):
        assert value == Uncertain(number, {source: share * number})
    assert found.total_mass_kg.value == rig.body_mass_kg + rig.leg_mass_kg


def test_the_compression_that_just_does_not_lift_the_robot_is_refused_the_next_one_not() -> None:
    """k s = M g exactly, in numbers without rounding."""
    exact = RigConstants(*(Uncertain(value) for value in (3.0, 1.0, 1024.0, 8.0)))
    with pytest.raises(
        ValueError, match=r"^a compression of 0\.03125 m does not lift the robot off the ground$"
    ):
        analysis_energy(Uncertain(0.03125), exact)
    assert (
        analysis_energy(Uncertain(0.0625), exact).value == 3.0 * 8 / 16 + 0.75 * 2.0 + 0.5 * 3 * 4 * 64 / 1024
    )
    assert height_of_energy_m(Uncertain(64.0), exact).value == 2.0
