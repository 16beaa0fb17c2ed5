"""What is chosen anew at each step of the exploration: readings, times, commands; representatives of all cases."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

from flight.settings import FlightSettings
from flight.states import SENSORS, LineFit, Machine, Phase, Snapshot, Target
from flight.tensioning import compression_for_energy_m
from hal.readings import GroundCommand

NOW_S = 1000.0
WANTED_J = 15.0

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


def concrete(state: Machine, choice: World, settings: FlightSettings) -> tuple[Machine, Snapshot]:
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
