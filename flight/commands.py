"""What each command does. Where it is accepted, with which arguments and from whom, says the dictionary.

Commands of the ground and of the mission's own pilot pass here alike.
"""

from __future__ import annotations

from collections.abc import Callable

from flight import tensioning
from flight.machine_tick import Tick
from flight.monitor_settings import GROUPS
from flight.monitors import Fault, firing_interlocks, reset_interlocks
from flight.states import STOWED, LineFit, Machine, Phase, Target
from hal.dictionary import CommandEntry, dictionary
from hal.readings import GroundCommand


def obey(tick: Tick, command: GroundCommand) -> None:
    """Carry out one command, or refuse it in words."""
    entry = dictionary().commands.get(command.name)
    if entry is None:
        tick.refuse(command, "unknown command")
    elif why := refusals(entry, command, tick.machine.phase):
        tick.refuse(command, *why)
    else:
        before = len(tick.events)
        _COMMANDS[command.name](tick, command)
        if all(event.name != "command_refused" for event in tick.events[before:]):
            tick.say("command_accepted", command=command.name, sequence=command.sequence)


def refusals(entry: CommandEntry, command: GroundCommand, phase: Phase) -> tuple[str, ...]:
    """What the dictionary has against a command in this phase; empty for nothing."""
    if entry.authenticated and not command.authenticated:
        return ("not authenticated",)
    if not any(phase in GROUPS[name] for name in entry.accepted_in):
        return (f"not accepted in {phase}",)
    if command.name == SET_PARAMETER:  # its arguments are parameters
        return ()
    arguments = dict(command.arguments)
    if set(arguments) != set(entry.arguments) or len(arguments) != len(command.arguments):
        return (f"needs the arguments {', '.join(entry.arguments) or 'none'} and no other",)
    outside = {name: entry.arguments[name].refusal(value) for name, value in arguments.items()}
    return tuple(f"{name} = {why}" for name, why in outside.items() if why)


def _obey_tension(tick: Tick, command: GroundCommand) -> None:
    """Store the usable energy `energy_j`."""
    limits, energy_j = tick.settings.tension, dict(command.arguments)["energy_j"]
    if not limits.min_energy_j <= energy_j <= limits.max_energy_j:
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
        tick.machine = tick.machine._replace(reason=tick.machine.reason_after("abort"))
    else:
        tick.fail(Fault("abort"))


def _obey_reset(tick: Tick, command: GroundCommand) -> None:
    """Out of SAFE: all that was known of the spring is forgotten, so that it counts as loaded again."""
    forbidding = reset_interlocks(tick.machine, tick.snap, tick.settings, tick.dead)
    if forbidding:
        tick.refuse(command, *forbidding)
        return
    tick.say("left_safe", reason=tick.machine.reason)
    start = Machine()
    tick.go(
        Phase.SELF_TEST,
        reason="",
        loaded=True,
        unloaded_ticks=0,
        home_m=start.home_m,
        taut_m=start.taut_m,
        target=None,
        fire_s=None,
        retries=0,
        latch_line=LineFit(),
    )


def _obey_ping(tick: Tick, command: GroundCommand) -> None:
    """Nothing: that it was heard is what counts."""


SET_PARAMETER = "set_parameter"

_COMMANDS: dict[str, Callable[[Tick, GroundCommand], None]] = {
    "tension": _obey_tension,
    "arm": _obey_arm,
    "fire": _obey_fire,
    "de_tension": _obey_de_tension,
    "stow": _obey_stow,
    "abort": _obey_abort,
    "reset": _obey_reset,
    "ping": _obey_ping,
}

COMMAND_NAMES = tuple(_COMMANDS)
