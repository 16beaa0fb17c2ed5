"""The equations of a plant as a person writes them: for the terminal as text, for a page as MathML.

MathML Core is what browsers show without help. The formulas are shown as the plant file has them: a computer algebra
system would rearrange them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from sim_hal.plant.expressions import Name, Node, Num, Op, add, multiply, parse, to_text
from sim_hal.plant.plant import check_use
from sim_hal.plant.simulate import EffectUse, Plant

_GREEK_NAMES = (
    *("alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "kappa", "lambda", "mu", "nu"),
    *("xi", "pi", "rho", "sigma", "tau", "phi", "chi", "psi", "omega"),
)
_GREEK = dict(zip(_GREEK_NAMES, "αβγδεζηθκλμνξπρστφχψω", strict=True))
_SIGNS = {"*": "·", "<=": "≤", ">=": "≥", "and": "∧", "or": "∨", "-": "−"}
_LEVEL = {"or": 1, "and": 2, "not": 3, "<": 4, "<=": 4, ">": 4, ">=": 4, "+": 5, "-": 5, "*": 6, "neg": 6}
_LEVEL |= {"/": 7, "**": 8}
_ATOM = 9


@dataclass(frozen=True)
class Equation:
    """One line: what stands left, its formula, and where it comes from (empty for the plant's own)."""

    left: Node
    right: Node
    origin: str = ""


def equations_of(plant: Plant) -> list[Equation]:
    """Rates, definitions and outputs as the plant file gives them, then what its effects add."""
    structure = plant.structure
    missing = missing_terms(plant)
    found = []
    for state, rate in structure.rates.items():
        found.append(Equation(Op("rate", (Name(state),)), add(rate, *missing.get(state, ()))))
    found += [Equation(Name(name), item.value) for name, item in structure.definitions.items()]
    found += [Equation(Name(name), value) for name, value in structure.outputs.items() if value != Name(name)]
    for use in plant.effects:
        found += effect_equations(plant, use)
    return found


def missing_terms(plant: Plant) -> dict[str, list[Node]]:
    """By state, the forces of the plant's effects as names, times what a force does to the rate."""
    terms: dict[str, list[Node]] = {}
    for use in plant.effects:
        form, balance = check_use(plant, use), plant.structure.balances.get(use.equation)
        if balance is not None and (form.force or form.dry or form.inertia):
            for state, response in balance.per_force.items():
                terms.setdefault(state, []).append(multiply(response, force_of(use)))
    return terms


def force_of(use: EffectUse) -> Name:
    """The name of the force that an effect brings."""
    return Name(f"F_{use.physics_id}")


def effect_equations(plant: Plant, use: EffectUse) -> list[Equation]:
    """What one effect adds, in its own symbols."""
    form, label = check_use(plant, use), (use.channel or use.equation).replace("_", " ")
    force = force_of(use)
    found = [Equation(force, parse(form.force), label)] if form.force else []
    if form.dry and form.dry[0] == form.dry[1]:
        dry = Op("neg", (multiply(parse(form.dry[0]), Op("sign", (Name("v"),))),))
        found.append(Equation(force, dry, label))
    if form.inertia:
        lost = Op("neg", (multiply(parse(form.inertia), Op("rate", (Name("v"),))),))
        found.append(Equation(force, lost, label))
    if form.sensor:
        found.append(Equation(Name(use.channel or "y"), parse(form.sensor), label))
    found += [
        Equation(Op("rate", (Name(name),)), parse(state.rate), label) for name, state in form.states.items()
    ]
    return found


def as_text(equations: Sequence[Equation]) -> list[tuple[str, str, str]]:
    """Left side, right side and origin of each equation for a terminal."""
    return [(plain(e.left), plain(e.right), e.origin) for e in equations]


def plain(node: Node) -> str:
    """A formula in Unicode: ẋ as dx/dt, powers raised where they are digits, Greek letters."""
    if isinstance(node, Op) and node.op == "rate":
        return f"d{plain(node.args[0])}/dt"
    if isinstance(node, Name):
        return symbol(node.id)
    if isinstance(node, Num):
        return to_text(node)
    match node.op, node.args:
        case "**", (base, Num(value=power)) if power in range(10):
            return _held(base, _ATOM) + "⁰¹²³⁴⁵⁶⁷⁸⁹"[int(power)]
        case "neg", (arg,):
            return f"−{_held(arg, _LEVEL['neg'])}"
        case "abs", (arg,):
            return f"|{plain(arg)}|"
        case "sqrt", (arg,):
            return f"√{_held(arg, _ATOM)}"
        case op, (left, right) if op in _LEVEL:
            level = _LEVEL[op]
            join = "/" if op == "/" else "^" if op == "**" else f" {_SIGNS.get(op, op)} "
            return _held(left, level) + join + _held(right, level + (op in "-/**"))
    return f"{node.op}({', '.join(map(plain, node.args))})"


def _held(node: Node, level: int) -> str:
    """A part of a formula, in brackets where it binds more loosely than its place."""
    return f"({plain(node)})" if level_of(node) < level else plain(node)


def level_of(node: Node) -> int:
    """How tightly a node binds."""
    return _LEVEL.get(node.op, _ATOM) if isinstance(node, Op) else _ATOM


def symbol(name: str) -> str:
    """A name with its Greek letter."""
    head, _, tail = name.partition("_")
    digits = head.rstrip("0123456789")
    letter = _GREEK.get(digits, digits) + head[len(digits) :]
    return letter + (f"_{tail}" if tail else "")


def mathml(equation: Equation) -> str:
    """One equation as a MathML element."""
    note = f"<mspace width='2em'/><mtext>{escape(equation.origin)}</mtext>" if equation.origin else ""
    body = f"{_math(equation.left)}<mo>=</mo>{_math(equation.right)}{note}"
    return f'<math display="block"><mrow>{body}</mrow></math>'


def _math(node: Node) -> str:
    if isinstance(node, Num):
        return f"<mn>{escape(to_text(node))}</mn>"
    if isinstance(node, Name):
        return _math_name(node.id)
    match node.op, node.args:
        case "rate", (arg,):
            return f"<mover accent='true'>{_math(arg)}<mo>˙</mo></mover>"
        case "/", (above, below):
            return f"<mfrac><mrow>{_math(above)}</mrow><mrow>{_math(below)}</mrow></mfrac>"
        case "**", (base, power):
            return f"<msup><mrow>{_math_held(base, _ATOM)}</mrow><mrow>{_math(power)}</mrow></msup>"
        case "sqrt", (arg,):
            return f"<msqrt>{_math(arg)}</msqrt>"
        case "neg", (arg,):
            return f"<mo>−</mo>{_math_held(arg, _LEVEL['neg'])}"
        case "abs", (arg,):
            return f"<mrow><mo>|</mo>{_math(arg)}<mo>|</mo></mrow>"
        case op, (left, right) if op in _LEVEL:
            level = _LEVEL[op]
            sign = f"<mo>{escape(_SIGNS.get(op, op))}</mo>"
            return _math_held(left, level) + sign + _math_held(right, level + (op == "-"))
    inner = "<mo>,</mo>".join(map(_math, node.args))
    return f"<mi>{escape(node.op)}</mi><mrow><mo>(</mo>{inner}<mo>)</mo></mrow>"


def _math_held(node: Node, level: int) -> str:
    own = _LEVEL.get(node.op, _ATOM) if isinstance(node, Op) and node.op != "/" else _ATOM
    return f"<mrow><mo>(</mo>{_math(node)}<mo>)</mo></mrow>" if own < level else _math(node)


def _math_name(name: str) -> str:
    head, _, tail = symbol(name).partition("_")
    letter = f"<mi>{escape(head)}</mi>"
    return f"<msub>{letter}<mtext>{escape(tail)}</mtext></msub>" if tail else letter
