"""The rig: the simulated world with sensors sampling it, a watchdog guarding it, and time that goes on.

Devices talk to the rig only; nothing but `advance` moves time.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sim_hal.faults import Fault, Faults
from sim_hal.sensors import SampledSensor, instants
from sim_hal.settings import SimSettings
from sim_hal.world import World

CHUNK_S = 0.005
"""The world is advanced in pieces no longer than this, so that what ends a phase is seen in time."""

CHANNELS = {
    "motor_current": "motor_current_a",
    "nut_encoder": "nut_position_m",
    "spring": "spring_compression_m",
    "accelerometer": "body_acceleration_m_s2",
    "magnet_current": "magnet_current_a",
}
"""Device name of each sampled sensor, and the channel of the world that it senses."""


class Rig:
    """World, sensors, watchdog and faults on one clock."""

    def __init__(self, settings: SimSettings, world: World) -> None:
        self.world = world
        self.now_s = 0.0
        self.faults = Faults()
        self.faults.plant_all(settings.faults)
        self.watchdog_timeout_s = settings.watchdog.timeout_s
        self.watchdog_expired = False
        self.stop_high_m = settings.rig.stop_high_m
        self.nominal_supply_v = settings.motor.supply_v
        self._asked_v = 0.0
        self._last_stroke_s = 0.0
        self.witnesses: list[Callable[[float], None]] = []
        """Called with the time [s] after each piece of it."""
        # the order of CHANNELS fixes which substream is whose
        seeds = np.random.SeedSequence(settings.seed).spawn(len(CHANNELS) + 1)
        self._flicker = np.random.Generator(np.random.PCG64(seeds.pop()))
        self.sensors = {
            name: SampledSensor(name, getattr(settings.sensors, name), seed)
            for name, seed in zip(CHANNELS, seeds, strict=True)
        }
        self._sensing = [(name, CHANNELS[name], sensor) for name, sensor in self.sensors.items()]
        self._sampled_s = -1.0  # the first samples are those of 0 s
        self._step(0.0)

    def advance(self, to_s: float) -> None:
        """Let time pass until `to_s` [s]; nothing happens when that is past already."""
        while self.now_s < to_s:
            end_s = min(to_s, self.now_s + CHUNK_S)
            deadline_s = self._last_stroke_s + self.watchdog_timeout_s
            if not self.watchdog_expired and self.now_s < deadline_s < end_s:
                end_s = deadline_s
            self._step(end_s)
            if self.now_s >= deadline_s and not self.watchdog_expired:
                self.watchdog_expired = True
                self._asked_v = 0.0
                self.world.set_voltage_v(0.0)
                self.world.set_magnet(False)

    def _step(self, end_s: float) -> None:
        faults, broken = self.faults, self.faults.planted
        if broken:
            self._drop_power_of_silent_actuators()
        lock_fault = faults.of("lock", end_s) if broken else None
        self.world.lock_blocked = lock_fault is not None
        grids: dict[float, tuple[float, ...]] = {}  # sensors of one rate have their instants in common
        wanted = {}
        for _, channel, sensor in self._sensing:
            rate_hz = sensor.mode.rate_hz
            if rate_hz not in grids:
                grids[rate_hz] = instants(rate_hz, self._sampled_s, end_s)
            wanted[channel] = grids[rate_hz]
        truth = self.world.advance(end_s, wanted)
        self.now_s = self._sampled_s = end_s
        for name, channel, sensor in self._sensing:
            fault = self._fault_of(name, end_s) if broken else None
            if sensor.record(wanted[channel], truth[channel], fault) and fault:
                faults.note(fault, end_s)
        if lock_fault is not None and self.world.lock_is_due:
            faults.note(lock_fault, end_s)
        for witness in self.witnesses:
            witness(end_s)

    def _fault_of(self, sensor: str, now_s: float) -> Fault | None:
        """A sensor's fault; a shorted magnet shows in the sensor of its current."""
        magnet = self.faults.of("magnet", now_s) if sensor == "magnet_current" else None
        if magnet is not None and magnet.kind == "short":
            return magnet
        return self.faults.of(sensor, now_s)

    def answers(self, device: str) -> bool:
        """Whether the device answers now: not when it fails, nor each time that its bus flickers."""
        fault = self.faults.of(device, self.now_s)
        if fault is None or fault.kind not in ("fail", "flicker", "crash"):
            return True
        if fault.kind == "flicker" and float(self._flicker.random()) >= fault.size:
            return True
        self.faults.note(fault, self.now_s)
        if fault.kind == "crash":
            raise ZeroDivisionError(f"{device}: a bug in its driver")
        return False

    @property
    def supply_v(self) -> float:
        """Supply voltage [V]."""
        fault = self.faults.of("supply", self.now_s) if self.faults.planted else None
        if fault is None or fault.kind != "sag":
            return self.nominal_supply_v
        self.faults.note(fault, self.now_s)
        return self.nominal_supply_v - fault.size

    def stroke(self) -> None:
        """Restart the watchdog's time. Once it has cut the power, it stays cut."""
        self._last_stroke_s = self.now_s

    def command_voltage_v(self, voltage_v: float) -> None:
        """Apply a motor voltage [V], if the motor has power and obeys."""
        if self.faults.planted:
            self._note_disobedience("motor", voltage_v != self.world.voltage_v)
            if not self._obeys("motor"):
                return
        if not self.watchdog_expired:
            self._asked_v = voltage_v
            self._supply_motor()

    def _supply_motor(self) -> None:
        """The voltage asked for, as far as the supply has it."""
        most_v = max(0.0, self.supply_v)
        self.world.set_voltage_v(max(-most_v, min(most_v, self._asked_v)))

    def command_magnet(self, on: bool) -> None:
        """Energise the magnet or not, if it has power and obeys."""
        self._note_disobedience("magnet", on != self.world.magnet_on)
        if self._obeys("magnet"):
            self.world.set_magnet(on)

    def _note_disobedience(self, actuator: str, differs: bool) -> None:
        """A broken actuator that does not do what it is told, or has lost its power, makes a difference."""
        fault = self.faults.of(actuator, self.now_s)
        if fault is not None and fault.kind != "short" and differs:
            self.faults.note(fault, self.now_s)

    def note_effect(self, device: str) -> None:
        """The device's fault has made a difference."""
        fault = self.faults.of(device, self.now_s)
        if fault is not None:
            self.faults.note(fault, self.now_s)

    def _obeys(self, actuator: str) -> bool:
        fault = self.faults.of(actuator, self.now_s)
        return not self.watchdog_expired and (fault is None or fault.kind == "short")

    def _drop_power_of_silent_actuators(self) -> None:
        if self.faults.active("motor", self.now_s) == "silent":
            self._asked_v = 0.0
            self.world.set_voltage_v(0.0)
        if self.faults.active("supply", self.now_s) == "sag":
            self._supply_motor()
        if self.faults.active("magnet", self.now_s) == "silent":
            self.world.set_magnet(False)
