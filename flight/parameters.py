"""Parameters by their dotted names: checked against the dictionary, and changed one by one."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any

from hal.dictionary import ParameterEntry, dictionary


def leaves(settings: Any, prefix: str = "") -> Iterator[tuple[str, float]]:
    """Each number of a settings dataclass by its dotted name, such as `tick.rate_hz`."""
    if dataclasses.is_dataclass(settings):
        settings = {field.name: getattr(settings, field.name) for field in dataclasses.fields(settings)}
    if isinstance(settings, Mapping):
        for name, value in settings.items():
            yield from leaves(value, f"{prefix}.{name}" if prefix else str(name))
    elif isinstance(settings, int | float) and not isinstance(settings, bool):
        yield prefix, settings


def entry_of(name: str) -> ParameterEntry | None:
    """A parameter's entry; `*` in the dictionary stands for any one part (each foot, each monitor)."""
    entries = dictionary().parameters
    if name in entries:
        return entries[name]
    parts = name.split(".")
    wild = (".".join([*parts[:i], "*", *parts[i + 1 :]]) for i in range(1, len(parts)))
    return next((entries[key] for key in wild if key in entries), None)


def parameters_problem(settings: Any) -> str:
    """The first parameter that the dictionary lacks or refuses, in words; empty when there is none."""
    for name, value in leaves(settings):
        entry = entry_of(name)
        if entry is None:
            return f"{name} is not in the dictionary of parameters"
        if why := entry.refusal(value):
            return f"{name} = {why} {entry.unit if entry.unit != '1' else ''}".rstrip()
    return ""


def with_parameter(settings: Any, name: str, value: float) -> Any:
    """The settings with one number changed. Raises `KeyError` for a name that is none of them."""
    first, _, rest = name.partition(".")
    if dataclasses.is_dataclass(settings) and not isinstance(settings, type):
        inner = {field.name: getattr(settings, field.name) for field in dataclasses.fields(settings)}[first]
        return dataclasses.replace(settings, **{first: with_parameter(inner, rest, value) if rest else value})
    return {**settings, first: with_parameter(settings[first], rest, value)}
