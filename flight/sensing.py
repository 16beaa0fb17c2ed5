"""Reads every sensor once a tick and keeps the newest value of each with its time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar

from flight.record import HopRecorder
from flight.states import Event, Snapshot, changed
from hal.board import Board
from hal.errors import ReadFailed

T = TypeVar("T")


@dataclass
class Senses:
    """The newest readings. A sensor whose read fails keeps its old value *and its old time*: it ages."""

    board: Board
    recorder: HopRecorder
    latest: Snapshot = field(default_factory=lambda: Snapshot(0.0))
    _failing: set[str] = field(default_factory=set)
    _failed: int = 0

    def snapshot(self, now_s: float, late_s: float, **known: Any) -> tuple[Snapshot, list[Event]]:
        """Read all sensors; returns what is known, and an event for each that fails or recovers.

        `known` are the fields of `Snapshot` that no sensor tells.
        """
        events: list[Event] = []
        board, sampled = self.board, dict(self.latest.sampled_s)
        self._failed = 0
        motor = self._try("motor_current", board.motor_current.read, events)
        if motor is not None:
            known["motor_current_a"], sampled["motor_current"] = motor.current_a, motor.time_s
            known["supply_v"] = motor.supply_v
        nut = self._try("nut_encoder", board.nut_encoder.read, events)
        if nut is not None:
            known["nut_position_m"], sampled["nut_encoder"] = nut.position_m, nut.time_s
        switches = self._try("switches", board.switches.read, events)
        if switches is not None:
            known["at_home"], known["latch_closed"] = switches.at_home, switches.latch_closed
            sampled["switches"] = switches.time_s
        spring = self._try("spring", board.spring.read, events)
        if spring is not None and spring.times_s:
            known["compression_m"], sampled["spring"] = spring.compression_m[-1], spring.times_s[-1]
        magnet = self._try("magnet_current", board.magnet_current.read, events)
        if magnet is not None and magnet.times_s:
            known["magnet_current_a"], sampled["magnet_current"] = magnet.current_a[-1], magnet.times_s[-1]
        force = self._try("accelerometer", board.accelerometer.read, events)
        if force is not None and force.times_s:
            newest = force.specific_force_m_s2
            known["specific_force_m_s2"], sampled["accelerometer"] = newest[-1], force.times_s[-1]
            known["specific_force_low_m_s2"], known["specific_force_high_m_s2"] = min(newest), max(newest)
        self.recorder.add(force, spring, magnet, now_s)
        known |= {"sampled_s": sampled, "failed_reads": self._failed}
        self.latest = changed(self.latest, time_s=now_s, tick_late_s=late_s, **known)
        return self.latest, events

    def _try(self, name: str, read: Callable[[], T], events: list[Event]) -> T | None:
        try:
            reading = read()
        except ReadFailed as error:
            self._failed += 1
            if name not in self._failing:
                events.append(Event("read_failed", {"sensor": name, "error": str(error)}))
            self._failing.add(name)
            return None
        if name in self._failing:
            self._failing.discard(name)
            events.append(Event("read_recovered", {"sensor": name}))
        return reading
