"""What clock, actuators, watchdog and ground link of every backend keep to."""

from __future__ import annotations

import math
from typing import Any

import pytest

from hal.board import Board
from hal.errors import CommandRefused, DeviceClosed, DeviceError


def run_motor(board: Board, voltage_v: float, duration_s: float, stroke: bool = True) -> float:
    """Travel of the nut [m] while the motor has been at one voltage."""
    start_m = board.nut_encoder.read().position_m
    board.motor.set_voltage_v(voltage_v)
    end_s = board.clock.now_s() + duration_s
    while board.clock.now_s() < end_s:
        if stroke:
            board.watchdog.stroke()
        board.clock.sleep_until_s(min(end_s, board.clock.now_s() + 0.02))
    return board.nut_encoder.read().position_m - start_m


@pytest.mark.device("clock")
@pytest.mark.parametrize("time_s", [0.1, 0.100001, 1 / 3])
def test_sleeping_reaches_the_time_and_never_goes_back(board: Board, time_s: float) -> None:
    board.clock.sleep_until_s(time_s)
    reached_s = board.clock.now_s()
    assert reached_s >= time_s
    board.clock.sleep_until_s(time_s - 0.05)
    assert board.clock.now_s() >= reached_s


@pytest.mark.device("clock")
@pytest.mark.parametrize("time_s", [math.nan, math.inf, -math.inf])
def test_sleeping_until_never_is_refused(board: Board, time_s: float) -> None:
    with pytest.raises(CommandRefused):
        board.clock.sleep_until_s(time_s)


@pytest.mark.device("motor")
def test_positive_voltage_tensions_and_negative_goes_home(board: Board) -> None:
    assert run_motor(board, 6.0, 0.5) > 1e-4
    assert run_motor(board, -6.0, 0.5) < -1e-4


@pytest.mark.device("motor")
@pytest.mark.parametrize("excess_v", [1e-6, 100.0, math.inf, math.nan])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_voltage_out_of_range_is_refused_and_nothing_changes(
    board: Board, excess_v: float, sign: float
) -> None:
    run_motor(board, 0.0, 0.1)
    with pytest.raises(CommandRefused, match="V is outside"):
        board.motor.set_voltage_v(sign * (board.motor.max_voltage_v + excess_v))
    assert abs(run_motor(board, 0.0, 0.2)) < 1e-7


@pytest.mark.device("motor")
def test_the_largest_voltage_is_allowed(board: Board) -> None:
    board.motor.set_voltage_v(board.motor.max_voltage_v)
    board.motor.set_voltage_v(-board.motor.max_voltage_v)


@pytest.mark.device("magnet")
def test_the_magnet_draws_current_only_while_it_is_on(board: Board) -> None:
    board.magnet_current.set_rate_hz(1666.0)

    def mean_a() -> float:
        board.magnet_current.read()
        board.clock.sleep_until_s(board.clock.now_s() + 0.09)
        board.watchdog.stroke()
        currents = board.magnet_current.read().current_a[-40:]
        return sum(currents) / len(currents)

    assert abs(mean_a()) < 0.01
    board.magnet.switch_on()
    assert mean_a() > 0.5
    board.magnet.switch_off()
    assert abs(mean_a()) < 0.05


@pytest.mark.device("watchdog")
def test_a_starved_watchdog_cuts_all_power(board: Board) -> None:
    assert run_motor(board, 6.0, 0.3) > 1e-4
    board.magnet.switch_on()
    board.clock.sleep_until_s(board.clock.now_s() + board.watchdog.timeout_s + 0.1)
    assert abs(run_motor(board, 0.0, 0.1, stroke=False)) < 1e-6
    board.motor.set_voltage_v(6.0)
    assert abs(run_motor(board, 6.0, 0.3)) < 1e-6  # strokes that come too late bring nothing back
    assert abs(board.magnet_current.read().current_a[-1]) < 0.05


@pytest.mark.device("watchdog")
def test_a_stroked_watchdog_leaves_the_power_on(board: Board) -> None:
    assert board.watchdog.timeout_s > 0.02
    assert run_motor(board, 6.0, 5 * board.watchdog.timeout_s) > 1e-4


@pytest.mark.parametrize("device", ["motor", "magnet"])
def test_a_closed_actuator_has_no_power_and_takes_no_command(board: Board, device: str) -> None:
    run_motor(board, 6.0, 0.2)
    board.magnet.switch_on()
    getattr(board, device).close()
    getattr(board, device).close()
    with pytest.raises(DeviceClosed, match=device):
        board.motor.set_voltage_v(0.0) if device == "motor" else board.magnet.switch_off()
    start_m = board.nut_encoder.read().position_m
    end_s = board.clock.now_s() + 0.3
    while board.clock.now_s() < end_s:
        board.watchdog.stroke()
        board.clock.sleep_until_s(board.clock.now_s() + 0.02)
    if device == "motor":
        assert abs(board.nut_encoder.read().position_m - start_m) < 1e-4  # it coasts to a stop
    else:
        assert abs(board.magnet_current.read().current_a[-1]) < 0.05


@pytest.mark.parametrize("device", ["motor", "magnet"])
def test_a_command_that_is_not_acknowledged_raises(backend: Any, device: str) -> None:
    board: Board = backend.board
    backend.break_device(device)
    with pytest.raises(DeviceError, match=device):
        board.motor.set_voltage_v(1.0) if device == "motor" else board.magnet.switch_on()


@pytest.mark.device("watchdog")
def test_closed_watchdog_and_link_say_so(board: Board) -> None:
    board.watchdog.close()
    board.ground_link.close()
    with pytest.raises(DeviceClosed, match="watchdog"):
        board.watchdog.stroke()
    with pytest.raises(DeviceClosed, match="ground_link"):
        board.ground_link.send("state", "{}")
    with pytest.raises(DeviceClosed, match="ground_link"):
        board.ground_link.receive()


@pytest.mark.device("ground_link")
def test_an_idle_link_has_no_commands(board: Board) -> None:
    board.ground_link.send("state", '{"phase": "ready"}')
    assert board.ground_link.receive() == ()
