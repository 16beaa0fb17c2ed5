"""The belief about ground: exact where it can be, calibrated, order-free, and found out when the ground changes."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from flight import settings as flight_settings
from flight.surface.belief import UNDECIDED, belief_of, probabilities
from flight.surface.compaction import LAWS, Law, shares
from flight.surface.forecast import LossForecast, forecast_loss, normal_below
from flight.surface.known import UNKNOWN, KnownSurface, load_surfaces
from flight.surface.mixture import COMMON, Evidence, Mixture
from flight.surface.priors import AS_BEFORE, c3_of, loss_of
from flight.surface.tracker import GroundModels, HopSeen, Tracker

SETTINGS = flight_settings.load()
SURFACES = load_surfaces()
GROUND = GroundModels.of(SURFACES, SETTINGS.surface, "1", 0.0)
LN_K = {"syar": 1.146e5, "quartz_sand": 9.042e4, "expanded_clay": 7.558e4, "quartz_aggregate": 2.435e5}
QUICK = settings(max_examples=6, deadline=None, suppress_health_check=[HealthCheck.too_slow])


HOPS = st.lists(
    st.tuples(st.floats(0.0, 0.8), st.floats(9.5, 14.0), st.floats(-1.5, 0.3), st.floats(0.0, 4.0)),
    min_size=2,
    max_size=5,
)


def seen(c3: float, log_stiffness: float | None = None, energy_j: float = 18.0) -> HopSeen:
    return HopSeen(energy_j, loss_of(c3), 0.005, log_stiffness, 0.04)


def after(*hops: HopSeen, common: float = 0.006) -> Tracker:
    tracker = Tracker.begin(GROUND, (0.0, common))
    for hop in hops:
        tracker = tracker.after(hop)
    return tracker


@pytest.mark.parametrize(
    ("name", "c3"), [("quartz_aggregate", 0.11), ("quartz_sand", 0.36), ("expanded_clay", 0.46)]
)
def test_the_surface_is_found_whose_c3_and_stiffness_are_seen(name: str, c3: float) -> None:
    belief = belief_of(after(seen(c3, math.log(LN_K[name]))), 18.0)
    assert belief.said == belief.most_probable == name
    assert sum(belief.probabilities.values()) == pytest.approx(1.0)


def test_where_ranges_overlap_one_hop_leaves_it_open() -> None:
    """C3 alone between sand and clay, with C2_ref from a table: nobody could tell."""
    belief = belief_of(after(seen(0.42), common=0.05), 18.0)
    assert belief.said == UNDECIDED
    assert belief.probabilities["quartz_sand"] > 0.15
    assert belief.probabilities["expanded_clay"] > 0.15


def test_ground_like_none_of_the_known_is_said_to_be_that() -> None:
    assert belief_of(after(seen(0.8)), 18.0).said == UNKNOWN
    odd = after(*[seen(0.36, math.log(6e5))] * 2)  # the loss of sand, far too firm for it
    assert belief_of(odd, 18.0).said == UNKNOWN


def test_falling_loss_tells_the_compacting_soil() -> None:
    steady = probabilities(after(*[seen(0.25)] * 4))
    falling = probabilities(after(*[seen(c3) for c3 in (0.27, 0.19, 0.13, 0.09)]))
    assert falling["syar"] > 0.8 > steady["syar"]


def test_the_forecast_follows_the_fall_and_narrows() -> None:
    tracker = Tracker.begin(GROUND, (0.0, 0.006))
    widths = []
    for c3, following in ((0.27, 0.2), (0.2, 0.15), (0.15, 0.115), (0.115, 0.09)):
        tracker = tracker.after(seen(c3, math.log(LN_K["syar"])))
        low, high = forecast_loss(tracker, 18.0).quantiles((0.025, 0.975))
        assert c3_of(low) < following < c3_of(high)
        widths.append(high - low)
    assert widths[-1] < widths[0]


@QUICK
@given(HOPS, st.randoms())
def test_the_order_of_independent_hops_does_not_matter(
    rows: list[tuple[float, float, float, float]], chance: random.Random
) -> None:
    evidence = [Evidence(loss_of(c3), 0.01, log_e, dose, q, 0.1) for c3, q, log_e, dose in rows]
    shuffled = evidence.copy()
    chance.shuffle(shuffled)
    found = []
    for order in (evidence, shuffled):
        mixture, total = GROUND.fresh(GROUND.prior, (0.0, 0.05), AS_BEFORE), 0.0
        for each in order:
            mixture, log_density = mixture.after(each)
            total += log_density
        found.append((mixture, total))
    (one, density), (other, again) = found
    assert density == pytest.approx(again, rel=1e-9, abs=1e-7)
    np.testing.assert_allclose(one.weights, other.weights, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(one.means, other.means, rtol=1e-6, atol=1e-8)


@QUICK
@given(st.integers(0, 2**32 - 1))
def test_more_evidence_never_lowers_the_posterior_of_the_truth_on_average(seed: int) -> None:
    """Hops drawn from the belief's own model: the mean posterior of the surface drawn rises with every hop."""
    chance = np.random.default_rng(seed)
    mean = np.zeros(4)
    missions = 40
    for _ in range(missions):
        truth, hops = drawn(chance, 3)
        tracker = Tracker.begin(GROUND, (0.0, 0.02))
        mean[0] += tracker.probabilities_array()[truth]
        for number, hop in enumerate(hops, start=1):
            tracker = tracker.after(hop, 1e-6)
            mean[number] += tracker.probabilities_array()[truth]
    mean /= missions
    # by Jensen's inequality each step rises in expectation; the margin is four standard errors of 40 missions
    assert np.all(np.diff(mean) > -0.12)
    assert mean[3] > mean[0] + 0.25


def drawn(chance: np.random.Generator, count: int) -> tuple[int, list[HopSeen]]:
    """A hypothesis of the prior, a state of it, and what hops at 18 J would show."""
    prior = GROUND.fresh(GROUND.prior, (0.0, 0.02), AS_BEFORE)
    pick = int(chance.choice(prior.weights.size, p=prior.weights))
    state = chance.multivariate_normal(prior.means[pick], prior.covariances[pick])
    hops = []
    for number in range(count):
        share = shares(float(number))[prior.laws[pick]]
        loss = state[0] - state[1] * share + state[COMMON]
        loss += math.hypot(0.005, prior.loss_scatter[pick]) * chance.standard_normal()
        stiffness = state[3] + math.hypot(0.04, prior.stiffness_scatter[pick]) * chance.standard_normal()
        hops.append(HopSeen(18.0, loss, 0.005, stiffness, 0.04))
    return int(prior.surfaces[pick]), hops


def test_forecast_intervals_cover_what_they_say() -> None:
    """Of 300 spots drawn from the prior the fourth hop falls into its 50 and 95 % intervals as often as it should."""
    chance = np.random.default_rng(3)
    inside = np.zeros(2)
    for _ in range(300):
        _, hops = drawn(chance, 4)
        tracker = Tracker.begin(GROUND, (0.0, 0.02))
        for hop in hops[:3]:
            tracker = tracker.after(hop, 1e-6)
        q = forecast_loss(tracker, 18.0).quantiles((0.25, 0.75, 0.025, 0.975))
        inside += [q[0] < hops[3].loss - 0.0 < q[1], q[2] < hops[3].loss < q[3]]
    inside /= 300.0
    assert 0.42 < inside[0] < 0.60  # the measurement's own error widens what is seen by little
    assert 0.915 < inside[1] < 0.985


@pytest.mark.parametrize(
    ("before", "then"),
    [((0.36, 9.042e4), (0.11, 2.435e5)), ((0.11, 2.435e5), (0.46, 7.558e4)), ((0.2, 1.1e5), (0.85, 2e4))],
)
def test_a_new_place_is_noticed_within_two_hops_and_none_is_imagined(
    before: tuple[float, float], then: tuple[float, float]
) -> None:
    tracker = after(*[seen(before[0], math.log(before[1]))] * 3)
    assert tracker.changed_within(2) < 0.1
    for _ in range(2):
        tracker = tracker.after(seen(then[0], math.log(then[1])))
    assert tracker.changed_within(2) > 0.9
    assert tracker.kind_of_change() == "new place"


def test_loosened_soil_is_noticed() -> None:
    """The loss of compacted soil jumps back to that of its first hop."""
    stiffness = math.log(LN_K["syar"])
    tracker = after(*[seen(c3, stiffness) for c3 in (0.28, 0.2, 0.15, 0.11)])
    tracker = tracker.after(seen(0.27, stiffness)).after(seen(0.2, stiffness))
    assert tracker.changed_within(2) > 0.9
    assert probabilities(tracker)["syar"] > 0.8


def test_the_common_error_stays_common() -> None:
    """However many hops, an error of C2_ref that they share is not averaged away."""
    many = after(*[seen(0.36)] * 12, common=0.05)
    mixture = many.runs[0].mixture
    own = forecast_loss(many, 18.0, with_common=False).std
    measured = forecast_loss(many, 18.0).std
    assert mixture.moments(COMMON)[1] > 0.03
    assert own > 1.5 * measured


def test_laws_of_compaction_begin_at_none_and_meet_at_the_fourth_hop() -> None:
    np.testing.assert_allclose(shares(0.0), 0.0, atol=1e-12)
    np.testing.assert_allclose(shares(3.0), 1.0)
    doses = np.linspace(0.0, 8.0, 30)
    for law in LAWS:
        assert np.all(np.diff([law.share(float(dose)) for dose in doses]) > 0.0)
    assert Law("exponential", 2.0).share(1.0) == pytest.approx((1 - math.exp(-0.5)) / (1 - math.exp(-1.5)))


def test_an_update_is_that_of_the_textbook() -> None:
    """One hypothesis against the closed form of a Gaussian seen with Gaussian noise."""
    prior = GROUND.fresh(GROUND.prior, (0.0, 1e-9), AS_BEFORE).chosen(np.array([12]))
    prior = replace(prior, log_weights=np.zeros(1))
    mean, variance = prior.loss_ahead(0.0, 0.0)
    updated, log_density = prior.after(Evidence(0.5, 0.02, 0.0, 0.0))
    total = float(variance[0]) + 0.02**2
    error = 0.5 - float(mean[0])
    assert log_density == pytest.approx(-0.5 * (error**2 / total + math.log(2 * math.pi * total)), rel=1e-9)
    spread = float(variance[0]) - float(prior.loss_scatter[0]) ** 2
    again, _ = updated.loss_ahead(0.0, 0.0)
    assert float(again[0]) == pytest.approx(float(mean[0]) + spread / total * error, rel=1e-9)


def test_what_is_no_measurement_is_refused() -> None:
    for bad in (math.nan, math.inf):
        with pytest.raises(ValueError, match="no measurement"):
            Evidence(bad, 0.01, 0.0, 0.0)
    with pytest.raises(ValueError, match="no measurement"):
        Evidence(0.3, 0.0, 0.0, 0.0)


def test_quantiles_of_a_mixture_are_where_its_distribution_says() -> None:
    forecast = LossForecast(np.array([0.3, 0.7]), np.array([0.1, 0.5]), np.array([0.01, 0.0025]))
    wanted = (0.025, 0.3, 0.5, 0.9)
    np.testing.assert_allclose(forecast.below(forecast.quantiles(wanted)), wanted, atol=1e-6)
    np.testing.assert_allclose(
        normal_below(np.array([0.0, 1.959964, -1.0])), [0.5, 0.975, 0.15865525], atol=2e-7
    )


def test_a_range_of_few_values_means_a_wider_spread() -> None:
    few = KnownSurface("x", "1", 0.0, 0.3, 0.2, 0.4, runs=3)
    many = KnownSurface("x", "1", 0.0, 0.3, 0.2, 0.4, runs=10)
    assert few.place_c3_std == pytest.approx(0.2 / 1.693)
    assert many.place_c3_std == pytest.approx(0.2 / 3.078)


def test_a_foot_without_a_table_is_carried_over_and_less_sure() -> None:
    """Syar has only been met with foot 1: with the widest foot it should lose less, and nobody is sure how much."""
    other = GroundModels.of(SURFACES, SETTINGS.surface, "4", 0.0)
    one, carried = (next(m for m in g.models if m.name == "syar") for g in (GROUND, other))
    assert carried.loss < 0.6 * one.loss
    assert carried.loss_std / carried.loss > one.loss_std / one.loss


def test_mixtures_keep_their_hypotheses_apart() -> None:
    mixture = GROUND.fresh(GROUND.prior, (0.0, 0.01), AS_BEFORE)
    assert isinstance(mixture, Mixture)
    assert mixture.weights.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(mixture.by(mixture.surfaces, len(GROUND.names)), GROUND.prior, atol=1e-12)
    assert np.all(np.linalg.eigvalsh(mixture.covariances) > -1e-12)
