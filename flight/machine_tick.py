"""One tick's work: the machine as it changes, the events that come of it, and voltages for a speed."""

from __future__ import annotations

from typing import Any

from flight import tensioning
from flight.monitor_settings import Response
from flight.monitors import Fault
from flight.settings import FlightSettings
from flight.states import TRANSITIONS, Event, Machine, Phase, Snapshot, changed
from hal.readings import GroundCommand


class Tick:
    """The work of one tick: the machine as it changes, and the events that come of it."""

    def __init__(
        self, machine: Machine, snap: Snapshot, settings: FlightSettings, dead: tuple[str, ...] = ()
    ) -> None:
        """`dead`: the monitors that could not measure at this tick."""
        self.machine = machine
        self.snap = snap
        self.settings = settings
        self.dead = dead
        self.events: list[Event] = []

    @property
    def in_phase_s(self) -> float:
        return self.snap.time_s - self.machine.since_s

    def say(self, name: str, **details: Any) -> None:
        self.events.append(Event(name, details))

    def go(self, phase: Phase, **changes: Any) -> None:
        """Enter another phase; one that must not follow the present one is a programming error."""
        if phase not in TRANSITIONS[self.machine.phase]:
            raise RuntimeError(f"no way from {self.machine.phase} to {phase}")
        now_s = self.snap.time_s
        self.machine = self.machine._replace(phase=phase, since_s=now_s, moved_s=now_s, **changes)

    def fail(self, fault: Fault) -> None:
        """Answer a fault as the table says; what cannot be done any more gives way to what can."""
        response = self._response(fault)
        if response is Response.RETRY:
            self.say("retry", reason=fault.reason, count=self.machine.retries + 1)
            self.go(Phase.HOMING, retries=self.machine.retries + 1)
            return
        trusted = self.machine.drive_trusted and response is not Response.POWER_OFF
        self.say("fault", reason=fault.reason, phase=str(self.machine.phase), drive_trusted=trusted)
        reason = self.machine.reason_after(fault.reason)
        self.go(self._refuge(response, trusted), reason=reason, drive_trusted=trusted)

    def _response(self, fault: Fault) -> Response:
        rule = self.settings.monitors[fault.monitor]
        spent = self.machine.retries >= rule.retries or self.machine.phase is not Phase.LATCH_CHECK
        return Response(rule.then if rule.response == Response.RETRY and spent else rule.response)

    def _refuge(self, response: Response, trusted: bool) -> Phase:
        """Where a fault leads: a loaded spring is held or relaxed while the drive can be trusted."""
        if not (self.machine.loaded and trusted) or self.machine.phase is Phase.DE_TENSION:
            return Phase.SAFE
        holding = response is Response.SAFE_HOLD and self.machine.phase is not Phase.SAFE_HOLD
        return Phase.SAFE_HOLD if holding else Phase.DE_TENSION

    def refuse(self, command: GroundCommand, *why: str) -> None:
        self.say(
            "command_refused",
            command=command.name,
            phase=str(self.machine.phase),
            why=list(why),
            sequence=command.sequence,
        )

    def drive(self, wanted_m_s: float) -> float:
        """The slew-limited voltage for a nut speed."""
        machine, settings = self.machine, self.settings
        self._want(wanted_m_s)
        wanted_v = tensioning.drive_voltage_v(
            wanted_m_s, machine.speed_m_s, machine.compression_m, machine.mean_current_a, settings
        )
        return self.slew(wanted_v)

    def hold(self) -> float:
        """The slew-limited voltage that keeps the nut where it is."""
        self._want(0.0)
        return self.slew(tensioning.hold_voltage_v(self.machine.compression_m, self.settings))

    def stop(self) -> float:
        """The slew-limited voltage on the way to none."""
        self._want(0.0)
        return self.slew(0.0)

    def _want(self, wanted_m_s: float) -> None:
        if wanted_m_s != self.machine.wanted_m_s:
            self.machine = changed(self.machine, wanted_m_s=wanted_m_s)

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
