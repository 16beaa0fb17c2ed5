"""The long run in short: missions in one process, a log that rotates within its limit, figures that add up."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.growth import growth_per_hour
from benchmarks.long_run import Operation, Seen, figures, operate

OPERATION = Operation(hours=0.007, hops_of_a_mission=1, log_bytes=400_000, sampled_every_s=0.5)


@pytest.fixture(scope="module")
def seen() -> Seen:
    return operate(OPERATION)


def test_missions_follow_each_other_until_the_time_is_over(seen: Seen) -> None:
    assert seen.missions >= 2
    assert sum(seen.ends.values()) == seen.missions
    assert seen.memory[-1][0] > 0.8 * 3600.0 * OPERATION.hours
    assert sorted(seen.memory) == seen.memory


def test_the_log_rotates_and_stays_within_its_limit(seen: Seen) -> None:
    assert 0.5 * OPERATION.log_bytes < seen.log_most <= OPERATION.log_bytes


def test_estimates_are_held_to_the_truth(seen: Seen) -> None:
    found = figures(seen, OPERATION)
    assert found["hops"][0] == seen.hops >= 2
    assert found["wrong"] == (0, "1")
    assert {name for _, name, _ in seen.errors} == {"height", "time_of_flight"}
    assert 0.0 < found["height_rms_sigmas"][0] < 3.0


@pytest.mark.parametrize("true_kb_per_h", [0.0, 4000.0])
def test_growth_is_found_with_its_uncertainty(true_kb_per_h: float) -> None:
    """Of memory that moves in steps at random, the share of true slopes within two standard errors."""
    times_s = np.arange(900.0, 3600.0, 10.0)
    inside = 0
    for seed in range(200):
        jumps = np.random.default_rng(seed).normal(0.0, 60.0, times_s.size)
        slope, sigma = growth_per_hour(times_s, true_kb_per_h * times_s / 3600.0 + np.cumsum(jumps))
        inside += abs(slope - true_kb_per_h) < 2.0 * sigma
    assert 150 < inside <= 200
