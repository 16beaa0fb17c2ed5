"""The RoboClaw driver on its line: packets, damage, repetition; and the bridge with its counter."""

from __future__ import annotations

from collections import deque

import pytest
from chip_helpers import Opener, pi_settings, run_ticks
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hal.errors import (
    BadChecksum,
    CommandRefused,
    DeviceError,
    DeviceReset,
    ReadTimeout,
    ShortRead,
    WrongDevice,
)
from hal.raspberry_pi.roboclaw import RoboClaw, crc16
from sim_hal.chips.board import EmulatedBoard

CLAW = pi_settings().motor.roboclaw
assert CLAW is not None
ADDRESS = CLAW.address


class Script:
    """A line that answers what the test says, in order; without an answer it stays silent."""

    def __init__(self, *answers: bytes) -> None:
        self.answers = deque(answers)
        self.sent: list[bytes] = []
        self._waiting = b""

    def write(self, data: bytes, /) -> int:
        self.sent.append(bytes(data))
        self._waiting = self.answers.popleft() if self.answers else b""
        return len(data)

    def read(self, size: int = 1, /) -> bytes:
        got, self._waiting = self._waiting[:size], self._waiting[size:]
        return got

    def reset_input_buffer(self) -> None:
        self._waiting = b""

    def close(self) -> None: ...


def reply(number: int, data: bytes) -> bytes:
    return data + crc16(bytes((ADDRESS, number)) + data)


def opening(name: bytes = b"USB RoboClaw 2x7a v4.1.34\n\0", digits: int = 1) -> list[bytes]:
    """Answers to what the driver asks when it is opened."""
    return [b"\xff", reply(21, name), b"\xff", reply(15, bytes((digits,)))]


def test_the_crc_is_the_one_of_the_manual() -> None:
    """CRC-16/XMODEM, whose check value of '123456789' is 31C3h."""
    assert crc16(b"123456789") == bytes.fromhex("31c3")


def test_opening_stops_the_motor_first_and_sets_the_controller_s_watchdog() -> None:
    line = Script(*opening())
    assert CLAW is not None
    RoboClaw(line, CLAW)
    drive = bytes((ADDRESS, 32, 0, 0))
    timeout = bytes((ADDRESS, 14, 1))
    assert line.sent == [
        drive + crc16(drive),
        bytes((ADDRESS, 21)),
        timeout + crc16(timeout),
        bytes((ADDRESS, 15)),
    ]


@pytest.mark.parametrize(
    ("answers", "error"),
    [
        ([], DeviceError),
        (opening(name=b"something else\n\0"), WrongDevice),
        (opening(digits=0), DeviceReset),
    ],
)
def test_what_is_no_controller_in_order_is_refused(answers: list[bytes], error: type[DeviceError]) -> None:
    assert CLAW is not None
    with pytest.raises(error):
        RoboClaw(Script(*answers), CLAW)


@pytest.mark.parametrize(
    ("damaged", "error"),
    [
        (reply(24, b"\x00\x78")[:-1] + b"\x00", BadChecksum),
        (reply(24, b"\x00\x78")[:3], ShortRead),
        (b"", ReadTimeout),
        (reply(49, b"\x00\x78"), BadChecksum),  # the answer to another question
    ],
)
def test_a_damaged_answer_is_asked_for_again_once_then_named(
    damaged: bytes, error: type[DeviceError]
) -> None:
    good = reply(24, b"\x00\x78")
    assert CLAW is not None
    line = Script(*opening(), damaged, good, damaged, damaged)
    controller = RoboClaw(line, CLAW)
    assert controller.battery_v() == pytest.approx(12.0)
    with pytest.raises(error):
        controller.battery_v()


@given(st.binary(max_size=12))
def test_no_noise_is_ever_a_reading(noise: bytes) -> None:
    assert CLAW is not None
    controller = RoboClaw(Script(*opening(), noise, noise), CLAW)
    good = len(noise) >= 7 and crc16(bytes((ADDRESS, 16)) + noise[:5]) == noise[5:7]
    if not good:
        with pytest.raises((BadChecksum, ShortRead, ReadTimeout)):
            controller.encoder_count()


@given(noise=st.binary(max_size=12))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_no_noise_moves_the_emulated_motor(board: EmulatedBoard, noise: bytes) -> None:
    board.motor.set_voltage_v(0.0)
    board.chips.controller._answer(noise)
    whole = len(noise) == 6 and noise[:2] == bytes((ADDRESS, 32)) and crc16(noise[:4]) == noise[4:]
    assert whole or board.rig.outputs_off


def test_voltage_is_a_share_of_the_supply_that_was_measured(open_board: Opener) -> None:
    board = open_board(supply_v=13.5)
    run_ticks(board, 2, 6.0)
    assert board.rig.world.voltage_v == pytest.approx(6.0, abs=13.5 / 32767)
    board.motor.set_voltage_v(12.0)
    with pytest.raises(CommandRefused, match="is outside ±12 V"):
        board.motor.set_voltage_v(13.0)


def test_a_low_supply_lowers_the_limit_and_a_wrong_one_is_refused(open_board: Opener) -> None:
    assert open_board(supply_v=11.0).motor.max_voltage_v == pytest.approx(11.0)
    with pytest.raises(DeviceError, match=r"supply is 24.0 V, allowed are 10.5 to 14 V"):
        open_board(supply_v=24.0)


def test_the_controller_measures_the_motor_s_current(board: EmulatedBoard) -> None:
    run_ticks(board, 3, 6.0)
    controller = RoboClaw(board.chips.serial("", 115200, 0.05), CLAW)  # type: ignore[arg-type]
    assert controller.motor_current_a() == pytest.approx(board.motor_current.read().current_a, abs=0.02)


def test_the_bridge_turns_both_ways_and_its_counter_follows(open_board: Opener) -> None:
    board = open_board(wiring={"motor": {"stage": "h_bridge"}})
    run_ticks(board, 60, 6.0)
    forth_m = board.nut_encoder.read().position_m
    assert forth_m > 1e-4
    true_m = board.rig.world.nut_position_m - 0.002
    assert forth_m == pytest.approx(true_m, abs=1e-5)  # it is sampled at 200 Hz
    run_ticks(board, 120, -6.0)
    assert board.nut_encoder.read().position_m < forth_m
    board.motor.set_voltage_v(0.0)
    assert board.rig.outputs_off


def test_a_counter_that_lost_its_power_or_is_absent_is_an_error(open_board: Opener) -> None:
    board = open_board(wiring={"motor": {"stage": "h_bridge"}})
    run_ticks(board, 4, 6.0)
    board.chips.counter.reset()
    with pytest.raises(DeviceReset, match="nut_encoder"):
        board.nut_encoder.read()


@pytest.mark.parametrize("sign", [1, -1])
def test_a_motor_wired_the_other_way_is_set_right_by_its_sign(open_board: Opener, sign: int) -> None:
    board = open_board(wiring={"motor": {"sign": sign}})
    run_ticks(board, 60, 6.0)
    assert board.rig.world.voltage_v == pytest.approx(6.0, abs=1e-3)
    assert board.nut_encoder.read().position_m > 1e-4
