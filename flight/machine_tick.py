"""One tick's work: the machine as it changes, the events that come of it, and voltages for a speed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from flight import tensioning
from flight.monitors import Fault
from flight.settings import FlightSettings
from flight.states import TRANSITIONS, Event, Machine, Phase, Snapshot
from hal.readings import GroundCommand


class Tick:
    """The work of one tick: the machine as it changes, and the events that come of it."""

    def __init__(self, machine: Machine, snap: Snapshot, settings: FlightSettings) -> None:
        self.machine = machine
        self.snap = snap
        self.settings = settings
        self.events: list[Event] = []

    @property
    def in_phase_s(self) -> float:
        return self.snap.time_s - self.machine.since_s

    def say(self, name: str, severity: str = "info", **details: Any) -> None:
        self.events.append(Event(name, severity, details))

    def go(self, phase: Phase, **changes: Any) -> None:
        """Enter another phase; one that must not follow the present one is a programming error."""
        if phase not in TRANSITIONS[self.machine.phase]:
            raise RuntimeError(f"no way from {self.machine.phase} to {phase}")
        now_s = self.snap.time_s
        self.machine = replace(self.machine, phase=phase, since_s=now_s, moved_s=now_s, **changes)

    def fail(self, fault: Fault) -> None:
        """Answer a fault: relax a loaded spring under control if the drive can be trusted, else stop."""
        trusted = self.machine.drive_trusted and fault.drive_trusted
        self.say("fault", "fault", reason=fault.reason, phase=str(self.machine.phase), drive_trusted=trusted)
        relaxing = self.machine.phase is Phase.DE_TENSION
        reason = self.machine.reason_after(fault.reason)
        relax = self.machine.loaded and trusted and not relaxing
        self.go(Phase.DE_TENSION if relax else Phase.SAFE, reason=reason, drive_trusted=trusted)

    def refuse(self, command: GroundCommand, *why: str) -> None:
        self.say(
            "command_refused", "warning", command=command.name, phase=str(self.machine.phase), why=list(why)
        )

    def drive(self, wanted_m_s: float) -> float:
        """The slew-limited voltage for a nut speed."""
        machine, settings = self.machine, self.settings
        wanted_v = tensioning.drive_voltage_v(
            wanted_m_s, machine.speed_m_s, machine.compression_m, machine.mean_current_a, settings
        )
        return self.slew(wanted_v)

    def hold(self) -> float:
        """The slew-limited voltage that keeps the nut where it is."""
        return self.slew(tensioning.hold_voltage_v(self.machine.compression_m, self.settings))

    def slew(self, wanted_v: float) -> float:
        tick = self.settings.tick
        return tensioning.slew_limited_v(wanted_v, self.machine.voltage_v, tick.period_s, self.settings.drive)

    def homeward_m_s(self) -> float:
        """Nut speed towards home, slower when home is near."""
        drive, home_m = self.settings.drive, self.machine.home_m
        if home_m is None:
            return -drive.homing_speed_m_s
        allowed = drive.approach_rate_1_s * (self.snap.nut_position_m - home_m)
        return -min(drive.homing_speed_m_s, max(drive.latch_check_speed_m_s, allowed))
