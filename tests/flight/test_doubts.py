"""What is told of a flight that counts: doubts in words, and a sigma that reaches every end that explains it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from typing import cast

import numpy as np
import pytest
from hop_records import record_of
from two_mass import STEEL, TwoMassHop

from flight import settings as flight_settings
from flight.doubts import doubts
from flight.edge_fit import Edge, mixed
from flight.edge_model import E
from flight.edge_search import _left_unfelt
from flight.flight_time import estimate_flight
from flight.flown import FlightFit
from flight.graze import Graze


@cache
def fit() -> FlightFit:
    hop = TwoMassHop(0.03, STEEL, duration_s=0.75)
    flight = estimate_flight(record_of(hop, np.random.Generator(np.random.PCG64(1))), flight_settings.load())
    assert flight.fit is not None
    assert flight.contact == "hard"
    return flight.fit


def told(
    of: FlightFit, hard: bool = True, chi: float = 1.0, sigma_s: float = 2e-4, again: Graze | None = None
) -> list[str]:
    return doubts(of, hard, chi, sigma_s, again, 2.0)


def test_nothing_is_told_of_a_flight_that_is_explained() -> None:
    assert told(fit()) == []


def test_each_doubt_has_its_words() -> None:
    assert told(fit(), chi=3.4) == ["the ringing is explained to 3.4 sigma only"]
    assert told(fit(), sigma_s=2.4e-3) == ["time of flight known to 2.4 ms only"]
    rubbing = fit().touchdown.parameters.copy()
    rubbing[E.FRICTION] = -0.3
    (words,) = told(replace(fit(), touchdown=replace(fit().touchdown, parameters=rubbing)))
    assert words == "dry friction of about 0.6 N in the spring's guide"


def test_bounces_that_no_fit_explains_are_told_where_the_foot_bounces() -> None:
    samples = fit().take_off.residuals.size
    badly = replace(fit(), take_off=replace(fit().take_off, cost=4.0 * samples))
    assert told(badly) == ["the foot's bounces are explained to 2.0 sigma only"]
    assert told(badly, hard=False) == []
    assert told(replace(fit(), take_off=replace(fit().take_off, cost=1.4 * samples))) == []


@pytest.mark.parametrize(
    ("odds", "after_s", "said"),
    [
        (0.02, 4e-3, True),
        (0.98, 4e-3, True),
        (0.005, 4e-3, False),  # less likely than what is told
        (0.02, 0.9e-3, False),  # within five sigma of 0.2 ms
    ],
)
def test_a_touch_beyond_all_sigmas_is_told_unless_it_is_unlikely(
    odds: float, after_s: float, said: bool
) -> None:
    found = told(fit(), again=Graze(after_s, odds))
    assert found == ([f"the foot may have touched again, 4 ms after it left (probability {odds:.2f})"] * said)


def moved(edge: Edge, by_s: float) -> Edge:
    parameters = edge.parameters.copy()
    parameters[E.TIME] += by_s
    return replace(edge, parameters=parameters)


def test_an_end_that_may_not_be_chosen_widens_sigma_all_the_same() -> None:
    best, other = fit().take_off, moved(fit().take_off, -4e-3)
    alone = best.covariance[E.TIME, E.TIME]
    assert mixed([best], [10.0], 3.0).covariance[E.TIME, E.TIME] == alone
    for cost, share in ((10.0, 0.5), (10.0 - 6.0 * math.log(3.0), 0.75), (1000.0, 0.0), (-1e6, 1.0)):
        both = mixed([best, other], [10.0, cost], 3.0, 1)
        assert both.time_s == best.time_s
        assert both.covariance[E.TIME, E.TIME] - alone == pytest.approx(share * 16e-6, abs=1e-12)
    assert mixed([best, other], [10.0, 9.0], 3.0).time_s == other.time_s


@dataclass
class Seen:
    """What of a fitted end counts here."""

    time_s: float
    cost: float
    foot_speed_sigmas: float


def test_an_unfelt_leaving_counts_where_it_is_earlier_and_explains_as_much() -> None:
    best = Seen(0.03, 50.0, 12.0)
    earlier = Seen(0.026, 55.0, 2.3)
    others = [
        best,
        earlier,
        Seen(0.034, 50.0, 2.3),  # later: of a touch after take-off others ask
        Seen(0.026, 60.0, 2.3),  # explains less
        Seen(0.026, 55.0, -4.0),  # goes down
        Seen(0.026, 55.0, 5.0),  # plainly moves: it could have been the best
    ]
    assert _left_unfelt(cast(list[Edge], others), cast(Edge, best)) == [earlier]
