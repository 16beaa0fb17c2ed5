"""The command table: what each command does, and in which phases it is accepted.

Commands of the ground and of the mission's own pilot pass here alike.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from flight import tensioning
from flight.machine_tick import Tick
from flight.monitors import Fault, firing_interlocks
from flight.states import STOWED, Phase, Target
from hal.readings import GroundCommand


def obey(tick: Tick, command: GroundCommand) -> None:
    """Carry out one command, or refuse it in words."""
    handler = _COMMANDS.get(command.name)
    if handler is None:
        tick.refuse(command, "unknown command")
    elif tick.machine.phase not in _ACCEPTED_IN[command.name]:
        tick.refuse(command, f"not accepted in {tick.machine.phase}")
    else:
        handler(tick, command)


def _obey_tension(tick: Tick, command: GroundCommand) -> None:
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


def _obey_arm(tick: Tick, command: GroundCommand) -> None:
    forbidding = firing_interlocks(tick.machine, tick.snap, tick.settings)
    if forbidding:
        tick.refuse(command, *forbidding)
    else:
        tick.go(Phase.ARMED)


def _obey_fire(tick: Tick, command: GroundCommand) -> None:
    timeouts = tick.settings.timeouts
    if not timeouts.arm_min_s <= tick.in_phase_s <= timeouts.arm_window_s:
        tick.refuse(command, "outside the window after arm")
        return
    forbidding = firing_interlocks(tick.machine, tick.snap, tick.settings)
    if forbidding:
        tick.refuse(command, *forbidding)
    else:
        tick.go(Phase.FIRING, fire_s=None)


def _obey_de_tension(tick: Tick, command: GroundCommand) -> None:
    tick.go(Phase.DE_TENSION)


def _obey_stow(tick: Tick, command: GroundCommand) -> None:
    """End in SAFE, nut home, nothing stored. This is no fault."""
    tick.go(Phase.DE_TENSION, reason=STOWED)


def _obey_abort(tick: Tick, command: GroundCommand) -> None:
    if tick.machine.phase is Phase.DE_TENSION:  # already on the way to where an abort leads
        tick.machine = replace(tick.machine, reason=tick.machine.reason_after("abort"))
    else:
        tick.fail(Fault("abort"))


_COMMANDS: dict[str, Callable[[Tick, GroundCommand], None]] = {
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
