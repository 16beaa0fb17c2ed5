"""A board at the physical level for the tests of flight: nut, string, lock, spring and hop, nothing more."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from two_mass import SAND, Ground, TwoMassHop

from flight.settings import FlightSettings
from hal.board import Board
from hal.errors import DeviceError, ReadFailed
from hal.readings import (
    GroundCommand,
    MagnetCurrent,
    MotorCurrent,
    NutPosition,
    SpecificForce,
    SpringCompression,
    Switches,
)

RATE_HZ = 1666.0
OPENING_S = 0.0069
STOP_M = -0.003  # lower end of the screw


@lru_cache(maxsize=32)
def cached_hop(compression_m: float, ground: Ground) -> TwoMassHop:
    return TwoMassHop(compression_m, ground)


class FakeRobot:
    """The robot behind the board. `home_m` is where the home switch closes, from string-taut (x = 0)."""

    def __init__(self, settings: FlightSettings, *, nut_m: float = 0.0, latched: bool = False) -> None:
        self.settings = settings
        self.rng = np.random.Generator(np.random.PCG64(7))
        self.now_s = 0.0
        self.nut_m = self.start_m = nut_m
        self.home_m = -0.001
        self.latched = latched
        self.voltage_v = 0.0
        self.current_a = 0.0
        self.magnet_on = False
        self.magnet_works = True
        self.magnet_s = math.inf
        self.hop: TwoMassHop | None = None
        self.hop_s = math.inf
        self.jammed = self.unplugged = False
        self.held_m: float | None = None  # what a stuck spring sensor shows
        self.held_switches: tuple[bool, bool] | None = None  # home and latch as stuck switches show them
        self.failing: set[str] = set()
        self.silent: set[str] = set()
        self.refused: list[str] = []  # actuators, once for each command that they did not take
        self.read_until = {"spring": 0.0, "magnet": 0.0, "force": 0.0}
        self.commands: list[GroundCommand] = []
        self.sent: list[tuple[str, str]] = []
        self.magnet_times_s: list[float] = []
        self.grounds: list[Ground] = []  # of the hops to come; SAND once it is used up
        self.hops: list[TwoMassHop] = []
        self.slips = False
        self.broken = False
        self.extra_current_a = 0.0
        self.current_rng = np.random.Generator(np.random.PCG64(8))
        self.strokes = 0
        self.on_tick: Callable[[], None] = lambda: None

    @property
    def compression_m(self) -> float:
        if not self.latched or self.slips:
            return 0.0
        return max(self.nut_m, 0.0) / self.settings.rig.travel_per_compression

    @property
    def last_hop(self) -> TwoMassHop | None:
        return self.hops[-1] if self.hops else None

    def spring_at(self, times_s: np.ndarray) -> np.ndarray:
        if self.hop is not None:
            return self.hop.read(times_s - self.hop_s)[1]
        return np.full(times_s.size, self.compression_m)

    def force_at(self, times_s: np.ndarray) -> np.ndarray:
        if self.hop is not None:
            return self.hop.read(times_s - self.hop_s)[0]
        return np.full(times_s.size, self.settings.rig.gravity_m_s2)

    def advance(self, to_s: float) -> None:
        drive = self.settings.drive
        while self.now_s < to_s - 1e-12:
            step_s = min(0.001, to_s - self.now_s)
            self._move_nut(step_s, drive)
            self.now_s += step_s
            energised = self.magnet_on and self.magnet_works
            if energised and self.latched and self.now_s >= self.magnet_s + OPENING_S:
                ground = self.grounds.pop(0) if self.grounds else SAND
                self.hop = cached_hop(round(self.compression_m, 6), ground)
                self.hops.append(self.hop)
                self.hop_s, self.latched = self.magnet_s + OPENING_S, False
            if self.hop is not None and self.now_s > self.hop_s + self.hop.duration_s:
                self.hop = None
            if self.nut_m <= self.home_m and not self.magnet_on and self.hop is None:
                self.latched = True

    def _move_nut(self, step_s: float, drive: Any) -> None:
        """Steady-state drive: the speed that the voltage gives against the load at once."""
        r, k_t = drive.travel_per_radian_m, drive.torque_constant_n_m_a
        screw = r * self.settings.rig.spring_stiffness_n_m * self.compression_m
        up = screw / drive.tensioning_efficiency + drive.coulomb_friction_n_m
        down = screw * drive.back_driving_efficiency - drive.coulomb_friction_n_m
        if self.unplugged:
            self.current_a = 0.0
            return
        stall_torque = k_t * self.voltage_v / drive.resistance_ohm
        resisting = up if stall_torque > up else down if stall_torque < down else stall_torque
        slope = k_t * k_t / drive.resistance_ohm + drive.viscous_friction_n_m_s
        at_stop = self.nut_m <= STOP_M and stall_torque < 0.0
        omega = 0.0 if self.jammed or at_stop else (stall_torque - resisting) / slope
        self.nut_m += omega * r * step_s
        self.current_a = (self.voltage_v - k_t * omega) / drive.resistance_ohm


class _Device:
    def __init__(self, robot: FakeRobot, name: str) -> None:
        self.robot, self.name, self.closed = robot, name, False

    def close(self) -> None:
        self.closed = True

    def obey(self) -> None:
        if self.name in self.robot.failing:
            self.robot.refused.append(self.name)
            raise DeviceError(f"{self.name}: command not acknowledged")

    def check(self) -> None:
        if self.name in self.robot.failing:
            raise ReadFailed(f"{self.name}: no answer")

    def batch(self, key: str, rate_hz: float) -> np.ndarray:
        """Sample instants since the last read, on the sensor's own grid."""
        self.check()
        last = self.robot.read_until[key]
        if self.name in self.robot.silent:
            return np.empty(0)
        first, stop = math.floor(last * rate_hz) + 1, math.floor(self.robot.now_s * rate_hz)
        self.robot.read_until[key] = max(self.robot.now_s, last)
        return np.arange(first, stop + 1) / rate_hz


class FakeClock:
    def __init__(self, robot: FakeRobot) -> None:
        self.robot = robot

    def now_s(self) -> float:
        return self.robot.now_s

    def sleep_until_s(self, time_s: float) -> None:
        self.robot.advance(time_s)
        self.robot.on_tick()


class FakeMotor(_Device):
    max_voltage_v = 12.0

    def set_voltage_v(self, voltage_v: float) -> None:
        assert abs(voltage_v) <= self.max_voltage_v
        self.obey()
        self.robot.voltage_v = voltage_v


class FakeMagnet(_Device):
    def switch_on(self) -> None:
        self.obey()
        self.robot.magnet_on, self.robot.magnet_s = True, self.robot.now_s
        self.robot.magnet_times_s.append(self.robot.now_s)

    def switch_off(self) -> None:
        self.obey()
        self.robot.magnet_on = False


class FakeEncoder(_Device):
    def read(self) -> NutPosition:
        self.check()
        return NutPosition(self.robot.now_s, self.robot.nut_m - self.robot.start_m)


class FakeMotorCurrent(_Device):
    def read(self) -> MotorCurrent:
        self.check()
        if self.robot.broken:
            raise ZeroDivisionError("a bug in a driver")
        noise_a = float(self.robot.current_rng.normal(0.0, 0.002))
        return MotorCurrent(self.robot.now_s, self.robot.current_a + self.robot.extra_current_a + noise_a)


class FakeSwitches(_Device):
    def read(self) -> Switches:
        self.check()
        shown = self.robot.held_switches or (self.robot.nut_m <= self.robot.home_m, self.robot.latched)
        return Switches(self.robot.now_s, *shown)


class FakeSpring(_Device):
    rate_hz = 200.0

    def set_rate_hz(self, rate_hz: float) -> None:
        self.rate_hz = rate_hz

    def read(self) -> SpringCompression:
        times = self.batch("spring", self.rate_hz)
        noise = 20e-6 if self.rate_hz == 200.0 else 50e-6
        values = self.robot.spring_at(times) + self.robot.rng.normal(0.0, noise, times.size)
        if self.robot.held_m is not None:
            values = np.full(times.size, self.robot.held_m)
        return SpringCompression(tuple(times.tolist()), tuple(values.tolist()))


class FakeMagnetCurrent(_Device):
    def set_rate_hz(self, rate_hz: float) -> None:
        pass

    def read(self) -> MagnetCurrent:
        times = self.batch("magnet", RATE_HZ)
        rise = np.clip(times - self.robot.magnet_s, 0.0, None) if self.robot.magnet_on else 0.0 * times
        values = 1.5 * (1.0 - np.exp(-rise / 0.0075))
        return MagnetCurrent(tuple(times.tolist()), tuple(values.tolist()))


class FakeAccelerometer(_Device):
    range_m_s2 = 313.8
    resolution_m_s2 = 0.00957

    def set_rate_hz(self, rate_hz: float) -> None:
        pass

    def read(self) -> SpecificForce:
        times = self.batch("force", RATE_HZ)
        values = self.robot.force_at(times) + self.robot.rng.normal(0.0, 0.035, times.size)
        values = np.round(values / self.resolution_m_s2) * self.resolution_m_s2
        clipped = np.clip(values, -self.range_m_s2, self.range_m_s2)
        flags = tuple((np.abs(values) >= self.range_m_s2).tolist())
        return SpecificForce(tuple(times.tolist()), tuple(clipped.tolist()), flags)


class FakeWatchdog(_Device):
    timeout_s = 0.1

    def stroke(self) -> None:
        self.robot.strokes += 1


class FakeLink(_Device):
    def receive(self) -> tuple[GroundCommand, ...]:
        arrived, self.robot.commands = tuple(self.robot.commands), []
        return arrived

    def send(self, topic: str, payload: str) -> None:
        self.robot.sent.append((topic, payload))


class ListLog:
    """A log sink that keeps everything."""

    def __init__(self) -> None:
        self.entries: list[tuple[str, float, dict[str, Any]]] = []

    def write(self, topic: str, time_s: float, payload: Mapping[str, Any]) -> None:
        self.entries.append((topic, time_s, dict(payload)))

    def of(self, topic: str) -> list[dict[str, Any]]:
        return [payload for name, _, payload in self.entries if name == topic]

    def events(self, name: str) -> list[dict[str, Any]]:
        return [event for event in self.of("event") if event["name"] == name]

    def phases(self) -> list[str]:
        return [state["to"] for state in self.of("state")]


def fake_board(robot: FakeRobot) -> Board:
    return Board(
        name="fake",
        clock=FakeClock(robot),
        motor=FakeMotor(robot, "motor"),
        magnet=FakeMagnet(robot, "magnet"),
        nut_encoder=FakeEncoder(robot, "nut_encoder"),
        motor_current=FakeMotorCurrent(robot, "motor_current"),
        magnet_current=FakeMagnetCurrent(robot, "magnet_current"),
        spring=FakeSpring(robot, "spring"),
        accelerometer=FakeAccelerometer(robot, "accelerometer"),
        switches=FakeSwitches(robot, "switches"),
        watchdog=FakeWatchdog(robot, "watchdog"),
        ground_link=FakeLink(robot, "ground_link"),
    )
