"""A board without physics, answering from a script, and a toy flight loop that decides from what it reads."""

from __future__ import annotations

import random
from typing import Any

from hal.board import Board
from hal.errors import CommandRefused, ReadFailed
from hal.log import LogSink
from hal.readings import (
    GroundCommand,
    MagnetCurrent,
    MotorCurrent,
    NutPosition,
    SpecificForce,
    SpringCompression,
    Switches,
)


class ScriptedRig:
    """All devices in one object; readings are pseudo-random, from a seed, and some reads fail."""

    max_voltage_v = 12.0
    timeout_s = 0.05

    def __init__(self, seed: int = 1) -> None:
        self.random = random.Random(seed)
        self.time_s = 0.0
        self.commands: list[tuple[str, Any]] = []
        self.closed: list[str] = []

    def board(self) -> Board:
        return Board(
            name="scripted",
            clock=self,
            motor=_Part(self, "motor"),
            magnet=_Part(self, "magnet"),
            nut_encoder=_Part(self, "nut_encoder"),
            motor_current=_Part(self, "motor_current"),
            magnet_current=_Part(self, "magnet_current"),
            spring=_Part(self, "spring"),
            accelerometer=_Part(self, "accelerometer"),
            switches=_Part(self, "switches"),
            watchdog=_Part(self, "watchdog"),
            ground_link=_Part(self, "ground_link"),
        )

    def now_s(self) -> float:
        return self.time_s

    def sleep_until_s(self, time_s: float) -> None:
        self.time_s = max(self.time_s, time_s) + self.random.random() * 1e-5


class _Part:
    """One device of the rig."""

    def __init__(self, rig: ScriptedRig, name: str) -> None:
        self.rig, self.name = rig, name

    max_voltage_v = 12.0
    timeout_s = 0.05
    range_m_s2 = 313.8
    resolution_m_s2 = 0.00957

    def close(self) -> None:
        self.rig.closed.append(self.name)

    def set_voltage_v(self, voltage_v: float) -> None:
        if abs(voltage_v) > self.max_voltage_v:
            raise CommandRefused(f"motor: voltage_v = {voltage_v} is outside [-12, 12]")
        self.rig.commands.append(("voltage", voltage_v))

    def switch_on(self) -> None:
        self.rig.commands.append(("magnet", True))

    def switch_off(self) -> None:
        self.rig.commands.append(("magnet", False))

    def set_rate_hz(self, rate_hz: float) -> None:
        self.rig.commands.append(("rate", rate_hz))

    def stroke(self) -> None:
        self.rig.commands.append(("stroke", None))

    def receive(self) -> tuple[GroundCommand, ...]:
        if self.rig.random.random() < 0.2:
            return (GroundCommand(self.rig.time_s, "set_energy", (("energy_j", 15.3),)),)
        return ()

    def send(self, topic: str, payload: str) -> None:
        self.rig.commands.append((topic, payload))

    def read(self) -> Any:
        time_s, value = self.rig.time_s, self.rig.random.gauss(0.0, 1.0)
        if self.name == "motor_current":
            if value > 1.5:
                raise ReadFailed("motor_current: no acknowledge on the bus")
            return MotorCurrent(time_s, value)
        times_s = tuple(time_s + 0.0006 * index for index in range(3))
        values = tuple(value + index for index in range(3))
        readings = {
            "nut_encoder": NutPosition(time_s, value),
            "switches": Switches(time_s, value > 0, value > 1),
            "spring": SpringCompression(times_s, values),
            "magnet_current": MagnetCurrent((), (), overrun=True),
            "accelerometer": SpecificForce(times_s, values, (False, True, False)),
        }
        return readings[self.name]


def fly_toy(board: Board, log: LogSink, ticks: int = 40) -> float:
    """Command a voltage that depends on all that was read; returns the sum of what was commanded."""
    board.accelerometer.set_rate_hz(1666.0)
    total_v = 0.0
    for tick in range(ticks):
        now_s = board.clock.now_s()
        commands = board.ground_link.receive()
        try:
            current_a = board.motor_current.read().current_a
        except ReadFailed as error:
            log.write("event", now_s, {"name": "current_lost", "says": str(error)})
            current_a = 0.0
        spring = board.spring.read()
        magnet = board.magnet_current.read()
        voltage_v = current_a + spring.compression_m[-1] + len(commands) + len(magnet.times_s)
        voltage_v = max(-board.motor.max_voltage_v, min(board.motor.max_voltage_v, voltage_v))
        board.motor.set_voltage_v(voltage_v)
        log.write("outputs", now_s, {"voltage_v": voltage_v, "magnet_on": board.switches.read().at_home})
        total_v += voltage_v
        board.watchdog.stroke()
        board.clock.sleep_until_s((tick + 1) * 0.005)
    return total_v
