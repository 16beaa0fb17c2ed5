"""Explores the product of the hop state machine with its interlocks, exhaustively.

A state is what the machine remembers that is no number: phase, load, trust, reason, target, fire time, positions
known, retries, monitors about to trip. Everything else (times, readings, the nut's rest, how good the latch test
was) is chosen anew at each step from representatives of all cases, so that more can be reached here than on a robot.
From each state the real `step` is taken with every combination of these and of commands, and what it answers is held
to rules that are written here from the inputs alone.
"""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache

from flight import hop_machine
from flight.settings import FlightSettings
from flight.states import SENSORS, LineFit, Machine, Outputs, Phase, Snapshot, Step, Target
from flight.tensioning import compression_for_energy_m, hold_voltage_v
from hal.readings import GroundCommand

NOW_S = 1000.0
WANTED_J = 15.0
PENDING = frozenset({"over_current", "motor_disobeys"})
"""Monitors that count to two here (not yet, and now); the others trip at once. One that is beyond its limit and has
not tripped is one interlock, whichever it is."""

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
    "magnet_current",  # some where none shall be, none where some shall
    "log_failed",
    "clock_jump",
    "unstroked",
    "unmeasurable",
)


@dataclass(frozen=True)
class World:
    """One combination of what the world may do at a tick."""

    age_s: float  # of the phase
    settled: bool  # nut at rest for long; latch test good
    latched: bool
    at_home: bool
    compression: float  # of the target's
    still: bool  # the robot stands
    disturbance: str


@dataclass(frozen=True)
class Orders:
    """What the ground may send at a tick."""

    names: tuple[str, ...]
    signed: bool
    commands: tuple[GroundCommand, ...]


@dataclass(frozen=True)
class Alphabet:
    """What may be chosen."""

    ages_s: tuple[float, ...] = (0.05, 1.0, 10.0, 700.0)
    compressions: tuple[float, ...] = (0.0, 0.3, 1.0, 1.2)
    disturbances: tuple[str, ...] = DISTURBANCES
    commands: tuple[tuple[str, ...], ...] = COMMANDS

    def worlds(self) -> Iterator[World]:
        """Every combination of what the world may do."""
        both = (False, True)
        kinds = (self.ages_s, both, both, both, self.compressions, both, self.disturbances)
        return (World(*combination) for combination in itertools.product(*kinds))

    def orders(self) -> Iterator[Orders]:
        """Every combination of what the ground may send; nothing needs no signature."""
        for names, signed in itertools.product(self.commands, (False, True)):
            if names or signed:
                yield Orders(names, signed, tuple(_command(name, signed) for name in names))


@dataclass
class Exploration:
    """Counts, and what was found unsafe."""

    states: int = 0
    transitions: int = 0
    magnet_on: int = 0  # transitions with the magnet on; none would prove nothing
    phases: set[Phase] = field(default_factory=set)
    unsafe: dict[str, int] = field(default_factory=dict)
    example: str = ""

    def mark(self, rule: str, machine: Machine, world: World, orders: Orders) -> None:
        """Count something unsafe."""
        self.unsafe[rule] = self.unsafe.get(rule, 0) + 1
        self.example = self.example or f"{rule}: from {machine.phase} with {world} and {orders}"


def explore(
    settings: FlightSettings,
    alphabet: Alphabet | None = None,
    *,
    until_unsafe: bool = False,
    show: Callable[[int, int], None] = lambda done, waiting: None,
) -> Exploration:
    """Take every step from every reachable state; with `until_unsafe`, until something unsafe is found.

    `show` is told, state by state, how many are done and how many wait.
    """
    alphabet = alphabet or Alphabet()
    settings, worlds, all_orders = _quick(settings), tuple(alphabet.worlds()), tuple(alphabet.orders())
    found, seen, waiting = Exploration(), {_key(Machine())}, deque([Machine()])
    while waiting and not (until_unsafe and found.unsafe):
        state = waiting.popleft()
        found.states += 1
        show(found.states, len(waiting))
        found.phases.add(state.phase)
        for world in worlds:
            machine, snap = _concrete(state, world, settings)
            observed, dead = hop_machine.observe(machine, snap, settings)  # the same whatever is commanded
            for orders in all_orders:
                step = hop_machine.decide(observed, dead, snap, orders.commands, settings)
                found.transitions += 1
                found.magnet_on += step.outputs.magnet_on
                _judge(found, machine, world, orders, step, settings)
                if (key := _key(step.machine)) not in seen:
                    seen.add(key)
                    waiting.append(step.machine)
    return found


def _quick(settings: FlightSettings) -> FlightSettings:
    """All persistences as short as can be, so that no state hides behind a long count."""
    monitors = {
        name: replace(rule, for_ticks=2 if name in PENDING else 1) for name, rule in settings.monitors.items()
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
        PENDING.intersection(machine.beyond_ticks),
    )


def _concrete(state: Machine, choice: World, settings: FlightSettings) -> tuple[Machine, Snapshot]:
    """A machine of that state and the readings of that world."""
    full_m = compression_for_energy_m(WANTED_J, settings.rig)
    s_m, ratio = choice.compression * full_m, settings.rig.travel_per_compression
    rest, upset = settings.rig.static_reading_m_s2, choice.disturbance
    taut_m = None if state.taut_m is None else 0.001
    since_s = NOW_S - choice.age_s
    machine = state._replace(
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
        magnet_current_a=1.4 if (upset == "magnet_current") != (state.phase is Phase.FIRING) else 0.0,
        specific_force_m_s2=rest,
        specific_force_low_m_s2=rest,
        specific_force_high_m_s2=force,
        sampled_s=sampled,
        unstroked_share=0.9 if upset == "unstroked" else 0.0,
        magnet_failed=upset == "magnet_failed",
        log_failed=upset == "log_failed",
        supply_v=float("nan") if upset == "unmeasurable" else 12.0,
    )
    return machine, snap


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
    found: Exploration, before: Machine, world: World, orders: Orders, step: Step, settings: FlightSettings
) -> None:
    """The rules, from world and orders alone."""
    broken = (
        *_broken_by_magnet(before, world, orders, step),
        *_broken_by_drive(before, world, orders, step, settings),
    )
    for rule in broken:
        found.mark(rule, before, world, orders)


def _broken_by_magnet(before: Machine, world: World, orders: Orders, step: Step) -> Iterator[str]:
    after, outputs = step.machine, step.outputs
    may_fire = (
        before.phase is Phase.ARMED
        and orders.signed
        and orders.names[-1:] == ("fire",)
        and world.age_s == 1.0
        and world.settled
        and world.latched
        and world.compression == 1.0
        and world.still
        and world.disturbance == "none"
        and before.target is not None
        and before.reason == ""
        and before.drive_trusted
    )
    if outputs.magnet_on and not (may_fire or before.phase is Phase.FIRING):
        yield "magnet_on_without_leave"
    if outputs.magnet_on and after.phase is not Phase.FIRING:
        yield "magnet_on_outside_firing"
    if after.phase is Phase.FIRING and not (may_fire or before.phase is Phase.FIRING):
        yield "firing_without_leave"
    may_arm = before.phase is Phase.HOLD and orders.signed and "arm" in orders.names
    if after.phase is Phase.ARMED and not (may_arm or before.phase is Phase.ARMED):
        yield "armed_without_command"


def _broken_by_drive(
    before: Machine, world: World, orders: Orders, step: Step, settings: FlightSettings
) -> Iterator[str]:
    after, outputs = step.machine, step.outputs
    if after.phase is Phase.SAFE and outputs != Outputs():
        yield "output_in_safe"
    if before.phase is Phase.SAFE and after.phase is not Phase.SAFE:
        allowed = "reset" in orders.names and orders.signed and before.drive_trusted and world.settled
        if not (allowed and world.disturbance in ("none", "old") and after.loaded):
            yield "left_safe_without_leave"
    if not before.drive_trusted and (after.drive_trusted or outputs.voltage_v != 0.0):
        yield "untrusted_drive_used"
    stored_m = world.compression * compression_for_energy_m(WANTED_J, settings.rig)
    pulls = outputs.voltage_v > hold_voltage_v(stored_m, settings) + 1e-6
    if pulls and after.phase not in (Phase.TENSIONING, Phase.LATCH_CHECK):
        yield "tensioned_unasked"
    may_tension = before.phase is Phase.READY and "tension" in orders.names and orders.signed
    if after.phase is Phase.TENSIONING and not (may_tension or before.phase is Phase.TENSIONING):
        yield "tensioning_without_command"
