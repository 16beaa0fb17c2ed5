"""A foot that leaves and touches once more: told by its path and by the kick that the spring rings with."""

from __future__ import annotations

import numpy as np
import pytest
from hop_records import record_of
from two_mass import STEEL, Ground, TwoMassHop

from flight import settings as flight_settings
from flight.flight_time import estimate_flight
from flight.flown import FlightTime
from flight.graze import Graze, undecided

SETTINGS = flight_settings.load()
OPENING_S = 0.0069
KEPT = 0.70
BETWEEN_N_M = (
    190.25e3  # below it the foot of a hop of 30 mm keeps clear of the ground; above it touches once more
)


def told(hop: TwoMassHop, seed: int) -> FlightTime:
    return estimate_flight(record_of(hop, np.random.Generator(np.random.PCG64(seed))), SETTINGS)


def seen(hop: TwoMassHop, seed: int) -> FlightTime:
    flight = told(hop, seed)
    assert flight.verdict != "rejected", flight.reasons
    return flight


def take_off_s(hop: TwoMassHop) -> float:
    assert hop.take_off_s is not None
    return hop.take_off_s


@pytest.mark.parametrize("apart_n_m", [-60e3, -4e3, 3e3, 8e3, 30e3, 140e3])
def test_a_second_touch_of_soil_is_found_and_none_is_made_up(apart_n_m: float) -> None:
    hop = TwoMassHop(0.03, Ground(BETWEEN_N_M + apart_n_m, KEPT), duration_s=0.75)
    assert (take_off_s(hop) > 0.017) == (apart_n_m > 0.0)  # a second touch ends some 13 ms after the first
    for seed in (3, 4):
        flight = seen(hop, seed)
        error_s = flight.take_off_s - OPENING_S - take_off_s(hop)
        assert abs(error_s) < 1e-3
        assert abs(error_s) < 4.0 * flight.take_off_sigma_s


def test_a_touch_that_nobody_can_feel_is_never_a_wrong_number() -> None:
    """It changes nothing but the moment: that is told as it was, or rejected as one of two."""
    rejected = 0
    for apart_n_m in (-1e3, -0.5e3, 0.5e3, 1e3):
        hop = TwoMassHop(0.03, Ground(BETWEEN_N_M + apart_n_m, KEPT), duration_s=0.75)
        for seed in (3, 4, 5):
            flight = told(hop, seed)
            assert flight.leaving_sigma_s < 1e-3  # which heights are counted from
            if flight.verdict == "rejected":
                rejected += 1
                assert "the foot may have touched again, 1" in flight.reasons[0]
            else:
                error_s = flight.take_off_s - OPENING_S - take_off_s(hop)
                assert abs(error_s) < min(1e-3, 4.0 * flight.take_off_sigma_s)
    assert 0 < rejected < 12


@pytest.mark.parametrize(
    ("after_s", "odds", "rejected"),
    [
        (0.013, 0.5, True),
        (0.013, 0.03, True),
        (0.013, 0.02, False),
        (0.013, 0.98, False),
        (0.003, 0.5, False),
    ],
)
def test_two_moments_are_rejected_only_where_an_interval_would_have_to_reach_too_far(
    after_s: float, odds: float, rejected: bool
) -> None:
    assert bool(undecided(Graze(after_s, odds), 0.0098)) == rejected
    assert undecided(None, 0.0098) == ""


def test_on_steel_the_last_of_many_touches_is_found() -> None:
    draws = np.random.Generator(np.random.PCG64(11))
    errors_s, sigmas_s = [], []
    for compression_m in draws.uniform(0.022, 0.038, 16):
        hop = TwoMassHop(float(compression_m), STEEL, duration_s=0.75)
        flight = seen(hop, int(draws.integers(2**31)))
        errors_s.append(flight.take_off_s - OPENING_S - take_off_s(hop))
        sigmas_s.append(flight.take_off_sigma_s)
    assert np.sqrt(np.mean(np.square(errors_s))) < 0.3e-3
    assert np.median(sigmas_s) < 0.3e-3
    assert np.max(np.abs(errors_s) / np.array(sigmas_s)) < 4.0
