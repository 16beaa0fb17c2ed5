"""The command `set_parameter`: one parameter changed while the robot stands, checked like the whole file."""

from __future__ import annotations

from flight.commands import SET_PARAMETER, refusals
from flight.parameters import entry_of, with_parameter
from flight.settings import FlightSettings, settings_problem
from flight.states import Event, Phase
from hal.dictionary import dictionary
from hal.readings import GroundCommand


def changed(settings: FlightSettings, command: GroundCommand, phase: Phase) -> tuple[FlightSettings, Event]:
    """The settings after the command, and the event that tells of it; unchanged when it is refused."""
    why = _refusal(command, phase)
    if not why:
        ((name, value),) = command.arguments
        whole = value.is_integer() and getattr(entry_of(name), "type", "") == "int"
        after: FlightSettings = with_parameter(settings, name, int(value) if whole else value)
        why = settings_problem(after)
        if not why:
            return after, Event("parameter_set", {"parameter": name, "value": value})
    details = {"command": command.name, "phase": str(phase), "why": [why], "sequence": command.sequence}
    return settings, Event("command_refused", details)


def _refusal(command: GroundCommand, phase: Phase) -> str:
    for why in refusals(dictionary().commands[SET_PARAMETER], command, phase):
        return why
    if len(command.arguments) != 1:
        return "needs one parameter and its value"
    ((name, _),) = command.arguments
    entry = entry_of(name)
    if entry is None:
        return f"{name} is not in the dictionary of parameters"
    if entry.changeable != "standing":
        return f"{name} can be changed at the start only"
    return ""
