"""The device contracts as data: the calls that a board knows, their results as plain values and back.

Read off the protocols of `hal.devices`, so that a device or a method added there is known here at once.
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, get_args, get_origin, get_type_hints

from hal.board import Board


@dataclass(frozen=True)
class Call:
    """One method or property of a device; `returns` is its annotated result."""

    device: str
    method: str
    parameters: tuple[str, ...]
    returns: Any
    is_property: bool

    def arguments(self, positional: tuple[Any, ...], named: Mapping[str, Any]) -> dict[str, Any]:
        """The arguments of one call by the names that the contract gives them.

        Raises `TypeError` when they are not those of the contract.
        """
        if not named and len(positional) == len(self.parameters):  # nearly always
            return dict(zip(self.parameters, positional, strict=True))
        given = {**dict(zip(self.parameters, positional, strict=False)), **named}
        if len(positional) + len(named) != len(self.parameters) or given.keys() != set(self.parameters):
            expected = ", ".join(self.parameters) or "none"
            raise TypeError(f"{self.device}.{self.method}: arguments must be: {expected}")
        return given


@cache
def board_calls() -> Mapping[str, Mapping[str, Call]]:
    """All calls of a board: by device, then by method."""
    hints = get_type_hints(Board)
    devices = [each.name for each in dataclasses.fields(Board) if hints[each.name] not in (str, bool)]
    return {device: _device_calls(device, hints[device]) for device in devices}


def _device_calls(device: str, protocol: type) -> dict[str, Call]:
    calls: dict[str, Call] = {}
    for owner in reversed(protocol.__mro__):
        for name, member in vars(owner).items():
            is_property = isinstance(member, property)
            function = member.fget if isinstance(member, property) else member
            if name.startswith("_") or not inspect.isfunction(function):
                continue
            parameters = tuple(inspect.signature(function).parameters)[1:]
            returns = get_type_hints(function)["return"]
            calls[name] = Call(device, name, parameters, returns, is_property)
    return calls


Answer = Callable[..., Any]
"""What answers one call, given its arguments as the caller gives them."""


class ContractDevice:
    """Offers the calls of one device's contract, and nothing else; `answering` gives what answers each of them."""

    def __init__(self, calls: Mapping[str, Call], answering: Callable[[Call], Answer]) -> None:
        self._properties = {name: answering(call) for name, call in calls.items() if call.is_property}
        for name, call in calls.items():
            if not call.is_property:
                setattr(self, name, answering(call))

    def __getattr__(self, name: str) -> Any:
        answer = self.__dict__.get("_properties", {}).get(name)
        if answer is None:
            raise AttributeError(f"the device has no {name!r} in its contract")
        return answer()


def to_plain(value: Any) -> Any:
    """A reading as a mapping of its fields, several as a list; anything else as it is."""
    if value is None or isinstance(value, float):
        return value
    if isinstance(value, tuple):
        fields = getattr(value, "_fields", None)
        if fields is not None:
            return dict(zip(fields, value, strict=True))
        return [to_plain(item) for item in value]
    return value


@cache
def _builder(returns: Any) -> Callable[[Any], Any]:
    if hasattr(returns, "_fields"):
        reading: Callable[..., Any] = returns
        return lambda data: reading(**{name: _tuples(value) for name, value in data.items()})
    if get_origin(returns) is tuple:
        build_item = _builder(get_args(returns)[0])
        return lambda data: tuple(build_item(item) for item in data)
    return _tuples


def from_plain(returns: Any, data: Any) -> Any:
    """The inverse of `to_plain` for a result of the annotated type `returns`.

    Raises `TypeError` or `AttributeError` when `data` does not fit that type.
    """
    return _builder(returns)(data)


def _tuples(value: Any) -> Any:
    return tuple(_tuples(item) for item in value) if isinstance(value, list | tuple) else value
