"""The formula language of plant files: text to typed nodes by whitelist, and back to text.

Python's `ast` only splits the text; Python never evaluates or executes anything of it. What is allowed is
listed in `FUNCTIONS` and `_BINARY`; anything else is refused with the place in the text.
"""

from __future__ import annotations

import ast
import math
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache

MAX_LENGTH = 2000  # characters; keeps Python's own parser far from its limits
MAX_DEPTH = 100

#: Functions with the number of arguments they take (a maximum of None: any number from the minimum).
FUNCTIONS: Mapping[str, tuple[int, int | None]] = {
    **dict.fromkeys(("abs", "sign", "sqrt", "exp", "log", "sin", "cos", "tan", "tanh"), (1, 1)),
    "min": (2, None),
    "max": (2, None),
    "where": (3, 3),
    "rate": (1, 1),
    "since": (1, 1),
}
_BINARY: Mapping[type[ast.operator], str] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.Pow: "**",
}
_COMPARE: Mapping[type[ast.cmpop], str] = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">="}
_PRECEDENCE = {"or": 1, "and": 2, "not": 3, "<": 4, "<=": 4, ">": 4, ">=": 4}
_PRECEDENCE |= {"+": 5, "-": 5, "*": 6, "/": 6, "neg": 7, "**": 8}
_ATOM = 9


class ExpressionError(ValueError):
    """A formula was refused. `str()` gives the reason, the text and a caret line under the place."""

    def __init__(self, reason: str, text: str, column: int) -> None:
        shown = text.replace("\t", " ")
        super().__init__(f"{reason}\n    {shown}\n    {' ' * column}^")
        self.reason = reason
        self.text = text
        self.column = column


@dataclass(frozen=True, slots=True)
class Num:
    """A number."""

    value: float


@dataclass(frozen=True, slots=True)
class Name:
    """A symbol: input, state, parameter, definition, flag, or what an effect brings along."""

    id: str


@dataclass(frozen=True, slots=True)
class Op:
    """An operator or function with its operands; `op` is a key of `FUNCTIONS` or an operator's sign."""

    op: str
    args: tuple[Node, ...]


Node = Num | Name | Op


@lru_cache(maxsize=4096)
def parse(text: str) -> Node:
    """Read one formula. Raises `ExpressionError` that points into the text."""
    if len(text) > MAX_LENGTH:
        raise ExpressionError(f"the formula is longer than {MAX_LENGTH} characters", text[:60] + "…", 0)
    if not text.strip():
        raise ExpressionError("the formula is empty", text, 0)
    text = text.replace("\n", " ")  # a long formula may be folded in its file
    lead = len(text) - len(text.lstrip())
    try:
        with warnings.catch_warnings():  # "1if x" and the like warn before they are refused
            warnings.simplefilter("ignore")
            tree = ast.parse(text.strip(), mode="eval").body
    except SyntaxError as error:
        column = max((error.offset or 1) - 1, 0)
        raise ExpressionError(f"not a formula ({error.msg})", text, lead + column) from None
    except (ValueError, MemoryError, RecursionError):
        raise ExpressionError("not a formula", text, lead) from None
    return _Reader(text, lead).node(tree, 0)


class _Reader:
    """Turns Python's syntax tree into nodes, refusing what is not on the list."""

    def __init__(self, text: str, lead: int) -> None:
        self.text = text
        self.lead = lead

    def refuse(self, reason: str, at: ast.expr) -> ExpressionError:
        before = self.text.strip().encode()[: at.col_offset].decode(errors="replace")
        return ExpressionError(reason, self.text, self.lead + len(before))

    def node(self, at: ast.expr, depth: int) -> Node:
        if depth > MAX_DEPTH:
            raise self.refuse(f"nested more than {MAX_DEPTH} deep", at)
        match at:
            case ast.Constant(value=value):
                return self.number(value, at)
            case ast.Name(id=name):
                return Num(math.pi) if name == "pi" else Name(name)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return Op("neg", (self.node(operand, depth + 1),))
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return self.node(operand, depth + 1)
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return Op("not", (self.node(operand, depth + 1),))
            case ast.BinOp(left=left, op=operator, right=right) if type(operator) in _BINARY:
                operands = (self.node(left, depth + 1), self.node(right, depth + 1))
                return Op(_BINARY[type(operator)], operands)
            case ast.BoolOp(op=boolean, values=values):
                name = "and" if isinstance(boolean, ast.And) else "or"
                return Op(name, tuple(self.node(value, depth + 1) for value in values))
            case ast.Compare(left=left, ops=[operator], comparators=[right]) if type(operator) in _COMPARE:
                operands = (self.node(left, depth + 1), self.node(right, depth + 1))
                return Op(_COMPARE[type(operator)], operands)
            case ast.Call():
                return self.call(at, depth)
        raise self.refuse(f"{type(at).__name__} is not allowed in a formula", at)

    def number(self, value: object, at: ast.expr) -> Num:
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise self.refuse(f"{value!r} is not a number", at)
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise self.refuse("the number is too large", at)
        return Num(number)

    def call(self, at: ast.Call, depth: int) -> Op:
        if not isinstance(at.func, ast.Name) or at.func.id not in FUNCTIONS:
            known = ", ".join(sorted(FUNCTIONS))
            raise self.refuse(f"not a function known here (known: {known})", at)
        if at.keywords or any(isinstance(arg, ast.Starred) for arg in at.args):
            raise self.refuse("arguments are given by position only", at)
        low, high = FUNCTIONS[at.func.id]
        if len(at.args) < low or (high is not None and len(at.args) > high):
            count = f"{low}" if low == high else f"{low} or more"
            raise self.refuse(f"{at.func.id} takes {count} argument(s), not {len(at.args)}", at)
        args = tuple(self.node(arg, depth + 1) for arg in at.args)
        if at.func.id in ("rate", "since") and not isinstance(args[0], Name):
            raise self.refuse(f"{at.func.id} takes a name", at.args[0])
        return Op(at.func.id, args)


def to_text(node: Node) -> str:
    """The formula as text; `parse(to_text(node)) == node` for every node that `parse` can give."""
    return _print(node)[0]


def _print(node: Node) -> tuple[str, int]:
    """Text and binding strength of a node."""
    match node:
        case Num(value):
            text = repr(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)
            return text, _ATOM
        case Name(name):
            return name, _ATOM
        case Op(op, args) if op in FUNCTIONS:
            return f"{op}({', '.join(to_text(arg) for arg in args)})", _ATOM
        case Op("neg" | "not" as op, (arg,)):
            sign = "-" if op == "neg" else "not "
            return sign + _wrap(arg, _PRECEDENCE[op]), _PRECEDENCE[op]
        case Op("**", (base, power)):
            return f"{_wrap(base, _ATOM)} ** {_wrap(power, 7)}", 8
        case Op(op, args):
            strength = _PRECEDENCE[op]
            loose = 0 if op in "+-*/" else 1
            parts = [_wrap(args[0], strength + loose), *(_wrap(arg, strength + 1) for arg in args[1:])]
            return f" {op} ".join(parts), strength
    raise AssertionError(node)


def _wrap(node: Node, strength: int) -> str:
    text, own = _print(node)
    return text if own >= strength else f"({text})"


def walk(node: Node) -> Iterator[Node]:
    """The node and all nodes under it."""
    yield node
    if isinstance(node, Op):
        for arg in node.args:
            yield from walk(arg)


def names(node: Node) -> set[str]:
    """All symbols that occur."""
    return {item.id for item in walk(node) if isinstance(item, Name)}


def rename(node: Node, new: Callable[[str], Node]) -> Node:
    """The node with each symbol replaced by what `new` gives for it."""
    if isinstance(node, Name):
        return new(node.id)
    if isinstance(node, Op):
        return Op(node.op, tuple(rename(arg, new) for arg in node.args))
    return node


def summands(node: Node) -> list[Node]:
    """What the node adds up, signs aside; what a sum is multiplied with or divided by goes with each of its parts."""
    if isinstance(node, Op) and node.op in ("+", "-", "neg"):
        return [part for operand in node.args for part in summands(operand)]
    if isinstance(node, Op) and node.op in ("*", "/"):
        first, second = node.args
        parts = summands(first)
        if len(parts) == 1 and node.op == "*":
            return [Op("*", (first, part)) for part in summands(second)]
        return [Op(node.op, (part, second)) for part in parts]
    return [node]


def add(*nodes: Node) -> Node:
    """The sum of the nodes, zeros left out."""
    terms = [node for node in nodes if node != Num(0.0)]
    total = terms[0] if terms else Num(0.0)
    for term in terms[1:]:
        total = Op("+", (total, term))
    return total


def multiply(*nodes: Node) -> Node:
    """The product of the nodes, ones left out."""
    factors = [node for node in nodes if node != Num(1.0)]
    total = factors[0] if factors else Num(1.0)
    for factor in factors[1:]:
        total = Op("*", (total, factor))
    return total


def linear_in(node: Node, states: frozenset[str]) -> tuple[dict[str, Node], Node]:
    """Coefficients by state and the constant of an expression linear in `states`.

    Raises `ExpressionError` when it is not linear.
    """
    if isinstance(node, Name) and node.id in states:
        return {node.id: Num(1.0)}, Num(0.0)
    if not names(node) & states:
        return {}, node
    if isinstance(node, Op):
        match node.op, node.args:
            case "+" | "-", (left, right):
                second = right if node.op == "+" else Op("neg", (right,))
                return _linear_sum(linear_in(left, states), linear_in(second, states))
            case "neg", (arg,):
                return _linear_scaled(linear_in(arg, states), lambda term: Op("neg", (term,)))
            case "*", (left, right) if not names(left) & states:
                return _linear_scaled(linear_in(right, states), lambda term: multiply(left, term))
            case "*", (left, right) if not names(right) & states:
                return _linear_scaled(linear_in(left, states), lambda term: multiply(term, right))
            case "/", (left, right) if not names(right) & states:
                return _linear_scaled(linear_in(left, states), lambda term: Op("/", (term, right)))
    raise ExpressionError("must be linear in the states", to_text(node), 0)


_Linear = tuple[dict[str, Node], Node]


def _linear_sum(first: _Linear, second: _Linear) -> _Linear:
    merged = {
        key: add(first[0].get(key, Num(0.0)), second[0].get(key, Num(0.0))) for key in first[0] | second[0]
    }
    return merged, add(first[1], second[1])


def _linear_scaled(linear: _Linear, scale: Callable[[Node], Node]) -> _Linear:
    constant = linear[1] if linear[1] == Num(0.0) else scale(linear[1])
    return {key: scale(term) for key, term in linear[0].items()}, constant
