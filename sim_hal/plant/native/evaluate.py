"""Expressions of translated functions: variables, elements of arrays, calls, choices."""

from __future__ import annotations

import ast
import builtins
import inspect
from collections.abc import Callable, Sequence
from typing import Any, get_type_hints

from llvmlite import ir

from sim_hal.plant.native.formulas import FORMULAS, as_float, binary, compare
from sim_hal.plant.native.values import (
    BOOL,
    FLOAT,
    INT,
    Array,
    Kind,
    LLVMType,
    Number,
    TranslationError,
    Value,
    View,
    constant,
    flat,
    kind_of,
    returned,
)

Function = Callable[..., Any]


def signature_of(function: Function) -> list[Any]:
    """Types of a function's parameters and, last, of what it returns."""
    hints = get_type_hints(function, include_extras=True)
    names = list(inspect.signature(function).parameters)
    if set(hints) != {*names, "return"}:
        raise TranslationError(f"{function.__name__}: parameters and result must be annotated")
    return [*(kind_of(hints[name]) for name in names), returned(hints["return"])]


class Evaluation:
    """Values within one function, made by instructions at the builder's present place."""

    def __init__(
        self, translated: Callable[[Function], LLVMType], function: Function, made: LLVMType
    ) -> None:
        self._translated = translated
        self._function = function
        self._made = made
        self._entry = ir.IRBuilder(made.append_basic_block("entry"))  # room for variables
        self._b = ir.IRBuilder(made.append_basic_block())
        self._variables: dict[str, tuple[Kind, list[Number]]] = {}

    def _set(self, name: str, value: Value) -> None:
        """Give a variable a value; the first one decides upon its type."""
        kind: Kind = value.kind if isinstance(value, View) else value.type
        if name not in self._variables:
            self._variables[name] = kind, [self._entry.alloca(part, name=name) for part in flat(kind)]
        own, places = self._variables[name]
        if isinstance(value, View):
            if own != kind:
                raise TranslationError(f"{name} is no such array")
            parts = [value.pointer, *value.sizes]
        else:
            parts = [self._as(value, own)]
        for part, place in zip(parts, places, strict=True):
            self._b.store(part, place)

    def _as(self, value: Number, kind: Kind) -> Number:
        """The number as one of a type; only an int may become another, a float."""
        if value.type == kind:
            return value
        if kind == FLOAT and value.type == INT:
            return as_float(self._b, value)
        raise TranslationError(f"{value.type} where {kind} is needed")

    def _several(self, node: ast.expr) -> list[Value]:
        """Values of what gives more than one."""
        if isinstance(node, ast.Tuple):
            return [self._value(part) for part in node.elts]
        whole = self._value(node)
        if isinstance(whole, View) or not isinstance(whole.type, ir.LiteralStructType):
            raise TranslationError(f"{ast.unparse(node)} is one value")
        return [self._b.extract_value(whole, place) for place in range(len(whole.type.elements))]

    def _number(self, node: ast.expr) -> Number:
        return scalar(self._value(node))

    def _value(self, node: ast.expr) -> Value:
        match node:
            case ast.Name(id=name) if name in self._variables:
                return self._variable(name)
            case ast.Name() | ast.Attribute():
                return constant(self._known(node))
            case ast.Constant(value=value):
                return constant(value)
            case ast.BinOp(left=left, op=op, right=right):
                return binary(self._b, op, self._number(left), self._number(right))
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                value = self._number(operand)
                return self._b.fneg(value) if value.type == FLOAT else self._b.neg(value)
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return self._b.not_(self._truth(operand))
            case ast.Compare(left=left, ops=ops, comparators=others):
                return self._compare([left, *others], ops)
            case ast.BoolOp(op=op, values=values):
                return self._either(values, isinstance(op, ast.Or))
            case ast.IfExp(test=test, body=body, orelse=orelse):
                return self._choice(self._truth(test), body, orelse)
            case ast.Call():
                return self._call(node)
            case ast.Subscript(
                value=ast.Attribute(value=array, attr="shape"), slice=ast.Constant(value=place)
            ):
                return self._array(array).sizes[int(str(place))]
            case ast.Subscript():
                return self._element(node)
        raise TranslationError(f"no such expression: {ast.unparse(node)}")

    def _known(self, node: ast.expr) -> Any:
        """What a name means that is no variable."""
        if isinstance(node, ast.Attribute):
            return getattr(self._known(node.value), node.attr)
        assert isinstance(node, ast.Name)
        known = inspect.unwrap(self._function).__globals__
        if node.id not in known and not hasattr(builtins, node.id):
            raise TranslationError(f"{node.id} is not known here")
        return known.get(node.id, getattr(builtins, node.id, None))

    def _variable(self, name: str) -> Value:
        kind, places = self._variables[name]
        parts = [self._b.load(place, typ=part) for place, part in zip(places, flat(kind), strict=True)]
        return View(kind.element, parts[0], tuple(parts[1:])) if isinstance(kind, Array) else parts[0]

    def _truth(self, node: ast.expr) -> Number:
        return self._as(self._number(node), BOOL)

    def _compare(self, nodes: Sequence[ast.expr], ops: Sequence[ast.cmpop]) -> Number:
        values = [self._number(node) for node in nodes]
        holds = [compare(self._b, op, *values[place : place + 2]) for place, op in enumerate(ops)]
        whole = holds[0]
        for other in holds[1:]:
            whole = self._b.and_(whole, other)
        return whole

    def _either(self, nodes: Sequence[ast.expr], found: bool) -> Number:
        """The first of several conditions that is `found`, or the last: those behind it are not asked."""
        end = self._made.append_basic_block()
        known = []
        for node in nodes:
            value = self._truth(node)
            known.append((value, self._b.block))
            if node is nodes[-1]:
                self._b.branch(end)
            else:
                later = self._made.append_basic_block()
                self._b.cbranch(value, *((end, later) if found else (later, end)))
                self._b.position_at_end(later)
        self._b.position_at_end(end)
        return self._joined(known)

    def _choice(self, test: Number, body: ast.expr, orelse: ast.expr) -> Number:
        then, other, end = (self._made.append_basic_block() for _ in range(3))
        self._b.cbranch(test, then, other)
        found = []
        for block, node in ((then, body), (other, orelse)):
            self._b.position_at_end(block)
            found.append((self._number(node), self._b.block))
        floats = FLOAT in (value.type for value, _ in found)
        for place, (value, block) in enumerate(found):
            self._b.position_at_end(block)
            found[place] = (as_float(self._b, value) if floats else value, block)
            self._b.branch(end)
        self._b.position_at_end(end)
        return self._joined(found)

    def _joined(self, values: Sequence[tuple[Number, Any]]) -> Number:
        phi = self._b.phi(values[0][0].type)
        for value, block in values:
            phi.add_incoming(self._as(value, phi.type), block)
        return phi

    def _call(self, node: ast.Call) -> Value:
        function = self._known(node.func)
        arguments = [self._value(argument) for argument in node.args]
        if function is len:
            return self._array(node.args[0]).sizes[0]
        if function in FORMULAS:
            return FORMULAS[function](self._b, *(scalar(argument) for argument in arguments))
        made = self._translated(function)
        *kinds, _ = signature_of(inspect.unwrap(function))
        if node.keywords or len(kinds) != len(arguments):
            raise TranslationError(f"{ast.unparse(node)}: {len(kinds)} arguments needed")
        parts: list[Number] = []
        for kind, argument in zip(kinds, arguments, strict=True):
            if isinstance(argument, View):
                if argument.kind != kind:
                    raise TranslationError(f"{ast.unparse(node)}: wrong kind of array")
                parts += [argument.pointer, *argument.sizes]
            else:
                parts.append(self._as(argument, kind))
        return self._b.call(made, parts)

    def _array(self, node: ast.expr) -> View:
        value = self._value(node)
        if not isinstance(value, View):
            raise TranslationError(f"{ast.unparse(node)} is no array")
        return value

    def _offset(self, node: ast.Subscript) -> tuple[View, Number, int]:
        """The array, how many elements from its start, and by how many numbers it is indexed."""
        array = self._array(node.value)
        indices = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        if len(indices) > len(array.sizes):
            raise TranslationError(f"{ast.unparse(node)}: too many indices")
        offset: Number = constant(0)
        for place, size in enumerate(array.sizes):
            offset = self._b.mul(offset, size) if place else offset
            if place < len(indices):
                index = self._as(self._number(indices[place]), INT)
                offset = self._b.add(offset, index) if place else index
        return array, offset, len(indices)

    def _place(self, node: ast.Subscript) -> tuple[Number, LLVMType]:
        """Where an element is, and its type."""
        array, offset, count = self._offset(node)
        if count < len(array.sizes):
            raise TranslationError(f"{ast.unparse(node)} is no number")
        return self._b.gep(array.pointer, [offset], source_etype=array.element), array.element

    def _element(self, node: ast.Subscript) -> Value:
        array, offset, count = self._offset(node)
        place = self._b.gep(array.pointer, [offset], source_etype=array.element)
        if count < len(array.sizes):
            return View(array.element, place, array.sizes[count:])
        return self._b.load(place, typ=array.element)


def scalar(value: Value) -> Number:
    if isinstance(value, View):
        raise TranslationError("an array where a number is needed")
    return value
