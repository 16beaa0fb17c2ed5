"""Hops off steel, where a foot leaves in a chatter: an end at which nobody felt a touch is not taken for one."""

from __future__ import annotations

import pytest

from benchmarks.hop_cases import simulate
from benchmarks.hop_results import record_of
from flight.flight_time import estimate_flight

UNFELT = (
    77,
    4009,
)  # it leaves at 21.1 ms; its path touches the ground's height again at 23.6 ms without a push
OTHERS = ((77, 4028), (77, 4031))


@pytest.mark.parametrize(("seed", "index"), [UNFELT, *OTHERS])
def test_a_foot_that_only_comes_near_has_left_before(seed: int, index: int) -> None:
    hop = simulate(seed, index, nominal=False)
    assert hop.case.surface == "steel"
    flight = estimate_flight(record_of(hop), hop.settings)
    assert flight.verdict == "valid", flight.reasons
    assert abs(flight.take_off_s - hop.truth.take_off_s) < min(0.5e-3, 4.0 * flight.take_off_sigma_s)
