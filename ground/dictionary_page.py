"""The dictionary as a page of documentation (Markdown): `hopper dictionary > docs/dictionary.md`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from hal.dictionary import Dictionary, Range

HEAD = """# Dictionary

Every command, event, telemetry channel and parameter, from `config/dictionary.yaml` (printed by `hopper dictionary`).
"""


def dictionary_page(found: Dictionary) -> str:
    """The whole dictionary as tables."""
    commands = (
        (
            f"`{name}`",
            str(entry.id),
            entry.text,
            ", ".join(f"`{key}` {_range(value)}" for key, value in entry.arguments.items()) or "–",
            ", ".join(entry.accepted_in),
            "yes" if entry.authenticated else "no",
        )
        for name, entry in found.commands.items()
    )
    events = (
        (f"`{name}`", str(entry.id), entry.severity, entry.text, entry.monitor or "–")
        for name, entry in found.events.items()
    )
    channels = ((f"`{name}`", _range(entry), entry.text) for name, entry in found.channels.items())
    parameters = (
        (f"`{name}`", entry.type, _range(entry), entry.changeable) for name, entry in found.parameters.items()
    )
    return "\n".join(
        (
            HEAD,
            _table(
                "Commands", ("command", "id", "does", "arguments", "accepted in", "must be signed"), commands
            ),
            _table("Events", ("event", "id", "severity", "meaning", "monitor"), events),
            _table("Telemetry channels", ("channel", "range", "meaning"), channels),
            "Defaults of parameters are their values in `config/flight.yaml`; `*` stands for any one name.\n",
            _table("Parameters", ("parameter", "type", "range", "changeable"), parameters),
        )
    )


def _range(entry: Range) -> str:
    unit = "" if entry.unit == "1" else f" {entry.unit}"
    return f"{entry.low:g} … {entry.high:g}{unit}"


def _table(title: str, headers: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = (headers, ["---"] * len(headers), *rows)
    return f"## {title}\n\n" + "".join(f"| {' | '.join(line)} |\n" for line in lines)
