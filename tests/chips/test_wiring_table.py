"""The wiring table of the bring-up page is the wiring of the settings: each pin, address and bus."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from chip_helpers import pi_settings

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "bring-up.md").read_text(encoding="utf-8")
WIRING = pi_settings()

HEADER_PINS = {
    2: 3, 3: 5, 4: 7, 5: 29, 6: 31, 8: 24, 9: 21, 10: 19, 11: 23, 17: 11, 18: 12, 19: 35, 22: 15, 23: 16, 27: 13,
}  # fmt: skip
"""GPIO number to pin of the 40-pin header, of those that the table names."""


def row(part: str) -> str:
    """The connection in the table's row of a part."""
    (found,) = [line for line in PAGE.splitlines() if line.startswith("| ") and part in line.split("|")[1]]
    return found.split("|")[3]


def gpio(text: str) -> set[int]:
    """The GPIO numbers of a connection whose header pins, in brackets, are those of the header."""
    found = set()
    for numbers, pins in re.findall(r"(\d+(?:, \d+)*) \[(\d+(?:, \d+)*)\]", text):
        for number, pin in zip(numbers.split(", "), pins.split(", "), strict=True):
            assert HEADER_PINS[int(number)] == int(pin)
            found.add(int(number))
    return found


@pytest.mark.parametrize(
    ("part", "bus", "address"),
    [
        ("LSM6DSO32", WIRING.accelerometer.bus, WIRING.accelerometer.address),
        ("ADS1015", WIRING.spring.bus, WIRING.spring.address),
    ],
)
def test_parts_on_a_bus(part: str, bus: int, address: int) -> None:
    assert f"I²C {bus}, address {address:02X}h" in row(part)
    assert gpio(row(part)) <= {2, 3, 4, 5}


def test_both_current_sensors() -> None:
    rows = [line for line in PAGE.splitlines() if line.startswith("| INA226")]
    for line, current in zip(rows, (WIRING.motor_current, WIRING.magnet_current), strict=True):
        assert f"shunt {1e3 * current.shunt_ohm:g} mΩ" in line
        assert f"I²C {current.bus}, address {current.address:02X}h" in line


def test_motor_and_its_two_stages() -> None:
    motor = WIRING.motor
    assert motor.roboclaw is not None
    assert motor.h_bridge is not None
    assert motor.roboclaw.port in row("RoboClaw")
    assert f"address {motor.roboclaw.address:02X}h" in row("RoboClaw")
    assert f"PWM {motor.h_bridge.pwm.channel}" in row("H-bridge")
    assert motor.h_bridge.direction_pin in gpio(row("H-bridge"))


def test_magnet_switches_and_supervisor() -> None:
    assert f"PWM {WIRING.magnet.pwm.channel}" in row("MOSFET")
    assert gpio(row("home switch")) == {WIRING.switches.home_pin}
    assert gpio(row("latch sensor")) == {WIRING.switches.latch_pin}
    assert gpio(row("supervisor")) == {WIRING.watchdog.heartbeat_pin, WIRING.watchdog.arm_pin}


def test_every_pin_named_is_named_once() -> None:
    table = PAGE[PAGE.index("| part |") : PAGE.index("Two I²C buses")]
    numbers = re.findall(r"(\d+(?:, \d+)*) \[", table)
    each = [int(number) for group in numbers for number in group.split(", ")]
    assert len(each) == len(set(each))
