"""What the ground is told of the robot several times a second: one value for each channel of the dictionary."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from flight.settings import FlightSettings
from flight.states import Machine, Outputs, Snapshot
from flight.tensioning import energy_used_j, string_force_n


@dataclass
class Telemetry:
    """Gathers what happens between two messages, so that a hop's shock is not lost between them."""

    _told_s: float | None = None
    _low_m_s2: float = float("inf")
    _high_m_s2: float = float("-inf")

    def take(self, snap: Snapshot) -> None:
        """Remember the extremes of the accelerometer's newest batch."""
        if snap.specific_force_low_m_s2 < self._low_m_s2:
            self._low_m_s2 = snap.specific_force_low_m_s2
        if snap.specific_force_high_m_s2 > self._high_m_s2:
            self._high_m_s2 = snap.specific_force_high_m_s2

    def due(self, now_s: float, period_s: float) -> bool:
        """Whether it is time for a message; if so, the next one counts from now."""
        due = self._told_s is None or now_s - self._told_s >= period_s
        if due:
            self._told_s = now_s
        return due

    def message(
        self, machine: Machine, snap: Snapshot, outputs: Outputs, settings: FlightSettings
    ) -> dict[str, Any]:
        """Time, phase and hop, and each channel by its name in the dictionary; extremes start anew."""
        compression_m = max(machine.compression_m, 0.0)
        message = {
            "time_s": snap.time_s,
            "phase": str(machine.phase),
            "hop_index": machine.hop_index,
            "outputs.voltage_v": outputs.voltage_v,
            "outputs.magnet_on": outputs.magnet_on,
            "outputs.compression_m": machine.compression_m,
            "outputs.speed_m_s": machine.speed_m_s,
            "outputs.loaded": machine.loaded,
            "outputs.beyond": len(machine.beyond_ticks),
            "outputs.energy_used_j": energy_used_j(compression_m, settings.rig),
            "outputs.string_force_n": string_force_n(compression_m, settings.rig),
            "outputs.winding_rise_k": machine.winding_rise_k,
            "motor_current.current_a": snap.motor_current_a,
            "motor_current.supply_v": snap.supply_v,
            "nut_encoder.position_m": snap.nut_position_m,
            "switches.at_home": snap.at_home,
            "switches.latch_closed": snap.latch_closed,
            "spring.compression_m": snap.compression_m,
            "magnet_current.current_a": snap.magnet_current_a,
            "accelerometer.specific_force_m_s2": snap.specific_force_m_s2,
            "accelerometer.lowest_m_s2": self._low_m_s2,
            "accelerometer.highest_m_s2": self._high_m_s2,
        }
        self._low_m_s2, self._high_m_s2 = float("inf"), float("-inf")
        return message
