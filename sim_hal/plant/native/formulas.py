"""Arithmetic of translated code, as Python and NumPy have it: what operators and known functions do to numbers."""

from __future__ import annotations

import ast
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from llvmlite import ir

from sim_hal.plant.native.values import BOOL, FLOAT, INT, Builder, Number, TranslationError, constant

_COMPARISONS = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}
_EXTERNAL = {
    np.exp: "exp",
    np.log: "log",
    np.log2: "log2",
    np.sin: "sin",
    np.cos: "cos",
    np.tan: "tan",
    np.tanh: "tanh",
}
_INTRINSIC = (np.sqrt, np.floor, np.ceil)


def as_float(b: Builder, value: Number) -> Number:
    """The number as a float."""
    return value if value.type == FLOAT else b.sitofp(as_int(b, value), FLOAT)


def as_int(b: Builder, value: Number) -> Number:
    """The number as an int, cut off towards 0."""
    if value.type == FLOAT:
        return b.fptosi(value, INT)
    return b.zext(value, INT) if value.type == BOOL else value


def alike(b: Builder, values: Sequence[Number]) -> list[Number]:
    """Numbers as floats if one of them is, else as ints; bools stay such among themselves."""
    kinds = {value.type for value in values}
    if kinds == {BOOL}:
        return list(values)
    convert = as_float if FLOAT in kinds else as_int
    return [convert(b, value) for value in values]


def binary(b: Builder, op: ast.operator, left: Number, right: Number) -> Number:
    """Value of an arithmetic operation."""
    if isinstance(op, ast.Div):
        return b.fdiv(as_float(b, left), as_float(b, right))
    if isinstance(op, ast.Pow):
        return external(b, "pow", (as_float(b, left), as_float(b, right)))
    floats = FLOAT in (left.type, right.type)
    left, right = alike(b, (as_int(b, left), right) if not floats else (left, right))
    match op:
        case ast.Add():
            return b.fadd(left, right) if floats else b.add(left, right)
        case ast.Sub():
            return b.fsub(left, right) if floats else b.sub(left, right)
        case ast.Mult():
            return b.fmul(left, right) if floats else b.mul(left, right)
        case ast.Mod() if not floats:  # of the sign of the divisor
            rest = b.srem(left, right)
            return b.srem(b.add(rest, right), right)
    raise TranslationError("no such operation")


def compare(b: Builder, op: ast.cmpop, left: Number, right: Number) -> Number:
    """Whether a comparison holds; never with what is not a number, but for !=."""
    if type(op) not in _COMPARISONS:
        raise TranslationError("no such comparison")
    sign = _COMPARISONS[type(op)]
    left, right = alike(b, (left, right))
    if left.type != FLOAT:
        return b.icmp_signed(sign, left, right)
    return b.fcmp_unordered(sign, left, right) if sign == "!=" else b.fcmp_ordered(sign, left, right)


def external(b: Builder, name: str, operands: Sequence[Number]) -> Number:
    """Value of a function of floats that the C library or LLVM has."""
    known = b.module.globals.get(name)
    if known is None:
        known = ir.Function(b.module, ir.FunctionType(FLOAT, [FLOAT] * len(operands)), name)
    return b.call(known, operands)


def _absolute(b: Builder, x: Number) -> Number:
    if x.type == FLOAT:
        return external(b, "llvm.fabs.f64", (x,))
    return b.select(b.icmp_signed("<", x, constant(0)), b.neg(x), x)


def _least(b: Builder, *values: Number) -> Number:
    return _extreme(b, "<", values)


def _most(b: Builder, *values: Number) -> Number:
    return _extreme(b, ">", values)


def _extreme(b: Builder, sign: str, values: Sequence[Number]) -> Number:
    """Like Python's own min and max: the first stays unless a later one is beyond it."""
    best, *others = alike(b, values)
    for other in others:
        beyond = b.fcmp_ordered(sign, other, best) if best.type == FLOAT else b.icmp_signed(sign, other, best)
        best = b.select(beyond, other, best)
    return best


def _sign(b: Builder, x: Number) -> Number:
    zero = constant(0.0)
    found = b.select(b.fcmp_ordered("==", x, zero), zero, x)  # not a number stays such
    found = b.select(b.fcmp_ordered("<", x, zero), constant(-1.0), found)
    return b.select(b.fcmp_ordered(">", x, zero), constant(1.0), found)


def _finite(b: Builder, x: Number) -> Number:
    return b.fcmp_ordered("<", _absolute(b, as_float(b, x)), constant(float("inf")))


def _truth(b: Builder, x: Number) -> Number:
    if x.type != BOOL:
        raise TranslationError("bool of what is no bool")
    return x


def _called(name: str) -> Callable[..., Number]:
    return lambda b, x: external(b, name, (as_float(b, x),))


#: What functions do that are not translated.
FORMULAS: dict[Any, Callable[..., Number]] = {
    abs: _absolute,
    min: _least,
    max: _most,
    bool: _truth,
    int: as_int,
    float: as_float,
    np.sign: _sign,
    np.isfinite: _finite,
    **{function: _called(function.__name__) for function in _EXTERNAL},
    **{function: _called(f"llvm.{function.__name__}.f64") for function in _INTRINSIC},
}
