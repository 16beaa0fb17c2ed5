"""The hop state machine: a pure function from (machine, snapshot, commands) to (machine, outputs, events).

It holds no clock, no device and no randomness. The magnet is on in FIRING and nowhere else; FIRING is entered
only from ARMED by a `fire` command that every interlock lets pass; any fault leads to SAFE with its name, by
way of DE_TENSION when the spring is loaded and the drive can be trusted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from flight import tensioning
from flight.monitors import Fault, find_fault, firing_interlocks, self_test_failures
from flight.settings import FlightSettings
from flight.states import TRANSITIONS, Event, LineFit, Machine, Outputs, Phase, Snapshot, Step, Target
from hal.readings import GroundCommand


def step(
    machine: Machine, snap: Snapshot, commands: Sequence[GroundCommand], settings: FlightSettings
) -> Step:
    """One tick: observe, look for faults, obey commands, act by phase. Pure."""
    tick = _Tick(_observe(machine, snap, settings), snap, settings)
    fault = None if machine.phase is Phase.SAFE else find_fault(tick.machine, snap, settings)
    if fault is not None:
        tick.fail(fault)
    for command in commands:
        tick.obey(command)
    outputs = _ACTIONS[tick.machine.phase](tick)
    # An action may have changed the phase: what the new phase forbids must not last until the next tick.
    if tick.machine.phase is not Phase.FIRING:
        outputs = replace(outputs, magnet_on=False)
    if tick.machine.phase is Phase.SAFE:
        outputs = Outputs()
    after = replace(tick.machine, voltage_v=outputs.voltage_v)
    return Step(after, outputs, tuple(tick.events))


def _observe(machine: Machine, snap: Snapshot, settings: FlightSettings) -> Machine:
    """Update what is estimated from the readings: speed, compression, load, and the monitors' counters."""
    safety, first = settings.safety, machine.last_s is None
    elapsed_s = settings.tick.period_s if machine.last_s is None else snap.time_s - machine.last_s
    travel_m = 0.0 if machine.position_m is None else snap.nut_position_m - machine.position_m
    speed_m_s = travel_m / elapsed_s if elapsed_s > 0.0 else 0.0
    compression_m = snap.compression_m
    if not first:
        taut = machine.compression_m > safety.unloaded_compression_m
        fresh = snap.age_s("spring") <= safety.sensor_age_s
        predicted_m = tensioning.fused_compression_m(
            machine.compression_m, snap.compression_m, travel_m, taut, settings
        )
        # Without a fresh spring reading the encoder alone carries the estimate.
        carried_m = machine.compression_m + (travel_m / settings.rig.travel_per_compression if taut else 0.0)
        compression_m = predicted_m if fresh else carried_m
    followed = abs(speed_m_s) >= safety.stall_speed_m_s
    steady = abs(speed_m_s) < safety.stable_speed_m_s
    over = abs(snap.motor_current_a) > safety.over_current_a
    relaxed = snap.at_home and abs(snap.compression_m) < safety.unloaded_compression_m
    relaxed = relaxed and snap.age_s("spring") <= safety.sensor_age_s
    unloaded_ticks = machine.unloaded_ticks + 1 if relaxed else 0
    above = compression_m > safety.unloaded_compression_m and snap.latch_closed
    smoothing = settings.drive.current_smoothing
    return replace(
        machine,
        position_m=snap.nut_position_m,
        last_s=snap.time_s,
        speed_m_s=speed_m_s,
        compression_m=compression_m,
        moved_s=snap.time_s if followed or first else machine.moved_s,
        stable_ticks=machine.stable_ticks + 1 if steady else 0,
        over_current_ticks=machine.over_current_ticks + 1 if over else 0,
        unloaded_ticks=unloaded_ticks,
        loaded=above or (machine.loaded and unloaded_ticks < safety.stable_ticks),
        mean_current_a=machine.mean_current_a
        + smoothing * (max(snap.motor_current_a, 0.0) - machine.mean_current_a),
    )


class _Tick:
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
        reason = self.machine.reason or fault.reason
        relax = self.machine.loaded and trusted and not relaxing
        self.go(Phase.DE_TENSION if relax else Phase.SAFE, reason=reason, drive_trusted=trusted)

    def refuse(self, command: GroundCommand, *why: str) -> None:
        self.say(
            "command_refused", "warning", command=command.name, phase=str(self.machine.phase), why=list(why)
        )

    def obey(self, command: GroundCommand) -> None:
        """Carry out one command, or refuse it in words."""
        handler = _COMMANDS.get(command.name)
        if handler is None:
            self.refuse(command, "unknown command")
        elif self.machine.phase not in _ACCEPTED_IN[command.name]:
            self.refuse(command, f"not accepted in {self.machine.phase}")
        else:
            handler(self, command)

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


def _power_up(tick: _Tick) -> Outputs:
    tick.go(Phase.SELF_TEST)
    return Outputs()


def _self_test(tick: _Tick) -> Outputs:
    failures = self_test_failures(tick.snap, tick.settings)
    if failures:
        if tick.in_phase_s > tick.settings.timeouts.self_test_s:
            tick.fail(Fault(f"self_test_{failures[0]}", drive_trusted=False))
    elif tick.machine.compression_m > tick.settings.safety.unloaded_compression_m:
        tick.say("loaded_at_power_up", "warning", compression_m=tick.machine.compression_m)
        tick.go(Phase.DE_TENSION)
    else:
        tick.go(Phase.HOMING)
    return Outputs()


def _homing(tick: _Tick) -> Outputs:
    if not tick.snap.at_home:
        return Outputs(tick.drive(tick.homeward_m_s()))
    tick.machine = replace(tick.machine, moved_s=tick.snap.time_s)  # at rest on purpose: no stall
    if not tick.machine.loaded:
        tick.go(Phase.LATCH_CHECK, home_m=tick.snap.nut_position_m, taut_m=None, latch_line=LineFit())
    return Outputs(tick.slew(0.0))


def _latch_check(tick: _Tick) -> Outputs:
    """Drive up a little: the spring must follow the nut, or the lock does not hold the string."""
    machine, snap, safety = tick.machine, tick.snap, tick.settings.safety
    if not snap.latch_closed:  # it snaps in when the nut comes home; give it until the phase's timeout
        tick.machine = replace(machine, moved_s=snap.time_s)
        return Outputs(tick.slew(0.0))
    travel_m = snap.nut_position_m - (machine.home_m or 0.0)
    if machine.compression_m < safety.latch_check_start_m:
        if travel_m > safety.max_slack_m:
            tick.fail(Fault("latch_does_not_hold"))
        return Outputs(tick.drive(tick.settings.drive.latch_check_speed_m_s))
    line = machine.latch_line.add(travel_m, snap.compression_m)
    tick.machine = replace(machine, latch_line=line)
    if machine.compression_m < safety.latch_check_compression_m:
        if travel_m > safety.max_slack_m + safety.latch_check_compression_m * 2.0:
            tick.fail(Fault("latch_does_not_hold"))
        return Outputs(tick.drive(tick.settings.drive.latch_check_speed_m_s))
    return _judge_latch(tick, line)


def _judge_latch(tick: _Tick, line: LineFit) -> Outputs:
    expected = 1.0 / tick.settings.rig.travel_per_compression
    if abs(line.slope / expected - 1.0) > tick.settings.safety.latch_check_slope_tolerance:
        tick.say("latch_slope", "warning", slope=line.slope, expected=expected)
        tick.fail(Fault("latch_does_not_hold"))
        return Outputs()
    taut_m = (tick.machine.home_m or 0.0) + line.crossing(expected)
    tick.say("string_taut_found", position_m=taut_m, slope=line.slope)
    tick.go(Phase.READY, taut_m=taut_m)
    return Outputs(tick.hold())


def _ready(tick: _Tick) -> Outputs:
    return Outputs(tick.hold())


def _tensioning(tick: _Tick) -> Outputs:
    machine, settings = tick.machine, tick.settings
    assert machine.target is not None
    wanted_m = machine.target.compression_m
    remaining_m = (wanted_m - machine.compression_m) * settings.rig.travel_per_compression
    # A tenth of the tolerance is where it stops: energy goes with compression squared at most.
    if remaining_m > 0.1 * settings.tension.tolerance * wanted_m:
        speed_m_s = tensioning.approach_speed_m_s(remaining_m, settings.drive)
        return Outputs(tick.drive(speed_m_s))
    tick.machine = replace(tick.machine, moved_s=tick.snap.time_s)  # at rest on purpose: no stall
    settled = machine.stable_ticks * settings.tick.period_s >= settings.tension.settle_s
    if settled:
        _enter_hold(tick)
    return Outputs(tick.hold())


def _enter_hold(tick: _Tick) -> None:
    target = tick.machine.target
    assert target is not None
    stored_j = tensioning.energy_used_j(tick.machine.compression_m, tick.settings.rig)
    if stored_j > target.energy_used_j * (1.0 + tick.settings.tension.tolerance):
        tick.fail(Fault("tension_overshoot"))
        return
    tick.say("tension_reached", energy_used_j=stored_j, compression_m=tick.machine.compression_m)
    tick.go(Phase.HOLD)


def _hold(tick: _Tick) -> Outputs:
    return Outputs(tick.hold())


def _armed(tick: _Tick) -> Outputs:
    if tick.in_phase_s > tick.settings.timeouts.arm_window_s:
        tick.say("arm_expired", "warning")
        tick.go(Phase.HOLD)
    return Outputs(tick.hold(), spring_hop_rate=True)


def _firing(tick: _Tick) -> Outputs:
    """Magnet on until the spring has let go, or the time for it is over."""
    machine, snap = tick.machine, tick.snap
    assert machine.target is not None
    if machine.fire_s is None:
        tick.machine = replace(machine, fire_s=snap.time_s)
        return Outputs(tick.hold(), magnet_on=True, spring_hop_rate=True)
    if snap.compression_m < 0.5 * machine.target.compression_m:
        tick.say("released", compression_m=snap.compression_m)
        tick.go(Phase.FLIGHT, loaded=False, quiet_s=None)
        return Outputs(spring_hop_rate=True)
    if tick.in_phase_s > tick.settings.timeouts.release_s:
        tick.fail(Fault("misfire"))
    return Outputs(tick.hold(), magnet_on=True, spring_hop_rate=True)


def _flight(tick: _Tick) -> Outputs:
    """Wait until the robot stands still again. When it touched down is for the evaluation to say."""
    snap, settings = tick.snap, tick.settings
    rest_m_s2, allowed = settings.rig.static_reading_m_s2, settings.safety.standing_tolerance_m_s2
    still = (
        abs(snap.specific_force_high_m_s2 - rest_m_s2) < allowed
        and abs(snap.specific_force_low_m_s2 - rest_m_s2) < allowed
        and tick.in_phase_s > settings.timeouts.flight_min_s
    )
    quiet_s = tick.machine.quiet_s if tick.machine.quiet_s is not None else snap.time_s
    tick.machine = replace(tick.machine, quiet_s=quiet_s if still else None)
    if still and snap.time_s - quiet_s > settings.timeouts.landing_quiet_s:
        tick.go(Phase.LANDED)
    return Outputs(spring_hop_rate=True)


def _landed(tick: _Tick) -> Outputs:
    if abs(tick.snap.compression_m) > tick.settings.safety.unloaded_compression_m:
        tick.machine = replace(tick.machine, loaded=True)
        tick.fail(Fault("spring_not_relaxed_by_hop"))
        return Outputs()
    tick.go(Phase.EVALUATE)
    return Outputs(evaluate=True)


def _evaluate(tick: _Tick) -> Outputs:
    tick.go(Phase.HOMING, hop_index=tick.machine.hop_index + 1, target=None, fire_s=None, taut_m=None)
    return Outputs()


def _de_tension(tick: _Tick) -> Outputs:
    """Drive the nut home at a controlled speed; the home switch, not a guess, says when it is done."""
    machine, snap, safety = tick.machine, tick.snap, tick.settings.safety
    if not snap.at_home:
        return Outputs(tick.drive(tick.homeward_m_s()))
    tick.machine = machine = replace(machine, moved_s=snap.time_s)
    spring_known = snap.age_s("spring") <= safety.sensor_age_s
    if not machine.loaded:
        if machine.reason:
            tick.go(Phase.SAFE)
        else:
            fresh = LineFit()
            tick.go(Phase.LATCH_CHECK, home_m=snap.nut_position_m, taut_m=None, target=None, latch_line=fresh)
    elif not spring_known:
        tick.say("spring_state_unknown", "warning")
        tick.go(Phase.SAFE)
    elif snap.compression_m > 2.0 * safety.unloaded_compression_m:
        tick.go(Phase.SAFE, reason=machine.reason or "spring_loaded_at_home")
    return Outputs(tick.slew(0.0))


def _safe(tick: _Tick) -> Outputs:
    return Outputs()


_ACTIONS: dict[Phase, Callable[[_Tick], Outputs]] = {
    Phase.POWER_UP: _power_up,
    Phase.SELF_TEST: _self_test,
    Phase.HOMING: _homing,
    Phase.LATCH_CHECK: _latch_check,
    Phase.READY: _ready,
    Phase.TENSIONING: _tensioning,
    Phase.HOLD: _hold,
    Phase.ARMED: _armed,
    Phase.FIRING: _firing,
    Phase.FLIGHT: _flight,
    Phase.LANDED: _landed,
    Phase.EVALUATE: _evaluate,
    Phase.DE_TENSION: _de_tension,
    Phase.SAFE: _safe,
}


def _obey_tension(tick: _Tick, command: GroundCommand) -> None:
    """`tension energy_j=E`: store the usable energy E."""
    arguments, limits = dict(command.arguments), tick.settings.tension
    energy_j = arguments.get("energy_j")
    if set(arguments) != {"energy_j"} or energy_j is None:
        tick.refuse(command, "needs the argument energy_j and no other")
    elif not limits.min_energy_j <= energy_j <= limits.max_energy_j:  # also refuses NaN
        tick.refuse(
            command, f"energy_j = {energy_j!r} is outside [{limits.min_energy_j:g}, {limits.max_energy_j:g}]"
        )
    else:
        compression_m = tensioning.compression_for_energy_m(energy_j, tick.settings.rig)
        tick.go(Phase.TENSIONING, target=Target(energy_j, compression_m), loaded=True)


def _obey_arm(tick: _Tick, command: GroundCommand) -> None:
    forbidding = firing_interlocks(tick.machine, tick.snap, tick.settings)
    if forbidding:
        tick.refuse(command, *forbidding)
    else:
        tick.go(Phase.ARMED)


def _obey_fire(tick: _Tick, command: GroundCommand) -> None:
    timeouts = tick.settings.timeouts
    if not timeouts.arm_min_s <= tick.in_phase_s <= timeouts.arm_window_s:
        tick.refuse(command, "outside the window after arm")
        return
    forbidding = firing_interlocks(tick.machine, tick.snap, tick.settings)
    if forbidding:
        tick.refuse(command, *forbidding)
    else:
        tick.go(Phase.FIRING, fire_s=None)


def _obey_de_tension(tick: _Tick, command: GroundCommand) -> None:
    tick.go(Phase.DE_TENSION)


def _obey_stow(tick: _Tick, command: GroundCommand) -> None:
    """End in SAFE, nut home, nothing stored. This is no fault."""
    tick.go(Phase.DE_TENSION, reason="stowed")


def _obey_abort(tick: _Tick, command: GroundCommand) -> None:
    if tick.machine.phase is Phase.DE_TENSION:  # already on the way to where an abort leads
        tick.machine = replace(tick.machine, reason=tick.machine.reason or "abort")
    else:
        tick.fail(Fault("abort"))


_COMMANDS: dict[str, Callable[[_Tick, GroundCommand], None]] = {
    "tension": _obey_tension,
    "arm": _obey_arm,
    "fire": _obey_fire,
    "de_tension": _obey_de_tension,
    "stow": _obey_stow,
    "abort": _obey_abort,
}

_STANDING = frozenset({Phase.READY, Phase.TENSIONING, Phase.HOLD, Phase.ARMED})

_ACCEPTED_IN: dict[str, frozenset[Phase]] = {
    "tension": frozenset({Phase.READY}),
    "arm": frozenset({Phase.HOLD}),
    "fire": frozenset({Phase.ARMED}),
    "de_tension": _STANDING,
    "stow": _STANDING | {Phase.HOMING},
    "abort": frozenset(Phase) - {Phase.SAFE},
}

COMMAND_NAMES = tuple(_COMMANDS)
