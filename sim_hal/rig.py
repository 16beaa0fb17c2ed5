"""The rig: the simulated world with sensors sampling it, a watchdog guarding it, and time that goes on.

Devices talk to the rig only; nothing but `advance` moves time.
"""

from __future__ import annotations

import numpy as np

from sim_hal.faults import Faults
from sim_hal.sensors import SampledSensor
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
        self._last_stroke_s = 0.0
        # the order of CHANNELS fixes which substream is whose
        seeds = np.random.SeedSequence(settings.seed).spawn(len(CHANNELS))
        self.sensors = {
            name: SampledSensor(name, getattr(settings.sensors, name), seed)
            for name, seed in zip(CHANNELS, seeds, strict=True)
        }
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
                self.world.set_voltage_v(0.0)
                self.world.set_magnet(False)

    def _step(self, end_s: float) -> None:
        self._drop_power_of_silent_actuators()
        wanted = {name: sensor.due(end_s) for name, sensor in self.sensors.items()}
        truth = self.world.advance(end_s, {CHANNELS[name]: times for name, times in wanted.items()})
        self.now_s = end_s
        for name, times in wanted.items():
            self.sensors[name].record(times, truth[CHANNELS[name]], self.faults.active(name, end_s))

    def stroke(self) -> None:
        """Restart the watchdog's time. Once it has cut the power, it stays cut."""
        self._last_stroke_s = self.now_s

    def command_voltage_v(self, voltage_v: float) -> None:
        """Apply a motor voltage [V], if the motor has power and obeys."""
        if self._obeys("motor"):
            self.world.set_voltage_v(voltage_v)

    def command_magnet(self, on: bool) -> None:
        """Energise the magnet or not, if it has power and obeys."""
        if self._obeys("magnet"):
            self.world.set_magnet(on)

    def _obeys(self, actuator: str) -> bool:
        return not self.watchdog_expired and self.faults.active(actuator, self.now_s) is None

    def _drop_power_of_silent_actuators(self) -> None:
        if self.faults.active("motor", self.now_s) == "silent":
            self.world.set_voltage_v(0.0)
        if self.faults.active("magnet", self.now_s) == "silent":
            self.world.set_magnet(False)
