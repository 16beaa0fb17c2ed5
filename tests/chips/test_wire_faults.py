"""Every fault of a wire is said by its name, never read as a value, and leaves the outputs off."""

from __future__ import annotations

from typing import Any

import pytest
from chip_helpers import Opener, run_ticks

from hal.errors import (
    BadChecksum,
    BusStuck,
    ConfigError,
    DeviceError,
    DeviceReset,
    NoAcknowledge,
    ReadFailed,
    ReadTimeout,
    ShortRead,
)
from sim_hal.chips.board import EmulatedBoard
from sim_hal.chips.ports import PLACES

NAMED: dict[str, type[ReadFailed]] = {
    "nack": NoAcknowledge,
    "timeout": ReadTimeout,
    "stuck": BusStuck,
    "short": ShortRead,
    "crc": ReadFailed,  # without a checksum: seen as settings, tags or identity that are not what was set
    "unplug": ReadFailed,  # by what the rest of the burst reads as
    "brown_out": DeviceReset,
}
"""How a fault is named by the read in which it strikes."""

ON_SERIAL = NAMED | {"crc": BadChecksum}
WIRES = [(place, kind) for place, kinds in PLACES.items() for kind in kinds]
BRIDGE = {
    "motor": {"stage": "h_bridge"},
    "accelerometer": {"part": "adxl375", "address": 0x53, "range_g": 200, "rate_hz": 200.0},
    "spring": {"part": "ads1115", "rates_hz": [200.0]},
}
"""The other parts that the drivers know."""


def read_after(board: EmulatedBoard, device: str, place: str, kind: str) -> Any:
    """Read once in order, plant the fault, and read again after a tick."""
    run_ticks(board, 10)
    getattr(board, device).read()
    board.wire.plant(place, kind, board.clock.now_s())
    run_ticks(board, 2)
    return getattr(board, device).read()


@pytest.mark.parametrize("parts", ["shipped", "others"])
@pytest.mark.parametrize(("place", "kind"), WIRES)
def test_each_fault_of_each_wire_is_named_and_never_read_as_a_value(
    open_board: Opener, place: str, kind: str, parts: str
) -> None:
    """All that can be planted is: a kind of fault or a place that is added has its case here by itself."""
    board = open_board(wiring=BRIDGE if parts == "others" else {})
    if place == "motor_controller" and parts == "others":
        pytest.skip(
            "the bridge has no controller on a line; its counter's faults are in test_motor_controller.py"
        )
    device, named = ("nut_encoder", ON_SERIAL) if place == "motor_controller" else (place, NAMED)
    with pytest.raises(named[kind], match=device):
        read_after(board, device, place, kind)
    if kind != "brown_out":  # which strikes once, and what was lost is set again or stays named
        with pytest.raises(ReadFailed, match=device):
            run_ticks(board, 1)
            getattr(board, device).read()


def test_a_kind_of_fault_that_no_wire_can_have_is_not_known() -> None:
    assert {kind for kinds in PLACES.values() for kind in kinds} == set(NAMED)


def test_a_part_unplugged_amid_a_burst_is_seen_in_that_burst(board: EmulatedBoard) -> None:
    board.accelerometer.set_rate_hz(1666.0)
    run_ticks(board, 4)
    board.accelerometer.read()
    run_ticks(board, 1)
    fault = board.wire.plant("accelerometer", "unplug", board.clock.now_s())
    fault.used = 0
    with pytest.raises(ReadFailed):
        board.accelerometer.read()
    with pytest.raises(NoAcknowledge):
        board.accelerometer.read()


def test_a_stuck_line_stops_the_whole_bus(board: EmulatedBoard) -> None:
    """Accelerometer and motor current share a bus; the spring has another."""
    run_ticks(board, 10)
    board.wire.plant("motor_current", "stuck", board.clock.now_s())
    with pytest.raises(BusStuck):
        board.accelerometer.read()
    assert board.spring.read().times_s


def test_a_fault_that_passes_leaves_a_gap_that_is_told(board: EmulatedBoard) -> None:
    board.magnet_current.set_rate_hz(1666.0)
    run_ticks(board, 4)
    board.magnet_current.read()
    now_s = board.clock.now_s()
    board.wire.plant("magnet_current", "nack", now_s, now_s + 0.0025)
    run_ticks(board, 1)
    with pytest.raises(NoAcknowledge):
        board.magnet_current.read()
    run_ticks(board, 1)
    assert board.magnet_current.read().overrun
    run_ticks(board, 1)
    assert not board.magnet_current.read().overrun


@pytest.mark.parametrize("kind", ["timeout", "crc", "unplug"])
def test_a_motor_that_does_not_acknowledge_is_stopped_by_its_own_watchdog(
    board: EmulatedBoard, kind: str
) -> None:
    run_ticks(board, 60, 6.0)
    board.wire.plant("motor_controller", kind, board.clock.now_s())
    with pytest.raises(DeviceError, match="motor"):
        board.motor.set_voltage_v(0.0)
    run_ticks(board, 30)  # the supervisor is kept quiet: it is the controller that stops
    assert board.rig.supply_on
    assert board.rig.world.voltage_v == 0.0


def test_a_controller_that_browns_out_stops(board: EmulatedBoard) -> None:
    run_ticks(board, 20, 6.0)
    board.wire.plant("motor_controller", "brown_out", board.clock.now_s())
    with pytest.raises(DeviceReset):
        board.nut_encoder.read()
    assert board.rig.world.voltage_v == 0.0


@pytest.mark.parametrize(("place", "kind"), WIRES)
def test_outputs_are_off_after_closing_whatever_the_fault(open_board: Opener, place: str, kind: str) -> None:
    board = open_board()
    run_ticks(board, 20, 6.0)
    board.magnet.switch_on()
    assert not board.rig.outputs_off
    board.wire.plant(place, kind, board.clock.now_s())
    board.close()
    board.rig.advance(board.rig.now_s + 0.3)
    assert board.rig.world.voltage_v == 0.0
    assert not board.rig.world.magnet_on


def test_an_overrun_is_told_and_the_newest_samples_are_kept(board: EmulatedBoard) -> None:
    """The FIFO of 512 words holds 0.307 s at 1666 Hz."""
    board.accelerometer.set_rate_hz(1666.0)
    run_ticks(board, 80)
    reading = board.accelerometer.read()
    assert reading.overrun
    assert len(reading.times_s) == 512
    assert reading.times_s[-1] == pytest.approx(board.clock.now_s(), abs=1e-3)


@pytest.mark.parametrize(
    ("place", "kind"),
    [("nowhere", "nack"), ("spring", "nonsense"), ("spring", "short"), ("motor_controller", "nack")],
)
def test_an_unknown_fault_is_refused(board: EmulatedBoard, place: str, kind: str) -> None:
    with pytest.raises(ConfigError, match="known here"):
        board.wire.plant(place, kind, 0.0)
