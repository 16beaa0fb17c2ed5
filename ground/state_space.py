"""Explores the product of the hop state machine with its interlocks, exhaustively.

A state is what the machine remembers that is no number: phase, load, trust, reason, target, fire time, positions
known, retries, monitors beyond their limit. Everything else (times, readings, the nut's rest, how good the latch test
was) is chosen anew at each step from representatives of all cases, so that more can be reached here than on a robot.
From each state the real `step` is taken with every combination of these and of commands, and what it answers is held
to rules that are written here from the inputs alone.
"""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cache

from flight import hop_machine
from flight.settings import FlightSettings
from flight.states import SENSORS, LineFit, Machine, Outputs, Phase, Snapshot, Target
from flight.tensioning import compression_for_energy_m, hold_voltage_v
from hal.readings import GroundCommand

NOW_S = 1000.0
WANTED_J = 15.0
TICKS = 2  # each persistence counts to two here: not yet, and now

COMMANDS: tuple[tuple[str, ...], ...] = (
    (),
    ("tension",),
    ("arm",),
    ("fire",),
    ("arm", "fire"),
    ("fire", "arm"),
    ("de_tension",),
    ("stow",),
    ("abort",),
    ("reset",),
    ("reset", "tension", "arm", "fire"),
    ("ping", "fire"),
)
DISTURBANCES = (
    "none",
    "old",
    "stale",
    "stale_drive",
    "over_current",
    "disobeys",
    "magnet_failed",
    "magnet_current",
    "log_failed",
    "clock_jump",
    "unstroked",
    "unmeasurable",
)


@dataclass(frozen=True)
class Choice:
    """One combination of what the world may do at a tick."""

    age_s: float  # of the phase
    settled: bool  # nut at rest for long; latch test good
    latched: bool
    at_home: bool
    compression: float  # of the target's
    still: bool  # the robot stands
    disturbance: str
    commands: tuple[str, ...]
    signed: bool


@dataclass(frozen=True)
class Alphabet:
    """What may be chosen."""

    ages_s: tuple[float, ...] = (0.1, 1.0, 10.0, 700.0)
    compressions: tuple[float, ...] = (0.0, 0.3, 1.0, 1.2)
    disturbances: tuple[str, ...] = DISTURBANCES
    commands: tuple[tuple[str, ...], ...] = COMMANDS

    def choices(self) -> Iterator[Choice]:
        """Every combination."""
        both = (False, True)
        for combination in itertools.product(
            self.ages_s, both, both, both, self.compressions, both, self.disturbances, self.commands, both
        ):
            if combination[7] or combination[8]:  # no command needs no signature
                yield Choice(*combination)


@dataclass
class Exploration:
    """Counts, and what was found unsafe."""

    states: int = 0
    transitions: int = 0
    magnet_on: int = 0  # transitions with the magnet on; none would prove nothing
    phases: set[Phase] = field(default_factory=set)
    unsafe: dict[str, int] = field(default_factory=dict)
    example: str = ""

    def mark(self, rule: str, machine: Machine, choice: Choice) -> None:
        """Count something unsafe."""
        self.unsafe[rule] = self.unsafe.get(rule, 0) + 1
        self.example = self.example or f"{rule}: from {machine.phase} with {choice}"


def explore(settings: FlightSettings, alphabet: Alphabet | None = None) -> Exploration:
    """Take every step from every reachable state."""
    settings, choices = _quick(settings), tuple((alphabet or Alphabet()).choices())
    found, start = Exploration(), _key(Machine())
    seen, waiting = {start}, deque([Machine()])
    while waiting:
        state = waiting.popleft()
        found.states += 1
        found.phases.add(state.phase)
        for choice in choices:
            machine, snap, commands = _concrete(state, choice, settings)
            step = hop_machine.step(machine, snap, commands, settings)
            found.transitions += 1
            found.magnet_on += step.outputs.magnet_on
            _judge(found, machine, choice, step.machine, step.outputs, settings)
            if (key := _key(step.machine)) not in seen:
                seen.add(key)
                waiting.append(step.machine)
    return found


def _quick(settings: FlightSettings) -> FlightSettings:
    """All persistences as short as can be, so that no state hides behind a long count."""
    monitors = {
        name: replace(rule, for_ticks=min(rule.for_ticks, TICKS)) for name, rule in settings.monitors.items()
    }
    return replace(settings, monitors=monitors)


def _key(machine: Machine) -> tuple[object, ...]:
    return (
        machine.phase,
        machine.loaded,
        machine.drive_trusted,
        machine.reason == "",
        machine.reason == "stowed",
        machine.target is not None,
        machine.fire_s is not None,
        machine.home_m is not None,
        machine.taut_m is not None,
        machine.retries,
        bool(machine.beyond_ticks),
    )


def _concrete(
    state: Machine, choice: Choice, settings: FlightSettings
) -> tuple[Machine, Snapshot, tuple[GroundCommand, ...]]:
    """A machine of that state and the readings of that choice."""
    full_m = compression_for_energy_m(WANTED_J, settings.rig)
    s_m, ratio = choice.compression * full_m, settings.rig.travel_per_compression
    rest, upset = settings.rig.static_reading_m_s2, choice.disturbance
    taut_m = None if state.taut_m is None else 0.001
    since_s = NOW_S - choice.age_s
    machine = replace(
        state,
        since_s=since_s,
        home_m=None if state.home_m is None else 0.0,
        taut_m=taut_m,
        target=None if state.target is None else Target(WANTED_J, full_m),
        fire_s=None if state.fire_s is None else since_s,
        compression_m=s_m,
        position_m=0.001 + s_m * ratio,
        moved_s=NOW_S - 0.01,
        stable_ticks=1000 if choice.settled else 0,
        unloaded_ticks=1000 if choice.settled else 0,
        quiet_s=NOW_S - 1.0 if choice.still else None,
        latch_line=_line(ratio, good=choice.settled),
        voltage_v=8.0 if upset == "disobeys" else 0.0,
        last_s=NOW_S - (5.0 if upset == "clock_jump" else settings.tick.period_s),
        speed_m_s=0.0,
        wanted_m_s=0.0,
        failed_reads=0.0,
        winding_rise_k=0.0,
        heard_s=None,
    )
    sampled = dict.fromkeys(SENSORS, NOW_S)
    for name, sensor, age_s in (
        ("old", "spring", 0.04),
        ("stale", "accelerometer", 1.0),
        ("stale_drive", "nut_encoder", 1.0),
    ):
        if upset == name:
            sampled[sensor] = NOW_S - age_s
    force = rest if choice.still else rest + 2.0
    snap = Snapshot(
        time_s=NOW_S,
        motor_current_a=2.0 if upset == "over_current" else 0.0,
        nut_position_m=0.001 + s_m * ratio,
        at_home=choice.at_home,
        latch_closed=choice.latched,
        compression_m=s_m,
        magnet_current_a=1.5 if upset == "magnet_current" else 0.0,
        specific_force_m_s2=rest,
        specific_force_low_m_s2=rest,
        specific_force_high_m_s2=force,
        sampled_s=sampled,
        unstroked_share=0.9 if upset == "unstroked" else 0.0,
        magnet_failed=upset == "magnet_failed",
        log_failed=upset == "log_failed",
        supply_v=float("nan") if upset == "unmeasurable" else 12.0,
    )
    return machine, snap, tuple(_command(name, choice.signed) for name in choice.commands)


@cache
def _line(travel_per_compression: float, good: bool) -> LineFit:
    slope, line = (1.0 if good else 0.3) / travel_per_compression, LineFit()
    for index in range(2000):
        line = line.add(0.001 + 1e-6 * index, slope * 1e-6 * index)
    return line


def _command(name: str, signed: bool) -> GroundCommand:
    arguments = (("energy_j", WANTED_J),) if name == "tension" else ()
    return GroundCommand(NOW_S, name, arguments, authenticated=signed)


def _judge(
    found: Exploration,
    before: Machine,
    choice: Choice,
    after: Machine,
    outputs: Outputs,
    settings: FlightSettings,
) -> None:
    """The rules, from the choice alone."""
    undisturbed = choice.disturbance == "none"
    may_fire = (
        before.phase is Phase.ARMED
        and choice.signed
        and choice.commands[-1:] == ("fire",)
        and choice.age_s == 1.0
        and choice.settled
        and choice.latched
        and choice.compression == 1.0
        and choice.still
        and undisturbed
        and before.target is not None
        and before.reason == ""
        and before.drive_trusted
    )
    if outputs.magnet_on and not (may_fire or before.phase is Phase.FIRING):
        found.mark("magnet_on_without_leave", before, choice)
    if outputs.magnet_on and after.phase is not Phase.FIRING:
        found.mark("magnet_on_outside_firing", before, choice)
    if after.phase is Phase.SAFE and outputs != Outputs():
        found.mark("output_in_safe", before, choice)
    if after.phase is Phase.ARMED and before.phase not in (Phase.ARMED, Phase.HOLD):
        found.mark("armed_without_hold", before, choice)
    if (
        before.phase is Phase.HOLD
        and after.phase is Phase.ARMED
        and not (choice.signed and "arm" in choice.commands)
    ):
        found.mark("armed_without_command", before, choice)
    if before.phase is Phase.SAFE and after.phase is not Phase.SAFE:
        allowed = "reset" in choice.commands and choice.signed and before.drive_trusted and choice.settled
        if not (allowed and undisturbed and after.loaded):
            found.mark("left_safe_without_leave", before, choice)
    if not before.drive_trusted and (after.drive_trusted or outputs.voltage_v != 0.0):
        found.mark("untrusted_drive_used", before, choice)
    up_v = (
        hold_voltage_v(choice.compression * compression_for_energy_m(WANTED_J, settings.rig), settings) + 1e-6
    )
    raising = after.phase in (Phase.TENSIONING, Phase.LATCH_CHECK)
    if outputs.voltage_v > up_v and not raising:
        found.mark("tensioned_unasked", before, choice)
    if after.phase is Phase.TENSIONING and before.phase is not Phase.TENSIONING:
        asked = before.phase is Phase.READY and "tension" in choice.commands and choice.signed
        if not (asked and undisturbed):
            found.mark("tensioning_without_command", before, choice)
