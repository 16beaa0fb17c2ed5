"""What every sensor of every backend keeps to: times, ranges, rates, failed reads, being closed."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import pytest

from hal.board import Board
from hal.errors import CommandRefused, DeviceClosed, ReadFailed

POLLED = {"nut_encoder": "position_m", "motor_current": "current_a"}
STREAMED = {
    "spring": "compression_m",
    "accelerometer": "specific_force_m_s2",
    "magnet_current": "current_a",
}
SENSORS = [*POLLED, *STREAMED, "switches"]


def read(board: Board, device: str) -> Any:
    return getattr(board, device).read()


def watch(board: Board, device: str, until_s: float = 0.5, period_s: float = 0.02) -> list[Any]:
    """Read a sensor again and again while the motor runs and time passes."""
    readings = []
    while board.clock.now_s() < until_s:
        board.watchdog.stroke()
        board.motor.set_voltage_v(6.0)
        board.clock.sleep_until_s(board.clock.now_s() + period_s)
        readings.append(read(board, device))
    return readings


def assert_finite(reading: Any) -> None:
    for value in reading:
        for number in value if isinstance(value, tuple) else (value,):
            assert number is None or math.isfinite(number)


@pytest.mark.parametrize("device", POLLED)
def test_polled_times_never_go_back_nor_ahead(board: Board, device: str) -> None:
    readings = watch(board, device)
    times = [reading.time_s for reading in readings]
    assert times == sorted(times)
    assert times[-1] <= board.clock.now_s()
    assert times[-1] > board.clock.now_s() - 0.02  # what is delivered is fresh
    for reading in readings:
        assert_finite(reading)


@pytest.mark.parametrize("device", STREAMED)
def test_a_stream_is_gapless_ordered_and_handed_out_once(backend: Any, device: str) -> None:
    board, rate_hz = backend.board, backend.rates_hz[device]
    getattr(board, device).set_rate_hz(rate_hz)
    readings = watch(board, device)
    times = [time for reading in readings for time in reading.times_s]
    assert len(times) == pytest.approx(0.5 * rate_hz, rel=0.02)
    gaps = [after - before for before, after in itertools.pairwise(times)]
    assert min(gaps) > 0.0
    # the first gap may span the switch from the rate of power-up
    assert max(gaps[1:]) == pytest.approx(1.0 / rate_hz, rel=0.02)
    assert times[-1] <= board.clock.now_s()
    assert not any(reading.overrun for reading in readings)
    for reading in readings:
        assert_finite(reading)
        assert len(getattr(reading, STREAMED[device])) == len(reading.times_s)


@pytest.mark.parametrize("device", STREAMED)
def test_a_second_read_at_once_is_empty(board: Board, device: str) -> None:
    board.clock.sleep_until_s(0.05)
    assert read(board, device).times_s
    assert read(board, device).times_s == ()


@pytest.mark.parametrize("device", STREAMED)
def test_lost_samples_are_reported_once(backend: Any, device: str) -> None:
    board, rate_hz = backend.board, backend.rates_hz[device]
    getattr(board, device).set_rate_hz(rate_hz)
    board.clock.sleep_until_s(20.0)
    reading = read(board, device)
    assert reading.overrun
    assert reading.times_s[-1] > 20.0 - 2.0 / rate_hz  # the newest are kept
    assert not read(board, device).overrun


@pytest.mark.parametrize("device", STREAMED)
@pytest.mark.parametrize("rate_hz", [0.0, -200.0, 12345.0, math.nan, math.inf])
def test_a_rate_that_the_part_lacks_is_refused(board: Board, device: str, rate_hz: float) -> None:
    with pytest.raises(CommandRefused, match=device):
        getattr(board, device).set_rate_hz(rate_hz)
    board.clock.sleep_until_s(0.05)
    assert read(board, device).times_s


@pytest.mark.parametrize("device", SENSORS)
def test_a_failed_read_raises_and_never_makes_up_a_value(backend: Any, device: str) -> None:
    backend.board.clock.sleep_until_s(0.05)
    read(backend.board, device)
    backend.break_device(device)
    with pytest.raises(ReadFailed, match=device):
        read(backend.board, device)


@pytest.mark.parametrize("device", SENSORS)
def test_a_closed_sensor_says_so(board: Board, device: str) -> None:
    getattr(board, device).close()
    getattr(board, device).close()
    with pytest.raises(DeviceClosed, match=device):
        read(board, device)


@pytest.mark.parametrize("device", STREAMED)
def test_a_closed_stream_takes_no_rate(backend: Any, device: str) -> None:
    stream = getattr(backend.board, device)
    stream.close()
    with pytest.raises(DeviceClosed, match=device):
        stream.set_rate_hz(backend.rates_hz[device])


@pytest.mark.device("accelerometer")
def test_the_accelerometer_knows_its_part(backend: Any) -> None:
    """At rest it reads what carries the body, in whole steps; its range holds a hop."""
    board = backend.board
    board.accelerometer.set_rate_hz(backend.rates_hz["accelerometer"])
    board.clock.sleep_until_s(0.2)
    reading = board.accelerometer.read()
    step = board.accelerometer.resolution_m_s2
    assert 0.0 < step < 1.0
    assert board.accelerometer.range_m_s2 > 200.0
    steps = [value / step for value in reading.specific_force_m_s2]
    assert max(abs(count - round(count)) for count in steps) < 1e-6
    assert 5.0 < sum(reading.specific_force_m_s2) / len(steps) < 12.0
    assert reading.saturated == (False,) * len(steps)


@pytest.mark.parametrize("device", POLLED)
def test_units_stand_in_the_readings(board: Board, device: str) -> None:
    """A nut that ran for a second at 6 V moved by millimetres; its motor draws less than an ampere."""
    start_m = board.nut_encoder.read().position_m
    last = {name: watch(board, name, board.clock.now_s() + 1.0)[-1] for name in POLLED}
    if device == "nut_encoder":
        assert 1e-4 < abs(last["nut_encoder"].position_m - start_m) < 1e-2
    else:
        assert 0.0 < last["motor_current"].current_a < 1.0


@pytest.mark.device("switches")
def test_switches_are_read_now(board: Board) -> None:
    board.clock.sleep_until_s(0.123)
    assert board.switches.read().time_s == pytest.approx(0.123, abs=0.01)


CLOSERS: dict[str, Callable[[Board], None]] = {
    "by hand": lambda board: board.close(),
    "by context": lambda board: board.__exit__(None, None, None),
}


@pytest.mark.parametrize("closer", CLOSERS)
def test_closing_a_board_closes_everything(board: Board, closer: str) -> None:
    CLOSERS[closer](board)
    for device in SENSORS:
        with pytest.raises(DeviceClosed):
            read(board, device)
