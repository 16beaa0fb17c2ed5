"""The executive: one fixed-rate tick of read, decide, command, record, until the machine is in SAFE."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from flight import hop_machine
from flight.commands import SET_PARAMETER
from flight.heartbeat import Heartbeat
from flight.mission import HopReport, MissionPilot, MissionPlan, MissionResult
from flight.parameter_command import changed
from flight.record import HopRecorder
from flight.sensing import Senses
from flight.settings import FlightSettings
from flight.spring_record import SpringKeeper
from flight.states import Event, Machine, Outputs, Phase, Snapshot
from flight.surface.keeper import GroundKeeper
from flight.surface.known import SurfaceSettings, load_surfaces
from flight.telemetry import Telemetry
from flight.tensioning import energy_used_j
from hal.board import Board
from hal.errors import DeviceError
from hal.log import LogSink, log_problem, tick_end_of
from hal.readings import GroundCommand


@dataclass(frozen=True, slots=True)
class Progress:
    """What a watcher is told once a tick."""

    time_s: float
    phase: Phase
    hop_index: int
    energy_used_j: float


Watcher = Callable[[Progress], None]

MOTOR_FAILED = "motor_command_failed"
ACKNOWLEDGEMENTS = ("command_accepted", "command_refused", "parameter_set")


class MotorFailed(Exception):
    """The motor did not take a command: nothing can be relaxed under control any more."""


def fly(
    board: Board,
    settings: FlightSettings,
    mission: MissionPlan,
    log: LogSink,
    watch: Watcher | None = None,
    *,
    surfaces: SurfaceSettings | None = None,
    stay_s: float = 0.0,
    kept_reports: int | None = None,
) -> MissionResult:
    """Fly the mission from power-up to SAFE and return what came of it.

    `stay_s` is how long it stays in SAFE, listening for the ground's `reset`, before it ends. `kept_reports`: of how
    many hops, the newest, the reports are kept for the result, so that a long mission does not fill the memory; all
    without it. The log has them all.

    `surfaces` are the known surfaces, those of `config/surfaces.yaml` unless given (raises `ConfigError` when
    that file is refused).
    Whatever happens, motor and magnet are told to be off when this returns or raises, and the watchdog, no
    longer stroked, cuts their power. An unexpected exception, of a device or of the software, ends the mission
    in SAFE with the reason `exception:TYPE`, and is logged; a motor that does not take a command ends it as
    `motor_command_failed`.
    """
    pilot = MissionPilot(mission, settings, surfaces or load_surfaces(), kept_reports)
    executive = _Executive(board, settings, pilot, log)
    try:
        while not executive.ended(stay_s):
            executive.tick()
            if watch is not None:
                watch(executive.progress())
    except Exception as error:
        executive.fail(error)
    finally:
        executive.outputs_off()
    return executive.pilot.result(executive.machine)


@dataclass
class _Executive:
    board: Board
    settings: FlightSettings
    pilot: MissionPilot
    log: LogSink
    machine: Machine = field(default_factory=Machine)
    recorder: HopRecorder = field(default_factory=HopRecorder)
    _senses: Senses = field(init=False)
    _spring: SpringKeeper = field(init=False)
    _ground: GroundKeeper = field(init=False)
    _due_s: float | None = None
    _stroked_s: float | None = None
    _motor_most_v: float = 0.0  # what the devices say of themselves, asked at the start
    _watchdog_timeout_s: float = math.inf
    _hop_rate: bool | None = None
    _magnet_on: bool | None = False  # None: it did not take its newest command
    _now_s: float = 0.0
    _telemetry: Telemetry = field(default_factory=Telemetry)
    _tell_log: Callable[[], None] = field(init=False)

    def __post_init__(self) -> None:
        self._tell_log = tick_end_of(self.log)
        self.recorder.rest()
        self._senses = Senses(self.board, self.recorder)
        self._spring = SpringKeeper(self.board.memory)
        self._ground = GroundKeeper(self.board.ground_memory, self.pilot.surfaces, self.settings.surface)

    def ended(self, stay_s: float) -> bool:
        """Whether it is over: in SAFE, and nobody has let it out for so long."""
        machine = self.machine
        return machine.phase is Phase.SAFE and self._now_s - machine.since_s >= stay_s

    def tick(self) -> None:
        """One tick. The watchdog is stroked last: only a tick that went through keeps the power on."""
        self._now_s = now_s = self.board.clock.now_s()
        if self._due_s is None:
            self._start(now_s)
        late_s = now_s - (self._due_s or now_s)
        heard = self.board.ground_link.receive()
        snap, events = self._snapshot(now_s, late_s, ground_heard=bool(heard))
        self._telemetry.take(snap)
        if late_s > self.settings.tick.overrun_share * self.settings.tick.period_s:
            events.append(Event("tick_late", {"late_s": late_s}))
        told = self._take_parameters(heard, events) if heard else ()
        commands = told + self.pilot.commands(self.machine, now_s)
        before = self.machine
        answer = hop_machine.step(before, snap, commands, self.settings)
        self.machine = answer.machine
        unkept = self._spring.keep(self.machine)  # on record first, then done
        events += [unkept] if unkept else []
        self._apply(answer.outputs._replace(magnet_on=False) if self._spring.failed else answer.outputs)
        self._tell(before, snap, (*events, *answer.events), answer.outputs)
        if self.machine.phase is Phase.ARMED and before.phase is not Phase.ARMED:
            self.recorder.clear()
        elif self.machine.phase is Phase.FIRING and before.phase is not Phase.FIRING:
            self.recorder.hold()
        done_s = now_s
        if answer.outputs.evaluate:
            self._evaluate()
            done_s = self.board.clock.now_s()  # it may take longer than a tick, and keeps the watchdog up
        if answer.monitors_alive:
            self._stroke()
            self._stroked_s = done_s
        self._wait(done_s)

    def progress(self) -> Progress:
        energy_j = energy_used_j(max(self.machine.compression_m, 0.0), self.settings.rig)
        return Progress(self._now_s, self.machine.phase, self.machine.hop_index, energy_j)

    def fail(self, error: Exception) -> None:
        """Name the exception, and end in SAFE."""
        self.outputs_off()
        reason = MOTOR_FAILED if isinstance(error, MotorFailed) else f"exception:{type(error).__name__}"
        before, named = self.machine.phase, self.machine.reason_after(reason)
        self.machine = self.machine._replace(phase=Phase.SAFE, reason=named)
        with suppress(Exception):  # log or link may be what failed
            self._event(Event("fault", {"reason": reason, "error": str(error)}))
            self._state(before, Phase.SAFE, reason)

    def outputs_off(self) -> None:
        """Magnet, then motor; each is tried even if the other fails, and a failure is logged."""
        for name, switch_off in (
            ("magnet", self.board.magnet.switch_off),
            ("motor", lambda: self.board.motor.set_voltage_v(0.0)),
        ):
            try:
                switch_off()
            except Exception as error:  # the watchdog, no longer stroked, is what is left
                with suppress(Exception):
                    self._event(Event("actuator_failed", {"device": name, "error": str(error)}))

    def _start(self, now_s: float) -> None:
        sensors = self.settings.sensors
        self._motor_most_v = self.board.motor.max_voltage_v
        self._watchdog_timeout_s = self.board.watchdog.timeout_s
        self.board.accelerometer.set_rate_hz(sensors.accelerometer_rate_hz)
        self.board.magnet_current.set_rate_hz(sensors.magnet_current_rate_hz)
        self._due_s = now_s
        self._stroked_s = now_s
        self.machine = self.machine._replace(since_s=now_s, moved_s=now_s)
        self._event(self._spring.found())
        record, found = self._ground.found()
        self._event(found)
        self.pilot.ground.restore(record)
        self.pilot.begin()
        self._tell_ground()

    def _snapshot(self, now_s: float, late_s: float, ground_heard: bool) -> tuple[Snapshot, list[Event]]:
        stroked_s = now_s if self._stroked_s is None else self._stroked_s
        return self._senses.snapshot(
            now_s,
            late_s,
            unstroked_share=(now_s - stroked_s) / self._watchdog_timeout_s,
            magnet_failed=self._magnet_on is None,
            log_failed=bool(log_problem(self.log)),
            memory_failed=self._spring.failed,
            ground_heard=ground_heard,
        )

    def _take_parameters(
        self, commands: tuple[GroundCommand, ...], events: list[Event]
    ) -> tuple[GroundCommand, ...]:
        """Carry out the changes of parameters; the other commands are for the machine."""
        for command in commands:
            if command.name == SET_PARAMETER:
                self.settings, event = changed(self.settings, command, self.machine.phase)
                self.pilot.settings = self.settings
                events.append(event)
        return tuple(command for command in commands if command.name != SET_PARAMETER)

    def _apply(self, outputs: Outputs) -> None:
        if outputs.magnet_on != self._magnet_on:
            self._switch_magnet(outputs.magnet_on)
        most_v = min(self._motor_most_v, self.settings.drive.max_voltage_v)
        try:
            self.board.motor.set_voltage_v(max(-most_v, min(most_v, outputs.voltage_v)))
        except DeviceError as error:
            raise MotorFailed(str(error)) from error
        if outputs.spring_hop_rate != self._hop_rate:
            sensors = self.settings.sensors
            rate_hz = sensors.spring_hop_rate_hz if outputs.spring_hop_rate else sensors.spring_drive_rate_hz
            self.board.spring.set_rate_hz(rate_hz)
            self._hop_rate = outputs.spring_hop_rate

    def _switch_magnet(self, on: bool) -> None:
        """A magnet that fails is told again at the next tick; the machine relaxes the spring meanwhile."""
        try:
            (self.board.magnet.switch_on if on else self.board.magnet.switch_off)()
        except DeviceError as error:
            if self._magnet_on is not None:
                self._event(Event("actuator_failed", {"device": "magnet", "error": str(error)}))
            self._magnet_on = None
        else:
            self._magnet_on = on

    def _stroke(self) -> None:
        """Keep the power on, but only while the drive can be trusted: else the watchdog shall cut it."""
        if self.machine.drive_trusted:
            self.board.watchdog.stroke()

    def _evaluate(self) -> None:
        fire_s = self.machine.fire_s
        assert fire_s is not None
        report = self.pilot.evaluate(self.recorder.record(fire_s), Heartbeat(self._stroke)).as_payload()
        self.recorder.rest()
        self.log.write("hop", self._now_s, report)
        self._send("hop", report)
        unkept = self._ground.keep(self.pilot.ground.record())
        if unkept:
            self._event(unkept)
        self._tell_ground()

    def _tell_ground(self) -> None:
        for event in self.pilot.told():
            self._event(event)

    def _wait(self, now_s: float) -> None:
        """Sleep to the next tick of the grid; ticks that were missed are skipped, not caught up."""
        period_s = self.settings.tick.period_s
        assert self._due_s is not None
        self._due_s += period_s * max(1, 1 + int((now_s - self._due_s) / period_s))
        if self._due_s > now_s + 2.0 * period_s:  # the clock has gone back
            self._due_s = now_s + period_s
        self._tell_log()
        self.board.clock.sleep_until_s(self._due_s)

    def _tell(self, before: Machine, snap: Snapshot, events: tuple[Event, ...], outputs: Outputs) -> None:
        for event in events:
            self._event(event)
        after = self.machine
        if after.phase is not before.phase:
            self._state(before.phase, after.phase, after.reason)
        done = {
            "phase": str(after.phase),
            "voltage_v": outputs.voltage_v,
            "magnet_on": outputs.magnet_on,
            "compression_m": after.compression_m,
            "speed_m_s": after.speed_m_s,
            "loaded": after.loaded,
            "beyond": len(after.beyond_ticks),
        }
        self.log.write("outputs", self._now_s, done)
        if self._telemetry.due(self._now_s, self.settings.tick.telemetry_period_s):
            told = self._telemetry.message(after, snap, outputs, self.settings)
            self.board.ground_link.send("channels", json.dumps(told))

    def _event(self, event: Event) -> None:
        payload: dict[str, Any] = {"name": event.name, "severity": event.severity, **event.details}
        self.log.write("event", self._now_s, payload)
        topic = "acknowledgement" if event.name in ACKNOWLEDGEMENTS else "event"
        self._send(topic, payload)

    def _state(self, old: Phase, new: Phase, reason: str) -> None:
        payload = {"from": str(old), "to": str(new), "reason": reason, "hop_index": self.machine.hop_index}
        self.log.write("state", self._now_s, payload)
        self._send("state", payload)

    def _send(self, topic: str, payload: Mapping[str, Any]) -> None:
        self.board.ground_link.send(topic, json.dumps({"time_s": self._now_s, **payload}))


__all__ = ["HopReport", "Progress", "Watcher", "fly"]
