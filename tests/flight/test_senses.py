"""Each reading lands in the field of its name, and a sensor that fails keeps its old value with its old time."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from flight.record import HopRecorder
from flight.sensing import Senses
from flight.states import SENSORS, Snapshot
from hal.board import Board
from hal.errors import ReadFailed
from hal.readings import (
    MagnetCurrent,
    MotorCurrent,
    NutPosition,
    SpecificForce,
    SpringCompression,
    Switches,
)

READINGS: dict[str, Any] = {
    "motor_current": MotorCurrent(1.0, 2.0, 3.0),
    "nut_encoder": NutPosition(4.0, 5.0),
    "switches": Switches(6.0, True, False),
    "spring": SpringCompression((7.0, 8.0), (9.0, 10.0)),
    "magnet_current": MagnetCurrent((11.0, 12.0), (13.0, 14.0)),
    "accelerometer": SpecificForce((15.0, 16.0, 17.0), (19.0, 21.0, 20.0), (False, False, False)),
}


class Sensor:
    def __init__(self, reading: Any) -> None:
        self.reading = reading

    def read(self) -> Any:
        if self.reading is None:
            raise ReadFailed("unplugged")
        return self.reading


def senses() -> tuple[Senses, dict[str, Sensor]]:
    sensors = {name: Sensor(reading) for name, reading in READINGS.items()}
    return Senses(cast(Board, SimpleNamespace(**sensors)), HopRecorder()), sensors


def expected(**changes: Any) -> Snapshot:
    told = Snapshot(
        time_s=30.0,
        motor_current_a=2.0,
        nut_position_m=5.0,
        at_home=True,
        latch_closed=False,
        compression_m=10.0,
        magnet_current_a=14.0,
        specific_force_m_s2=20.0,
        specific_force_low_m_s2=19.0,
        specific_force_high_m_s2=21.0,
        sampled_s={
            "motor_current": 1.0,
            "nut_encoder": 4.0,
            "switches": 6.0,
            "spring": 8.0,
            "magnet_current": 12.0,
            "accelerometer": 17.0,
        },
        tick_late_s=31.0,
        unstroked_share=32.0,
        magnet_failed=False,
        log_failed=False,
        memory_failed=False,
        supply_v=3.0,
        failed_reads=0,
        ground_heard=False,
    )
    return told._replace(**changes)


def test_every_reading_lands_in_its_field() -> None:
    found, _ = senses()
    snap, events = found.snapshot(30.0, 31.0, unstroked_share=32.0)
    assert snap == expected()
    assert events == []
    assert set(READINGS) == set(SENSORS)


@pytest.mark.parametrize("flag", ["magnet_failed", "log_failed", "memory_failed", "ground_heard"])
def test_every_flag_lands_in_its_field(flag: str) -> None:
    found, _ = senses()
    snap, _ = found.snapshot(30.0, 31.0, unstroked_share=32.0, **{flag: True})
    assert snap == expected(**{flag: True})


def test_the_two_switches_are_not_mixed_up() -> None:
    found, sensors = senses()
    sensors["switches"].reading = Switches(6.0, False, True)
    snap, _ = found.snapshot(30.0, 31.0, unstroked_share=32.0)
    assert snap == expected(at_home=False, latch_closed=True)


@pytest.mark.parametrize("failing", SENSORS)
def test_a_failed_sensor_keeps_its_old_value_and_its_old_time(failing: str) -> None:
    found, sensors = senses()
    found.snapshot(30.0, 31.0, unstroked_share=32.0)
    sensors[failing].reading = None
    snap, events = found.snapshot(30.0, 31.0, unstroked_share=32.0)
    assert snap == expected(failed_reads=1)
    assert [(event.name, event.details["sensor"]) for event in events] == [("read_failed", failing)]
    sensors[failing].reading = READINGS[failing]
    snap, events = found.snapshot(30.0, 31.0, unstroked_share=32.0)
    assert snap == expected()
    assert [(event.name, event.details["sensor"]) for event in events] == [("read_recovered", failing)]


@pytest.mark.parametrize("failing", SENSORS)
def test_a_sensor_that_never_delivered_has_no_age(failing: str) -> None:
    found, sensors = senses()
    sensors[failing].reading = None
    snap, _ = found.snapshot(30.0, 31.0)
    assert snap.age_s(failing) == float("inf")
