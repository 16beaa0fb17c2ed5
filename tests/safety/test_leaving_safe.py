"""SAFE is left by a signed `reset` with all in order, and each thing that is not in order forbids it alone."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from monitor_cases import NOW, RULES, SETTINGS, healthy

from flight import hop_machine
from flight.states import Machine, Phase, Snapshot, Step
from hal.readings import GroundCommand

Change = Callable[[Machine, Snapshot], tuple[Machine, Snapshot]]


def after_reset(change: Change = lambda *state: state, *, signed: bool = True, ticks: int = 1) -> Step:
    """What a reset does to a robot in SAFE whose spring holds something, changed in one respect."""
    machine, snap = healthy(Phase.HOLD)
    machine = machine._replace(phase=Phase.SAFE, reason="supply_sag", stable_ticks=1000)
    machine, snap = change(machine, snap)
    order = (GroundCommand(NOW, "reset", authenticated=signed),)
    for tick in range(ticks):
        step = hop_machine.step(machine, snap, order if tick == ticks - 1 else (), SETTINGS)
        machine = step.machine
        snap = snap._replace(
            time_s=snap.time_s + SETTINGS.tick.period_s,
            sampled_s={name: at_s + SETTINGS.tick.period_s for name, at_s in snap.sampled_s.items()},
        )
    return step


def why(step: Step) -> list[str]:
    return [
        reason for event in step.events if event.name == "command_refused" for reason in event.details["why"]
    ]


def test_a_robot_in_order_starts_again_and_relaxes_the_spring_that_it_finds_loaded() -> None:
    step = after_reset()
    assert [event.name for event in step.events][:2] == ["left_safe", "command_accepted"]
    assert (step.machine.phase, step.machine.loaded, step.machine.reason) == (Phase.DE_TENSION, True, "")


FORBIDDING: dict[str, Change] = {
    "drive_not_trusted": lambda m, s: (m._replace(drive_trusted=False), s),
    "magnet_disobeys": lambda m, s: (m, s._replace(magnet_failed=True)),
    "magnet_current_flows": lambda m, s: (m, s._replace(magnet_current_a=1.0)),
    "not_stable": lambda m, s: (m._replace(position_m=s.nut_position_m + 1e-3), s),
    "supply_sag_beyond_limit": lambda m, s: (m, s._replace(supply_v=9.0)),
    "supply_sag_dead": lambda m, s: (m, s._replace(supply_v=float("nan"))),
    "spring_old": lambda m, s: (m, s._replace(sampled_s={**s.sampled_s, "spring": NOW - 1.0})),
}


@pytest.mark.parametrize("reason", FORBIDDING)
def test_what_is_not_in_order_forbids_it_by_name(reason: str) -> None:
    step = after_reset(FORBIDDING[reason])
    assert step.machine.phase is Phase.SAFE
    assert reason in why(step)


def test_without_a_signature_it_is_refused() -> None:
    step = after_reset(signed=False)
    assert step.machine.phase is Phase.SAFE
    assert why(step) == ["not authenticated"]


@pytest.mark.parametrize("ticks", [1, RULES["supply_sag"].for_ticks + 2])
def test_a_supply_that_sags_forbids_it_from_the_first_tick_on(ticks: int) -> None:
    step = after_reset(FORBIDDING["supply_sag_beyond_limit"], ticks=ticks)
    assert step.machine.phase is Phase.SAFE
