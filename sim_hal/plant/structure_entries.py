"""The sections of a plant file and what an entry of each may say, as it stands in the YAML."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

#: Keys of a structure, beside `parameters`; in a file of `kind: equations` they stand next to them.
STRUCTURE_KEYS = (
    "known",
    "inputs",
    "events",
    "flags",
    "states",
    "definitions",
    "memories",
    "equations",
    "balances",
    "friction",
    "outputs",
)


@dataclass(frozen=True)
class StateEntry:
    """A state."""

    unit: str
    initial: Any


@dataclass(frozen=True)
class PlaceEntry:
    """Where a missing force may enter, as a further key of an equation, definition or balance."""

    per_force: Any = None
    velocity: Any = None
    position: Any = None
    load: Any = None


@dataclass(frozen=True)
class EquationEntry(PlaceEntry):
    """A rate."""

    state: str = ""
    rate: Any = None
    balance: bool = False


@dataclass(frozen=True)
class BalanceEntry(PlaceEntry):
    """A force between equations."""

    equation: str = ""


@dataclass(frozen=True)
class DefinitionEntry(PlaceEntry):
    """A named formula."""

    value: Any = None
    unit: str = ""
    port: bool = False
    equation: str | None = None


@dataclass(frozen=True)
class MemoryEntry:
    """A value that stays while it lies within limits."""

    unit: str
    lower: Any
    initial: Any
    upper: Any = None


@dataclass(frozen=True)
class FlagEntry:
    """A latch."""

    when: Any


@dataclass(frozen=True)
class FrictionEntry:
    """Dry friction of the nominal plant."""

    forward: Any
    backward: Any


@dataclass(frozen=True)
class OutputEntry:
    """A predicted channel."""

    value: Any
