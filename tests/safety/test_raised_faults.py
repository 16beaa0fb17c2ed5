"""The faults without a limit, which a phase, a command or the executive raises: each when it must, and not when not.

What each trips on is brought about from outside: by readings, commands, devices that fail, or a monitor that breaks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import pytest
from monitor_cases import NOW, RULES, S_M, SETTINGS, TAUT_M, healthy

from flight import hop_machine
from flight.executive import fly
from flight.mission import HopPlan, MissionPlan
from flight.quantities import QUANTITIES
from flight.states import Machine, Phase, Snapshot
from hal.board import open_board
from hal.config import config_path, read_yaml
from hal.errors import DeviceError, ReadFailed
from hal.log import MemoryLog
from hal.readings import GroundCommand

ONE_HOP = MissionPlan("one", (HopPlan(0.6, "steel"),))
SAFETY = SETTINGS.safety


def raised(machine: Machine, snap: Snapshot, *orders: str) -> str:
    """The row of the table that one tick answers, by the reason it tells; empty for none."""
    commands = [GroundCommand(NOW, name) for name in orders]
    events = hop_machine.step(machine, snap, commands, SETTINGS).events
    reasons = [event.details["reason"] for event in events if event.name in ("fault", "retry")]
    return reasons[0] if reasons else ""


def in_phase(phase: Phase, of_machine: dict[str, Any], of_snap: dict[str, Any]) -> str:
    machine, snap = healthy(phase)
    return raised(machine._replace(**of_machine), snap._replace(**of_snap))


def latch_check(nut_m: float, compression_m: float) -> str:
    before = {"position_m": nut_m, "compression_m": compression_m}
    return in_phase(Phase.LATCH_CHECK, before, {"nut_position_m": nut_m, "compression_m": compression_m})


def settled_with(share: float) -> str:
    """Tensioning has ended, with so much of the compression wanted."""
    there = {"compression_m": share * S_M, "stable_ticks": 1000}
    position_m = TAUT_M + share * S_M * SETTINGS.rig.travel_per_compression
    there["position_m"] = position_m
    return in_phase(Phase.TENSIONING, there, {"nut_position_m": position_m, "compression_m": share * S_M})


def self_test(age_s: float, since_s: float) -> str:
    """One sensor is so old, so long after the self-test began."""
    machine, snap = healthy(Phase.HOMING)
    sampled_s = snap.sampled_s | {"accelerometer": NOW - age_s}
    machine = machine._replace(phase=Phase.SELF_TEST, since_s=NOW - since_s)
    return raised(machine, snap._replace(sampled_s=sampled_s))


def landed(compression_m: float) -> str:
    machine, snap = healthy(Phase.FLIGHT)
    return raised(
        machine._replace(phase=Phase.LANDED, loaded=False), snap._replace(compression_m=compression_m)
    )


def commanded(name: str) -> str:
    return raised(*healthy(Phase.HOLD), name)


def monitored(quantity: float) -> str:
    """All monitors measure, one of them this."""
    whole = QUANTITIES["hot_motor"]
    QUANTITIES["hot_motor"] = lambda *_: quantity
    try:
        return raised(*healthy(Phase.HOLD))
    finally:
        QUANTITIES["hot_motor"] = whole


def flown(device: str, method: str, error: Exception) -> str:
    """Why a mission ends whose device fails in this way twice, a second after its start."""
    board = open_board("sim", read_yaml(config_path("boards", "sim.yaml")))
    left = [2]

    def failing(*plain: Any) -> Any:
        if board.clock.now_s() > 1.0 and left[0]:
            left[0] -= 1
            raise error
        return getattr(getattr(board, device), method)(*plain)

    with board:
        broken = replace(board, **{device: Standing(getattr(board, device), method, failing)})
        return fly(broken, SETTINGS, ONE_HOP, MemoryLog()).end_reason


class Standing:
    """A device with one of its methods replaced."""

    def __init__(self, device: Any, method: str, by: Callable[..., Any]) -> None:
        self._device = device
        setattr(self, method, by)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._device, name)


@dataclass(frozen=True)
class Case:
    """What must raise it, and the nearest things that must not; each tells the reason that came of it."""

    trips: tuple[Callable[[], str], ...]
    not_by: tuple[Callable[[], str], ...]
    reason: str = ""  # where it tells more than its name


SLACK_M, TAUT_TRAVEL_M = SAFETY.max_slack_m, SAFETY.max_slack_m + 2.0 * SAFETY.latch_check_compression_m
HALF_M = 0.5 * (SAFETY.latch_check_start_m + SAFETY.latch_check_compression_m)
CASES = {
    "monitor_dead": Case(
        (lambda: monitored(float("nan")),), (lambda: monitored(0.0), lambda: monitored(84.0))
    ),
    "motor_command_failed": Case(
        (lambda: flown("motor", "set_voltage_v", DeviceError("no answer")),),
        (lambda: flown("nut_encoder", "read", ReadFailed("no answer")),),
    ),
    "software_exception": Case(
        (lambda: flown("nut_encoder", "read", ZeroDivisionError()),),
        (lambda: flown("spring", "read", ReadFailed("no answer")),),
        reason="exception:ZeroDivisionError",
    ),
    "latch_does_not_hold": Case(
        (lambda: latch_check(1.01 * SLACK_M, 0.0), lambda: latch_check(1.01 * TAUT_TRAVEL_M, HALF_M)),
        (lambda: latch_check(0.99 * SLACK_M, 0.0), lambda: latch_check(0.99 * TAUT_TRAVEL_M, HALF_M)),
    ),
    "tension_overshoot": Case((lambda: settled_with(1.008),), (lambda: settled_with(1.003),)),
    "self_test_failed": Case(
        (lambda: self_test(0.1, 1.1),),
        (lambda: self_test(0.1, 0.9), lambda: self_test(0.05, 1.1)),
        reason="self_test_accelerometer_silent",
    ),
    "spring_not_relaxed_by_hop": Case(
        (
            lambda: landed(1.05 * SAFETY.unloaded_compression_m),
            lambda: landed(-1.05 * SAFETY.unloaded_compression_m),
        ),
        (lambda: landed(0.95 * SAFETY.unloaded_compression_m),),
    ),
    "abort": Case(
        (lambda: commanded("abort"),), (lambda: commanded("ping"), lambda: commanded("de_tension"))
    ),
}


def test_every_fault_that_is_raised_has_its_case() -> None:
    assert set(CASES) == {name for name, rule in RULES.items() if not rule.measured}


@pytest.mark.parametrize("name", CASES)
def test_it_is_raised(name: str) -> None:
    case = CASES[name]
    assert [trip() for trip in case.trips] == [case.reason or name] * len(case.trips)


@pytest.mark.parametrize("name", CASES)
def test_what_is_near_it_raises_nothing(name: str) -> None:
    """A mission that goes on ends stowed; a tick in which nothing is raised tells no reason."""
    assert {by() for by in CASES[name].not_by} <= {"", "stowed"}
