"""Sampled sensors: grid, noise, step, range, FIFO, faults."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hal.errors import CommandRefused, ReadFailed
from sim_hal.faults import Fault
from sim_hal.sensors import SampledSensor, instants
from sim_hal.settings import Mode, SensorSettings


def sensor(
    *, std: float = 0.0, step: float = 0.0, rate_hz: float = 200.0, high: float = 10.0, depth: int = 10**6
) -> SampledSensor:
    modes = (Mode(rate_hz, std, -high, high), Mode(1666.0, std, -high, high))
    return SampledSensor("probe", SensorSettings(step, depth, modes), np.random.SeedSequence(3))


def run(
    probe: SampledSensor,
    ends_s: list[float],
    truth: float = 0.0,
    fault: Fault | None = None,
    after_s: float = -1.0,
) -> list[float]:
    """Let time pass in the given pieces with a constant truth; return all values delivered."""
    for start_s, end_s in itertools.pairwise([after_s, *ends_s]):
        due = instants(probe.mode.rate_hz, start_s, end_s)
        probe.record(due, [truth] * len(due), fault)
    return list(probe.drain().values)


def test_noise_has_the_stated_sigma_and_no_memory() -> None:
    values = np.array(run(sensor(std=0.5, step=0.001), [100.0]))
    count = len(values)
    assert count == 20_001
    # bounds of five standard errors, for a mean, a standard deviation and a correlation of white noise
    assert abs(values.mean()) < 5 * 0.5 / np.sqrt(count)
    assert values.std() == pytest.approx(0.5, rel=5 / np.sqrt(2 * count))
    assert abs(np.corrcoef(values[1:], values[:-1])[0, 1]) < 5 / np.sqrt(count)


def test_rounding_follows_the_noise_and_the_range_comes_last() -> None:
    values = np.array(run(sensor(std=0.05, step=0.25, high=0.6), [50.0], truth=0.55))
    inside = values[values < 0.6]
    assert np.allclose(inside / 0.25, np.round(inside / 0.25), atol=1e-12)
    assert values.max() == 0.6  # 0.75 limited: the limit itself need not lie on a step
    assert {0.5, 0.6} <= set(values)


def test_saturation_is_flagged_at_the_end_of_the_range() -> None:
    probe = sensor(high=1.0)
    probe.record([0.0, 0.1, 0.2], [0.5, 3.0, -3.0])
    assert probe.drain().saturated == (False, True, True)


@given(st.lists(st.floats(0.0, 0.2), min_size=1, max_size=20))
def test_cutting_the_wait_into_pieces_changes_nothing(pieces_s: list[float]) -> None:
    ends_s = [float(end) for end in np.cumsum(pieces_s)]
    assert run(sensor(std=1.0), ends_s) == run(sensor(std=1.0), [ends_s[-1]])


@pytest.mark.parametrize("rate_hz", [200.0, 208.0, 1666.0])
def test_instants_lie_on_the_grid_and_none_is_lost(rate_hz: float) -> None:
    tick_s, before_s, now_s, found = 0.005, -1.0, 0.0, list[float]()
    while now_s < 3.0:
        found += instants(rate_hz, before_s, now_s)
        before_s, now_s = now_s, now_s + tick_s  # as a careless caller would sum it
    assert np.allclose(found, np.arange(len(found)) / rate_hz, rtol=0, atol=2e-9)
    assert len(found) == int(before_s * rate_hz + 1e-6) + 1


@given(st.floats(0.0, 100.0))
def test_instants_lie_on_the_grid_since_power_up_whenever_they_begin(now_s: float) -> None:
    """Sensors of one rate sample together, and none samples in the past."""
    found = np.array(instants(1666.0, now_s, now_s + 0.01))
    counts = found * 1666.0
    assert counts == pytest.approx(np.round(counts), abs=1e-5)
    assert now_s < found[0] <= now_s + 1 / 1666 + 2e-9
    assert len(found) in (16, 17)


def test_unknown_rate_is_refused_and_changes_nothing() -> None:
    probe = sensor()
    with pytest.raises(CommandRefused, match=r"1000\.0 Hz .* 200, 1666"):
        probe.set_rate_hz(1000.0)
    assert probe.mode.rate_hz == 200.0


def test_a_full_fifo_loses_the_oldest_and_says_so() -> None:
    probe = sensor(depth=4)
    due = instants(200.0, -1.0, 0.03)
    probe.record(due, list(range(len(due))))
    batch = probe.drain()
    assert batch.values == (3.0, 4.0, 5.0, 6.0)
    assert batch.overrun
    probe.record([0.035], [7.0])
    assert not probe.drain().overrun


def test_a_full_fifo_keeps_the_newest_of_many_small_pieces() -> None:
    probe = sensor(depth=4)
    for index in range(9):
        probe.record([float(index)], [float(index)])
    probe.record([9.0, 10.0, 11.0], [9.0, 10.0, -11.0])
    batch = probe.drain()
    assert batch.times_s == (8.0, 9.0, 10.0, 11.0)
    assert batch.values == (8.0, 9.0, 10.0, -10.0)
    assert batch.saturated == (False, False, True, True)
    assert batch.overrun
    assert probe.drain() == ((), (), (), False)


@given(
    st.lists(st.tuples(st.sampled_from([0.0, -0.004, 1.3, 9.999, -12.0]), st.integers(1, 40)), max_size=30),
    st.sampled_from([0.0, 0.01]),
)
def test_a_truth_that_holds_reads_to_the_bit_as_one_told_for_each_sample(
    pieces: list[tuple[float, int]], step: float
) -> None:
    whole, each = sensor(std=0.01, step=step), sensor(std=0.01, step=step)
    for truth, count in pieces:
        times_s = [0.1 * index for index in range(count)]
        whole.record(times_s, truth)
        each.record(times_s, [truth] * count)
    assert repr(whole.drain()) == repr(each.drain())  # tells -0.0 from 0.0


def test_stuck_sensor_repeats_its_last_value_with_new_times() -> None:
    probe = sensor()
    probe.record([0.0], [1.0])
    probe.record([0.005, 0.010], [2.0, 3.0], Fault("spring", "stick", 0.0))
    batch = probe.drain()
    assert batch.times_s == (0.0, 0.005, 0.010)
    assert batch.values == (1.0, 1.0, 1.0)


def test_silent_sensor_keeps_its_old_time() -> None:
    probe = sensor()
    probe.record([0.0], [1.0])
    probe.record([0.005], [2.0], Fault("spring", "silent", 0.0))
    assert probe.latest().time_s == 0.0


def test_a_passing_fault_leaves_later_noise_as_it_was() -> None:
    healthy, broken = sensor(std=1.0), sensor(std=1.0)
    expected = run(healthy, [0.1, 0.2])
    run(broken, [0.1], fault=Fault("spring", "fail", 0.0))
    assert run(broken, [0.2], after_s=0.1) == expected[21:]


def test_a_polled_sensor_gives_its_newest_sample_and_lets_none_wait() -> None:
    probe = sensor()
    probe.record([0.0, 0.005], [1.0, 2.0])
    assert probe.poll()[:2] == (0.005, 2.0)
    assert probe.poll()[:2] == (0.005, 2.0)  # however old
    assert probe.drain() == ((), (), (), False)
    probe.record([0.010], [3.0])
    assert probe.drain().values == (3.0,)


def test_no_sample_yet_is_an_error() -> None:
    with pytest.raises(ReadFailed, match="probe: no sample yet"):
        sensor().latest()
