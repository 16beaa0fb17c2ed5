"""Robots that are well, phase by phase, and for each measured monitor how to bring its quantity to a value."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from flight import settings as flight_settings
from flight.states import SENSORS, Machine, Phase, Sameness, Snapshot, Target
from flight.tensioning import compression_for_energy_m

SETTINGS = flight_settings.load()
REST = SETTINGS.rig.static_reading_m_s2
RATIO = SETTINGS.rig.travel_per_compression
NOW = 100.0
S_M = compression_for_energy_m(15.0, SETTINGS.rig)
TAUT_M = 0.001
RULES = SETTINGS.monitors
Changes = Callable[[float], tuple[dict[str, Any], dict[str, Any]]]


def healthy(phase: Phase) -> tuple[Machine, Snapshot]:
    """A machine and the snapshot of a robot that is well in that phase."""
    taut = phase not in (Phase.HOMING, Phase.LATCH_CHECK, Phase.FLIGHT)
    s_m = S_M if taut else 0.0
    machine = Machine(
        phase=phase,
        since_s=NOW - 0.05,
        taut_m=TAUT_M if taut else None,
        home_m=0.0,
        target=Target(15.0, S_M),
        compression_m=s_m,
        position_m=TAUT_M + s_m * RATIO,
        moved_s=NOW - 0.01,
        last_s=NOW - SETTINGS.tick.period_s,
        elapsed_s=SETTINGS.tick.period_s,
    )
    snap = Snapshot(
        time_s=NOW,
        nut_position_m=TAUT_M + s_m * RATIO,
        latch_closed=phase is not Phase.FLIGHT,
        compression_m=s_m,
        specific_force_m_s2=REST,
        sampled_s=dict.fromkeys(SENSORS, NOW),
        magnet_current_a=1.4 if phase is Phase.FIRING else 0.0,
        supply_v=12.0,
    )
    return machine, snap


def of_snap(name: str) -> Changes:
    return lambda value: ({}, {name: value})


def of_machine(name: str) -> Changes:
    return lambda value: ({name: value}, {})


def in_phase(value: float) -> tuple[dict[str, Any], dict[str, Any]]:
    return {"since_s": NOW - value}, {}


def aged(sensor: str) -> Changes:
    return lambda value: ({}, {"sampled_s": dict.fromkeys(SENSORS, NOW) | {sensor: NOW - value}})


def magnet_after_rise(value: float) -> tuple[dict[str, Any], dict[str, Any]]:
    return {"since_s": NOW - 0.03}, {"magnet_current_a": value}


@dataclass(frozen=True)
class Case:
    """How to bring a monitor's quantity to a value, in one phase; values just within and just beyond."""

    phase: Phase
    change: Changes
    within: float
    beyond: float


H, T = Phase.HOLD, Phase.TENSIONING
CASES: dict[str, Case] = {
    "clock_jump": Case(H, of_machine("elapsed_s"), 0.2, 0.3),
    "watchdog": Case(H, of_snap("unstroked_share"), 0.45, 0.55),
    "tick_overrun": Case(H, of_snap("tick_late_s"), 0.0020, 0.0030),
    "magnet_command_failed": Case(H, of_snap("magnet_failed"), False, True),
    "magnet_on_unasked": Case(H, of_snap("magnet_current_a"), 0.05, 1.5),
    "log_unwritable": Case(H, of_snap("log_failed"), False, True),
    "memory_unwritable": Case(H, of_snap("memory_failed"), False, True),
    **{f"{sensor}_stale": Case(H, aged(sensor), 0.05, 0.07) for sensor in SENSORS},
    "over_current": Case(T, of_snap("motor_current_a"), -1.4, -1.6),
    "motor_current_stuck": Case(T, lambda n: ({"same_current": Sameness(0.1, NOW, int(n))}, {}), 11, 12),
    "motor_disobeys": Case(H, of_machine("voltage_v"), 1.4, -1.6),
    "motor_runs_away": Case(H, of_machine("speed_m_s"), 0.0009, -0.0011),
    "stall": Case(T, lambda value: ({"moved_s": NOW - value}, {}), 0.55, 0.65),
    "supply_sag": Case(H, of_snap("supply_v"), 10.5, 9.5),
    "hot_motor": Case(H, of_machine("winding_rise_k"), 84.0, 86.0),
    "over_travel": Case(H, of_machine("taut_m"), -0.0005, -0.030),
    "over_compression": Case(H, of_snap("compression_m"), 0.0418, 0.0422),
    "over_force": Case(T, lambda a: ({"mean_current_a": a, "speed_m_s": 0.001}, {}), 0.55, 0.65),
    "early_release": Case(H, of_snap("latch_closed"), True, False),
    "string_broken": Case(H, of_snap("compression_m"), 0.62 * S_M, 0.55 * S_M),
    "spring_disagrees_with_encoder": Case(H, of_snap("compression_m"), 0.91 * S_M, 1.11 * S_M),
    "stored_energy_uncertain": Case(H, of_machine("compression_m"), 1.019 * S_M, 0.978 * S_M),
    "home_switch_stuck": Case(
        Phase.HOMING, lambda s: ({}, {"at_home": True, "compression_m": s}), 0.001, 0.002
    ),
    "accelerometer_stuck": Case(H, lambda n: ({"same_force": Sameness(9.0, NOW, int(n))}, {}), 11, 12),
    "accelerometer_implausible": Case(H, of_snap("specific_force_m_s2"), REST + 2.5, REST - 3.5),
    "bus_errors": Case(H, of_machine("failed_reads"), 14.0, 16.0),
    "link_lost": Case(H, lambda value: ({"heard_s": NOW - value}, {}), 110.0, 130.0),
    "latch_did_not_close": Case(
        Phase.LATCH_CHECK, lambda v: ({"since_s": NOW - v}, {"latch_closed": False}), 1.9, 2.1
    ),
    "magnet_open": Case(Phase.FIRING, magnet_after_rise, 0.6, 0.4),
    "magnet_shorted": Case(Phase.FIRING, of_snap("magnet_current_a"), 2.1, 2.3),
    "misfire": Case(Phase.FIRING, in_phase, 0.09, 0.11),
    **{
        f"{phase}_timeout": Case(phase, in_phase, 0.99 * limit, 1.01 * limit)
        for phase in Phase
        if (rule := RULES.get(f"{phase}_timeout")) and (limit := rule.above)
    },
}
