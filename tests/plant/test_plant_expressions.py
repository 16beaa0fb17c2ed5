"""The formula language: what it reads, what it refuses and where, and its units."""

from __future__ import annotations

import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from sim_hal.plant.expressions import (
    FUNCTIONS,
    ExpressionError,
    Name,
    Node,
    Num,
    Op,
    linear_in,
    parse,
    to_text,
)
from sim_hal.plant.units import PURE, UnitError, channel_unit, check_formula, check_unit, dimension, unit_of


def test_precedence_is_that_of_python() -> None:
    assert parse("-a ** 2") == Op("neg", (Op("**", (Name("a"), Num(2.0))),))
    assert parse("a - b - c") == Op("-", (Op("-", (Name("a"), Name("b"))), Name("c")))
    assert parse("pi") == Num(math.pi)


@pytest.mark.parametrize(
    ("text", "column"),
    [
        ("a.b", 0),
        ("  v + [1]", 6),
        ("é + x.y", 4),
        ("__import__('os')", 0),
        ("where(a > b, 1)", 0),
        ("(lambda: 1)()", 0),
        ("a if b else c", 0),
        ("1 + 'x'", 4),
        ("1e999", 0),
        ("10 ** 4 + True", 10),
        ("a < b < c", 0),
        ("sin(x=1)", 0),
        ("rate(1 + v)", 5),
        ("a @ b", 0),
        ("x := 1", 2),
        ("1 +\n[2]", 4),
    ],
)
def test_refusals_point_at_the_place(text: str, column: int) -> None:
    with pytest.raises(ExpressionError) as caught:
        parse(text)
    assert caught.value.column == column
    assert str(caught.value).splitlines()[-1] == "    " + " " * column + "^"


def test_depth_and_length_are_limited() -> None:
    for text in ("(" * 300 + "1" + ")" * 300, "-" * 500 + "1", "1+" * 900 + "1", "1 + " * 1000 + "1", " "):
        with pytest.raises(ExpressionError):
            parse(text)


@given(st.text(max_size=80))
@example("0or 1")
@example("1if x")
@example("'\\d'")
@example("\x00")
def test_any_text_is_a_value_or_a_refusal(text: str) -> None:
    try:
        node = parse(text)
    except ExpressionError:
        return
    assert parse(to_text(node)) == node


_LEAVES = st.one_of(
    st.floats(0, 1e300, allow_nan=False).map(lambda value: Num(abs(value))),
    st.sampled_from(["a", "b_1", "omega"]).map(Name),
)


def _branches(inner: st.SearchStrategy[Node]) -> st.SearchStrategy[Node]:
    def op(names: list[str], count: int) -> st.SearchStrategy[Node]:
        return st.builds(Op, st.sampled_from(names), st.tuples(*[inner] * count))

    calls = [name for name, (low, _) in FUNCTIONS.items() if low == 1 and name not in ("rate", "since")]
    return st.one_of(
        op(["+", "-", "*", "/", "**", "<", "<=", ">", ">=", "min", "max"], 2),
        op(["neg", "not", *calls], 1),
        op(["where", "and", "or", "min"], 3),
    )


@given(st.recursive(_LEAVES, _branches, max_leaves=12))
def test_text_of_a_node_reads_back_equal(node: Node) -> None:
    read = parse(to_text(node))
    # `a and (b and c)` may be printed flat only where that is the same node: reading decides.
    assert read == node


def test_linear_coefficients() -> None:
    coefficients, rest = linear_in(parse("2 * a - b / r + c"), frozenset({"a", "b"}))
    assert coefficients["a"] == Num(2.0)
    assert coefficients["b"] == Op("neg", (Op("/", (Num(1.0), Name("r"))),))
    assert rest == Name("c")
    with pytest.raises(ExpressionError, match="linear"):
        linear_in(parse("a * b"), frozenset({"a", "b"}))


SYMBOLS = {"m": dimension("kg"), "v": dimension("m/s"), "F": dimension("N"), "n": PURE}


def test_units_follow_the_formula() -> None:
    check_unit(parse("F / m"), SYMBOLS, dimension("m/s^2"))
    check_unit(parse("sqrt(2 * F * 3 / m)"), SYMBOLS, dimension("m^0.5/s"))
    check_unit(parse("where(v > 0, F, 0)"), SYMBOLS, dimension("N"))
    check_unit(parse("m * v ** 2 / 2"), SYMBOLS, dimension("J"))
    assert unit_of(parse("0"), SYMBOLS) is None


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("F + m", "mixes the units"),
        ("exp(v)", "expected 1"),
        ("v ** n", "only be raised to a number"),
        ("where(v, F, F)", "expected true or false"),
        ("F * (v > 0)", "true or false"),
        ("F + 1", "mixes the units"),
        ("F + q", "'q' is not known here"),
        ("F / m", r"expected kg\*m/s\^2"),
    ],
)
def test_wrong_units_are_named(text: str, words: str) -> None:
    with pytest.raises(ExpressionError, match=words):
        check_unit(parse(text), SYMBOLS, dimension("N"))


@pytest.mark.parametrize("unit", ["mm", "deg", "foo", "", "degC", "2", "kg*", "1/0", "rpm", "[", "N m m)"])
def test_units_that_are_not_coherent_si_are_refused(unit: str) -> None:
    with pytest.raises(UnitError):
        dimension(unit)


@pytest.mark.parametrize(
    "unit", ["9**9**9", "kg**9 **9 **9", "kg**(9**9**9)", "kg^(9)^9^9", "m**99999", "m**9e9"]
)
def test_a_power_that_is_no_small_number_is_never_worked_out(unit: str) -> None:
    with pytest.raises(UnitError, match="a power is a plain number of few digits"):
        dimension(unit)


@pytest.mark.parametrize(
    ("unit", "same"),
    [
        ("(N*m)/(1)**3", "N*m"),
        ("m ** 2", "m^2"),
        ("s**-1", "Hz"),
        ("(m/s)**2/m", "m/s**2"),
        ("m**(1/2)", "m**0.5"),
    ],
)
def test_powers_that_are_small_numbers_are_read(unit: str, same: str) -> None:
    assert dimension(unit) == dimension(same)


@given(st.text(max_size=12))
def test_any_unit_text_is_a_dimension_or_a_refusal(unit: str) -> None:
    try:
        dimension(unit)
    except UnitError:
        return


def test_channel_units() -> None:
    assert channel_unit("body_acceleration_m_s2") == "m/s^2"
    assert channel_unit("shaft_torque_n_m") == "N*m"
    assert channel_unit("angle_rad") == "rad"
    with pytest.raises(UnitError, match="does not end in a unit"):
        channel_unit("speed")


@pytest.mark.parametrize(
    "text",
    ["-9.81 / l * sin(a) - 0.02 * w", "(12 - r * i) * w ** 2 / k / l * tanh(w / 0.05)", "max(w ** 2, 3)"],
)
def test_a_number_may_stand_for_something_with_a_unit(text: str) -> None:
    symbols = {
        "l": dimension("m"),
        "a": PURE,
        "w": dimension("rad/s"),
        "r": dimension("ohm"),
        "i": dimension("A"),
        "k": dimension("V/m"),
    }
    with pytest.raises(ExpressionError):
        check_unit(parse(text), symbols, dimension("rad/s^2"))
    check_formula(parse(text), symbols, dimension("rad/s^2"))


@pytest.mark.parametrize(
    "text", ["2 * l * w", "0.5 * w", "w ** 2.5", "sin(2 * w)", "w ** 2 + 4 * w", "where(1, w, 0) * w"]
)
def test_a_plain_factor_mends_no_unit(text: str) -> None:
    symbols = {"l": dimension("m"), "w": dimension("rad/s")}
    with pytest.raises(ExpressionError):
        check_formula(parse(text), symbols, dimension("rad/s^2"))
