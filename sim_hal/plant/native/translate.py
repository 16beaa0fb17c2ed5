"""From Python functions to LLVM: as much of Python as the plant's engine is written in, and no more.

Translated are functions of annotated numbers and arrays with assignments, `if`, `while`, `for` in `range`, `break`,
`continue`, `return`, arithmetic, comparisons, indexing, and calls of each other and of what `formulas` lists. A
variable keeps the type that it first got. Indices are not checked and must not be negative; an array that is indexed
by fewer numbers than it has dimensions gives a view. Array parameters of a function must not overlap. All else is
refused with its place.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from llvmlite import ir

from sim_hal.plant.native.evaluate import Evaluation, Function, scalar, signature_of
from sim_hal.plant.native.formulas import binary
from sim_hal.plant.native.values import (
    INT,
    POINTER,
    VOID,
    Array,
    Kind,
    LLVMType,
    TranslationError,
    Value,
    View,
    constant,
    flat,
)


class Translation:
    """An LLVM module that grows by each function asked for and all that it calls."""

    def __init__(self, name: str) -> None:
        self.module = ir.Module(name=name)
        self._known: dict[Function, Any] = {}

    def function(self, function: Function) -> LLVMType:
        """The translated function."""
        function = inspect.unwrap(function)
        if function not in self._known:
            *parameters, result = signature_of(function)
            kinds = [part for kind in parameters for part in flat(kind)]
            name = f"{function.__module__}.{function.__name__}"
            made = ir.Function(self.module, ir.FunctionType(result, kinds), name)
            made.linkage = "internal"
            for argument in made.args:
                if argument.type == POINTER:
                    argument.add_attribute("noalias")
            self._known[function] = made
            _Body(self.function, function, made).translate(parameters)
        return self._known[function]


class _Body(Evaluation):
    """Translates one function's statements, one after the other."""

    def __init__(
        self, translated: Callable[[Function], LLVMType], function: Function, made: LLVMType
    ) -> None:
        super().__init__(translated, function, made)
        self._loops: list[tuple[Any, Any]] = []  # blocks where `continue` and `break` go
        self._line = 0

    def translate(self, parameters: Iterable[Kind]) -> None:
        (tree,) = ast.parse(textwrap.dedent(inspect.getsource(self._function))).body
        assert isinstance(tree, ast.FunctionDef)
        start, arguments = self._b.block, list(self._made.args)
        for name, kind in zip(inspect.signature(self._function).parameters, parameters, strict=True):
            parts = [arguments.pop(0) for _ in flat(kind)]
            self._set(
                name, View(kind.element, parts[0], tuple(parts[1:])) if isinstance(kind, Array) else parts[0]
            )
        try:
            self._block(tree.body)
        except TranslationError as error:
            line = inspect.getsourcelines(self._function)[1] + self._line - 1
            place = f"{self._function.__code__.co_filename}, line {line}: "
            raise TranslationError(f"{'' if 'line' in str(error) else place}{error}") from None
        if not self._b.block.is_terminated:
            self._b.ret_void() if self._made.function_type.return_type == VOID else self._b.unreachable()
        self._entry.branch(start)

    def _block(self, statements: Sequence[ast.stmt]) -> None:
        for statement in statements:
            if not self._b.block.is_terminated:
                self._line = statement.lineno
                self._statement(statement)

    def _statement(self, node: ast.stmt) -> None:
        match node:
            case ast.Assign(targets=targets, value=value):
                found = self._several(value) if isinstance(targets[0], ast.Tuple) else self._value(value)
                for target in targets:
                    self._assign(target, found)
            case ast.AugAssign(target=target, op=op, value=value):
                self._assign(target, binary(self._b, op, self._number(target), self._number(value)))
            case ast.Expr(value=ast.Call() as call):
                self._call(call)
            case ast.If(test=test, body=body, orelse=orelse):
                self._if(test, body, orelse)
            case ast.While(test=test, body=body, orelse=[]):
                self._while(test, body)
            case ast.For(
                target=ast.Name(id=name), iter=ast.Call(func=ast.Name("range"), args=bounds), orelse=[]
            ):
                self._for(name, bounds, node.body)
            case ast.Break():
                self._b.branch(self._loops[-1][1])
            case ast.Continue():
                self._b.branch(self._loops[-1][0])
            case ast.Return(value=value):
                self._return(value)
            case ast.Expr(value=ast.Constant()) | ast.Pass():
                pass
            case _:
                raise TranslationError(f"no such statement: {ast.unparse(node)}")

    def _assign(self, target: ast.expr, value: Value | list[Value]) -> None:
        match target, value:
            case ast.Tuple(elts=targets), list():
                if len(targets) != len(value):
                    raise TranslationError(f"{len(value)} values for {ast.unparse(target)}")
                for part, own in zip(targets, value, strict=True):
                    self._assign(part, own)
            case ast.Name(id=name), ir.Value() | View():
                self._set(name, value)
            case ast.Subscript(), ir.Value():
                place, element = self._place(target)
                self._b.store(self._as(value, element), place)
            case _:
                raise TranslationError(f"cannot assign to {ast.unparse(target)}")

    def _if(self, test: ast.expr, body: Sequence[ast.stmt], orelse: Sequence[ast.stmt]) -> None:
        then, other, end = (self._made.append_basic_block() for _ in range(3))
        self._b.cbranch(self._truth(test), then, other)
        for block, statements in ((then, body), (other, orelse)):
            self._b.position_at_end(block)
            self._block(statements)
            if not self._b.block.is_terminated:
                self._b.branch(end)
        self._b.position_at_end(end)

    def _while(self, test: ast.expr, body: Sequence[ast.stmt]) -> None:
        head, inner, end = (self._made.append_basic_block() for _ in range(3))
        self._b.branch(head)
        self._b.position_at_end(head)
        self._b.cbranch(self._truth(test), inner, end)
        self._loop(inner, body, head, end)

    def _for(self, name: str, bounds: Sequence[ast.expr], body: Sequence[ast.stmt]) -> None:
        step = ast.literal_eval(bounds[2]) if len(bounds) == 3 else 1
        numbers = [self._as(self._number(bound), INT) for bound in bounds[:2]]
        first, last = numbers if len(numbers) == 2 else (constant(0), numbers[0])
        head, inner, later, end = (self._made.append_basic_block() for _ in range(4))
        counter = self._entry.alloca(INT)
        self._b.store(first, counter)
        self._b.branch(head)
        self._b.position_at_end(head)
        count = self._b.load(counter, typ=INT)
        self._b.cbranch(self._b.icmp_signed("<" if step > 0 else ">", count, last), inner, end)
        self._b.position_at_end(inner)
        self._set(name, count)
        self._loop(inner, body, later, end)
        self._b.position_at_end(later)
        self._b.store(self._b.add(self._b.load(counter, typ=INT), constant(step)), counter)
        self._b.branch(head)
        self._b.position_at_end(end)

    def _loop(self, inner: Any, body: Sequence[ast.stmt], later: Any, end: Any) -> None:
        self._loops.append((later, end))
        self._b.position_at_end(inner)
        self._block(body)
        if not self._b.block.is_terminated:
            self._b.branch(later)
        self._loops.pop()
        self._b.position_at_end(end)

    def _return(self, node: ast.expr | None) -> None:
        wanted = self._made.function_type.return_type
        if node is None:
            self._b.ret_void()
        elif isinstance(wanted, ir.LiteralStructType):
            whole = ir.Constant(wanted, ir.Undefined)
            for place, part in enumerate(self._several(node)):
                whole = self._b.insert_value(whole, self._as(scalar(part), wanted.elements[place]), place)
            self._b.ret(whole)
        else:
            self._b.ret(self._as(self._number(node), wanted))
