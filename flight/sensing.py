"""Reads every sensor once a tick and keeps the newest value of each with its time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from flight.record import HopRecorder
from flight.states import NEVER, SENSORS, Event, Snapshot
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


class Senses:
    """The newest readings. A sensor whose read fails keeps its old value *and its old time*: it ages."""

    def __init__(self, board: Board, recorder: HopRecorder) -> None:
        self._recorder = recorder
        self._reads: list[tuple[str, Callable[[], Any]]] = [
            (name, getattr(board, name).read) for name in SENSORS
        ]
        self._motor, self._nut = MotorCurrent(NEVER, 0.0), NutPosition(NEVER, 0.0)
        self._switches = Switches(NEVER, False, False)
        self._spring = SpringCompression(
            (NEVER,), (0.0,)
        )  # of the streamed sensors the last batch with samples
        self._magnet = MagnetCurrent((NEVER,), (0.0,))
        self._force = SpecificForce((NEVER,), (0.0,))
        self._failing: set[str] = set()

    def snapshot(
        self,
        now_s: float,
        late_s: float,
        *,
        unstroked_share: float = 0.0,
        magnet_failed: bool = False,
        log_failed: bool = False,
        memory_failed: bool = False,
        ground_heard: bool = False,
    ) -> tuple[Snapshot, list[Event]]:
        """Read all sensors; returns what is known, and an event for each that fails or recovers.

        The arguments are the fields of `Snapshot` that no sensor tells.
        """
        new, failed, events = self._read()
        new_motor, new_nut, new_switches, new_spring, new_magnet, new_force = new
        self._motor = motor = new_motor or self._motor
        self._nut = nut = new_nut or self._nut
        self._switches = switches = new_switches or self._switches
        self._recorder.add(new_force, new_spring, new_magnet, now_s)
        self._spring = spring = new_spring if new_spring and new_spring.times_s else self._spring
        self._magnet = magnet = new_magnet if new_magnet and new_magnet.times_s else self._magnet
        self._force = force = new_force if new_force and new_force.times_s else self._force
        sampled_s = {
            "motor_current": motor.time_s,
            "nut_encoder": nut.time_s,
            "switches": switches.time_s,
            "spring": spring.times_s[-1],
            "magnet_current": magnet.times_s[-1],
            "accelerometer": force.times_s[-1],
        }
        forces_m_s2 = force.specific_force_m_s2
        snap = Snapshot(  # in the order of its fields: by their names it takes three times as long
            now_s,
            motor.current_a,
            nut.position_m,
            switches.at_home,
            switches.latch_closed,
            spring.compression_m[-1],
            magnet.current_a[-1],
            forces_m_s2[-1],
            min(forces_m_s2),
            max(forces_m_s2),
            sampled_s,
            late_s,
            unstroked_share,
            magnet_failed,
            log_failed,
            memory_failed,
            motor.supply_v,
            failed,
            ground_heard,
        )
        return snap, events

    def _read(self) -> tuple[list[Any], int, list[Event]]:
        """The new readings in the order of `SENSORS`, None where a read failed; how many did, and what to tell."""
        readings: list[Any] = []
        failing, failed, events = self._failing, 0, []
        for name, read in self._reads:
            try:
                readings.append(read())
            except ReadFailed as error:
                failed += 1
                if name not in failing:
                    events.append(Event("read_failed", {"sensor": name, "error": str(error)}))
                failing.add(name)
                readings.append(None)
            else:
                if failing and name in failing:
                    failing.discard(name)
                    events.append(Event("read_recovered", {"sensor": name}))
        return readings, failed, events
