"""Equations as a person writes them."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ground.typeset import Equation, as_text, equations_of, mathml, plain
from hal.config import config_root
from sim_hal.plant.expressions import Name, Node, Num, Op, parse
from sim_hal.plant.simulate import load_plant


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("a - (b - c)", "a − (b − c)"),
        ("(a + b) * c / d", "(a + b) · c/d".replace("(a + b) · c", "((a + b) · c)")),
        ("theta_1 ** 2", "θ_1²"),
        ("-omega * abs(x)", "−ω · |x|"),
        ("sqrt(h)", "√h"),
        ("where(v > 0, a, b)", "where(v > 0, a, b)"),
        ("x ** n", "x^n"),
    ],
)
def test_formulas_read_as_they_are_written_by_hand(text: str, shown: str) -> None:
    assert plain(parse(text)) == shown


def test_an_effect_stands_in_the_rate_and_below_with_its_law() -> None:
    plant = load_plant(config_root() / "plant" / "emps_published.yaml")
    lines = as_text(equations_of(plant))
    (rate,) = [right for left, right, _ in lines if left == "dv/dt"]
    assert "F_coulomb_friction" in rate
    assert ("F_coulomb_friction", "−F_c · sign(v)", "force balance") in lines


@pytest.mark.parametrize("file", sorted((config_root() / "plant").glob("*.yaml")), ids=lambda path: path.stem)
def test_every_plant_of_ours_is_typeset(file: Path) -> None:
    for equation in equations_of(load_plant(file)):
        ElementTree.fromstring(mathml(equation))


nodes = st.recursive(
    st.one_of(st.sampled_from("xyzw").map(Name), st.floats(0.1, 9.0).map(Num)),
    lambda inner: st.builds(lambda op, a, b: Op(op, (a, b)), st.sampled_from("+-*/"), inner, inner),
    max_leaves=8,
)


def value(node: Node) -> float:
    """A node's value with some numbers for its names."""
    if isinstance(node, Num):
        return node.value
    if isinstance(node, Name):
        return {"x": 1.37, "y": 2.11, "z": 0.73, "w": 3.19}[node.id]
    a, b = map(value, node.args)
    return {"+": a + b, "-": a - b, "*": a * b, "/": a / b if b else float("nan")}[node.op]


@given(node=nodes)
def test_brackets_stand_where_they_must(node: Node) -> None:
    """Read back, the text means the same."""
    expected = value(node)
    if expected != expected or abs(expected) > 1e9:
        return
    text = plain(node).replace("−", "-").replace("·", "*").replace("^", "**")
    assert value(parse(text)) == pytest.approx(expected, rel=1e-9, abs=1e-9)
    ElementTree.fromstring(mathml(Equation(Name("x"), node)))
