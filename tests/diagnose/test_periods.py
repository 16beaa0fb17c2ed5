"""The period of a ripple, read from the missing force: planted ones are found, whatever else the force holds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from ground.diagnose.candidates import starts_of
from ground.diagnose.evidence import LocatedForce
from ground.diagnose.periods import strongest_period, with_periods
from ground.diagnose.ripple import Ripple

TIMES = np.linspace(0.0, 4.0, 800)
TO_AND_FRO = 0.3 * np.sin(2.0 * np.pi * TIMES / 4.0) + 0.1 * np.sin(2.0 * np.pi * TIMES / 1.3)


def missing(force: np.ndarray, position: np.ndarray = TO_AND_FRO, samples: int = 800) -> LocatedForce:
    causes = {"position": position, "velocity": np.gradient(position, TIMES)}
    return LocatedForce(
        equation="balance",
        run="one",
        unit="N",
        times_s=TIMES[:samples],
        before=force[:samples],
        before_std=np.full(samples, 0.1),
        after=None,
        causes={name: series[:samples] for name, series in causes.items()},
        explained={},
        log_likelihood_gain=1.0,
    )


@settings(max_examples=40, deadline=None)
@given(
    cycles=st.floats(2.0, 60.0),
    phase=st.floats(0.0, 6.28),
    offset=st.floats(-2.0, 2.0),
    slope=st.floats(-3.0, 3.0),
    viscous=st.floats(-1.0, 1.0),
    seed=st.integers(0, 1000),
)
def test_a_planted_period_is_found(
    cycles: float, phase: float, offset: float, slope: float, viscous: float, seed: int
) -> None:
    noise = np.random.Generator(np.random.PCG64(seed)).normal(0.0, 0.1, TIMES.size)
    period = np.ptp(TO_AND_FRO) / cycles
    ripple = 0.3 * np.sin(2.0 * np.pi * TO_AND_FRO / period + phase)
    smooth = offset + slope * TO_AND_FRO + viscous * np.gradient(TO_AND_FRO, TIMES)
    found = strongest_period(missing(ripple + smooth + noise))
    assert found is not None
    assert (
        abs(np.ptp(TO_AND_FRO) / found - cycles) < 0.5
    )  # within the reach of a fit: half a cycle over the travel


def test_where_there_is_no_position_or_no_room_for_a_cycle_nothing_is_said() -> None:
    assert strongest_period(missing(np.sin(TIMES), np.zeros_like(TIMES))) is None
    assert strongest_period(missing(np.sin(TIMES), samples=5)) is None
    scales = {"balance": {"X": 0.6, "P": 0.03}, "other": {"X": 1.0, "P": 0.05}}
    assert with_periods(scales, [missing(np.sin(TIMES), np.zeros_like(TIMES))]) == scales


def test_the_scales_take_the_period_of_their_own_balance_only() -> None:
    scales = {"balance": {"X": 0.6, "P": 0.03}, "other": {"X": 1.0, "P": 0.05}}
    found = with_periods(scales, [missing(np.sin(2.0 * np.pi * TO_AND_FRO / 0.1))])
    assert abs(found["balance"]["P"] - 0.1) < 0.01
    assert found["other"] == scales["other"]


def test_a_ripple_counts_only_where_it_is_small_beside_the_usual_force() -> None:
    scales = {"balance": {"X": 0.6, "P": 0.03, "F": 10.0, "A_sin": 0.2, "A_cos": 0.2}}
    force = missing(np.sin(2.0 * np.pi * TO_AND_FRO / 0.1))
    small, large = (replace(force, ripple=Ripple(0.02, size, 0.0)) for size in (1.0, 3.0))
    found = with_periods(scales, [small])["balance"]
    assert (found["P"], found["A_sin"], found["A_cos"]) == (0.02, 1.0, 0.1)
    assert with_periods(scales, [large]) == with_periods(scales, [force])


def test_a_stretch_is_searched_evenly_and_where_the_catalogue_says() -> None:
    starts = starts_of(0.98, 0.2, 1.5)
    assert 0.98 in starts
    assert len(starts) == 6
    assert all(0.2 < start < 1.5 for start in starts)
