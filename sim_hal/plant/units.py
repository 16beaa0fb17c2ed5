"""Units of formulas: each parameter, state and channel has one, and a formula must have the unit of its place.

Pint reads the unit texts; the check itself works on exponents of base dimensions. Units must be coherent SI
(no millimetres, no degrees), so that no number changes its meaning between a file and the equations.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Mapping
from fractions import Fraction
from functools import lru_cache
from typing import Any

from sim_hal.plant.expressions import ExpressionError, Name, Node, Num, Op, to_text

#: Exponents of base dimensions, sorted by name; () is a pure number.
Dimension = tuple[tuple[str, Fraction], ...]
PURE: Dimension = ()
BOOLEAN: Dimension = (("truth", Fraction(1)),)
INVERSE = Fraction(-1)
FREE = "?"
"""First letter of a base dimension that stands for the unit that a number in a formula was not given."""
PLAIN = frozenset({*(halves / 2 for halves in range(17)), 0.25, 0.75, math.pi})
"""Numbers that a formula has by its nature: a factor of these has no unit."""
_SIDE_BY_SIDE = ("+", "-", "min", "max", "where", "<", "<=", ">", ">=")

#: Unit of a channel by the last parts of its name (recording-format: the unit is the name's last part).
CHANNEL_UNITS: Mapping[str, str] = {
    **{"m": "m", "m_s": "m/s", "m_s2": "m/s^2", "m2": "m^2"},
    **{"rad": "rad", "rad_s": "rad/s", "rad_s2": "rad/s^2"},
    **{"n": "N", "n_m": "N*m", "nm": "N*m", "n_s": "N*s", "n_s_m": "N*s/m", "pa": "Pa"},
    **{"a": "A", "v": "V", "ohm": "ohm", "w": "W", "j": "J", "t": "T", "c": "C"},
    **{"k": "K", "s": "s", "hz": "Hz", "kg": "kg", "1": "1", "kg_m3": "kg/m^3", "kg_m2": "kg*m^2"},
    **{"m3": "m^3", "m3_s": "m^3/s", "kg_s": "kg/s", "k_s": "K/s", "w_m2": "W/m^2"},
}


#: A power as a unit has it: a plain number of few digits, and no power of it in turn.
_POWER = re.compile(r"\*\*\(?[-+]?\d{1,2}(\.\d{1,2}|/\d)?\)?(?!\*\*|[\w.])")


class UnitError(ValueError):
    """A unit is unknown, not coherent SI, or does not fit its place."""


@lru_cache(maxsize=1)
def _registry() -> Any:
    import pint  # takes half a second: only when a plant is read

    return pint.UnitRegistry(cache_folder=None)


@lru_cache(maxsize=1024)
def dimension(unit: str) -> Dimension:
    """Dimension of a unit text such as `N*m/A`; raises `UnitError` when unknown or not coherent SI."""
    if "**" in _POWER.sub("", unit.replace("^", "**").replace(" ", "")):  # Pint would work 9**9**9 out
        raise UnitError(f"{unit!r} is not a unit: a power is a plain number of few digits, such as m/s**2")
    try:
        quantity = _registry().parse_expression(unit) if unit.strip() else None
        quantity = _registry().Quantity(quantity)
        base = quantity.to_base_units()
    except Exception as error:  # pint raises a whole zoo, down to TypeError and tokenizer errors
        raise UnitError(f"{unit!r} is not a unit") from error
    if not unit.strip():
        raise UnitError("the unit is empty (a pure number has the unit '1')")
    if not abs(base.magnitude - 1.0) < 1e-12:
        raise UnitError(f"{unit!r} is not coherent SI (it is {base:~}); give the value in {base.units:~}")
    if getattr(base, "_offsets", None) or "delta" in str(quantity.units):
        raise UnitError(f"{unit!r} is not coherent SI")
    found = {str(name): Fraction(power).limit_denominator(1000) for name, power in base.unit_items()}
    found.pop("radian", None)
    return tuple(sorted((name, power) for name, power in found.items() if power))


def channel_unit(channel: str) -> str:
    """Unit of a channel from its name, e.g. `m/s^2` for `body_acceleration_m_s2`; raises `UnitError`."""
    parts = channel.split("_")
    for count in (4, 3, 2, 1):
        suffix = "_".join(parts[-count:])
        if len(parts) > count and suffix in CHANNEL_UNITS:
            return CHANNEL_UNITS[suffix]
    raise UnitError(f"channel {channel!r} does not end in a unit (such as _m, _m_s2, _a, _v, _n, _rad)")


def times(first: Dimension, second: Dimension, power: Fraction = Fraction(1)) -> Dimension:
    """Dimension of first · second^power."""
    merged = dict(first)
    for name, exponent in second:
        merged[name] = merged.get(name, Fraction(0)) + exponent * power
    return tuple(sorted((name, exponent) for name, exponent in merged.items() if exponent))


def describe(dim: Dimension) -> str:
    """A dimension in words for messages, e.g. `kg*m/s^2`."""
    if dim == BOOLEAN:
        return "true or false"
    above = "*".join(_letter(name) + (f"^{power}" if power != 1 else "") for name, power in dim if power > 0)
    below = "".join(
        f"/{_letter(name)}" + (f"^{-power}" if power != -1 else "") for name, power in dim if power < 0
    )
    return (above or "1") + below


def _letter(name: str) -> str:
    letters = {"kilogram": "kg", "meter": "m", "second": "s", "ampere": "A", "kelvin": "K", "mole": "mol"}
    return letters.get(name, name)


def check_unit(node: Node, symbols: Mapping[str, Dimension], expected: Dimension) -> None:
    """Raise `ExpressionError` unless the formula has the expected dimension; 0 fits any."""
    found = unit_of(node, symbols)
    if found is not None and not fits(found, expected):
        raise _refuse(node, f"has the unit {describe(found)}, expected {describe(expected)}")


def fits(one: Dimension, other: Dimension) -> bool:
    """Whether two dimensions are the same, or would be if a number had the unit that it needs."""
    return one == other or (BOOLEAN not in (one, other) and (is_free(one) or is_free(other)))


def is_free(dim: Dimension) -> bool:
    """Whether a number without a unit is in it, whose unit may be any."""
    return any(name.startswith(FREE) for name, _ in dim)


def freed(node: Node, symbols: dict[str, Dimension], beside: bool = True) -> Node:
    """The formula with a symbol of free unit, entered in `symbols`, for each number that may well have one.

    That is one that stands `beside` something with a unit, and as a factor any but the plain ones (`PLAIN`): the
    9.81 of `-9.81 * sin(phi)`, the 0.05 of `tanh(w / 0.05)`. An exponent is a number.
    """
    if isinstance(node, Num) and (beside or node.value not in PLAIN):
        name = f"{node.value:g} ({len(symbols)})"
        symbols[name] = ((FREE + name, Fraction(1)),)
        return Name(name)
    if not isinstance(node, Op):
        return node
    if node.op == "**":
        return Op("**", (freed(node.args[0], symbols, beside=False), node.args[1]))
    apart = node.op in _SIDE_BY_SIDE or (node.op == "neg" and beside)
    return Op(node.op, tuple(freed(arg, symbols, apart) for arg in node.args))


def fits_with_numbers(node: Node, symbols: Mapping[str, Dimension], expected: Dimension) -> bool:
    """Whether a formula would have the expected dimension if its numbers had the units they need."""
    known = dict(symbols)
    loose = freed(node, known)
    try:
        check_unit(loose, known, expected)
    except ExpressionError:
        return False
    return True


def check_formula(node: Node, symbols: Mapping[str, Dimension], expected: Dimension) -> None:
    """As `check_unit`, the error pointing to the place within the whole formula.

    A formula whose units would fit, had its numbers the units they need, passes: many a plant is written so.
    """
    try:
        check_unit(node, symbols, expected)
    except ExpressionError as error:
        if fits_with_numbers(node, symbols, expected):
            return
        whole = to_text(node)
        place = re.search(rf"(?<!\w){re.escape(error.text)}(?!\w)", whole)
        raise ExpressionError(error.reason, whole, place.start() if place else 0) from None


def _unknown(name: str, symbols: Iterable[str]) -> str:
    """What to say of a name that stands for nothing."""
    known = sorted(symbol for symbol in symbols if symbol.isidentifier())
    close = difflib.get_close_matches(name, known, n=1)
    return f"{name!r} is not known here; " + (
        f"did you mean {close[0]!r}?" if close else f"known: {', '.join(known)}"
    )


def sound_unit_of(node: Node, symbols: Mapping[str, Dimension]) -> Dimension | None:
    """As `unit_of`, of a formula that may have numbers without their units (`check_formula`)."""
    try:
        return unit_of(node, symbols)
    except ExpressionError:
        known = dict(symbols)
        found = unit_of(freed(node, known), known)
        return None if found is None else tuple(base for base in found if not base[0].startswith(FREE))


def unit_of(node: Node, symbols: Mapping[str, Dimension]) -> Dimension | None:
    """Dimension of a formula, or None for a literal zero, which fits any."""
    if isinstance(node, Num):
        return None if node.value == 0.0 else PURE
    if isinstance(node, Name):
        if node.id not in symbols:
            raise ExpressionError(_unknown(node.id, symbols), node.id, 0)
        return symbols[node.id]
    return _unit_of_op(node, symbols)


def _unit_of_op(node: Op, symbols: Mapping[str, Dimension]) -> Dimension | None:
    match node.op:
        case "rate":
            return times(_known(node.args[0], symbols), dimension("s"), Fraction(-1))
        case "since":
            _require(node.args[0], symbols, BOOLEAN)
            return dimension("s")
        case "where":
            _require(node.args[0], symbols, BOOLEAN)
            return _common(node, node.args[1:], symbols)
        case "and" | "or" | "not":
            for arg in node.args:
                _require(arg, symbols, BOOLEAN)
            return BOOLEAN
        case "<" | "<=" | ">" | ">=":
            _common(node, node.args, symbols)
            return BOOLEAN
        case "+" | "-" | "min" | "max" | "neg" | "abs":
            return _common(node, node.args, symbols)
        case "*" | "/":
            power = Fraction(1 if node.op == "*" else -1)
            return times(_known(node.args[0], symbols), _known(node.args[1], symbols), power)
        case "**":
            return _unit_of_power(node, symbols)
        case "sqrt":
            return times(PURE, _known(node.args[0], symbols), Fraction(1, 2))
        case "sign":
            _known(node.args[0], symbols)
            return PURE
    _require(node.args[0], symbols, PURE)
    return PURE


def _unit_of_power(node: Op, symbols: Mapping[str, Dimension]) -> Dimension:
    base = _known(node.args[0], symbols)
    _require(node.args[1], symbols, PURE)
    if base == PURE:
        return PURE
    power = node.args[1]
    sign = 1
    if isinstance(power, Op) and power.op == "neg":
        sign, power = -1, power.args[0]
    if not isinstance(power, Num):
        raise _refuse(node, "something with a unit may only be raised to a number")
    return times(PURE, base, sign * Fraction(power.value).limit_denominator(1000))


def _known(node: Node, symbols: Mapping[str, Dimension]) -> Dimension:
    found = unit_of(node, symbols)
    if found == BOOLEAN:
        raise _refuse(node, "is true or false, where a quantity is needed (use where)")
    return PURE if found is None else found


def _require(node: Node, symbols: Mapping[str, Dimension], expected: Dimension) -> None:
    check_unit(node, symbols, expected)


def _common(node: Op, args: tuple[Node, ...], symbols: Mapping[str, Dimension]) -> Dimension | None:
    """The one dimension that all of `args` share."""
    shared: Dimension | None = None
    for arg in args:
        found = unit_of(arg, symbols)
        if found == BOOLEAN:
            raise _refuse(arg, "is true or false, where a quantity is needed (use where)")
        if found is not None and shared is not None and not fits(found, shared):
            raise _refuse(node, f"mixes the units {describe(shared)} and {describe(found)}")
        shared = found if shared is None or is_free(shared) else shared
    return shared


def _refuse(node: Node, reason: str) -> ExpressionError:
    return ExpressionError(f"`{to_text(node)}` {reason}", to_text(node), 0)
