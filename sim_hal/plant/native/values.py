"""Types and values of translated code: int and float of 64 bits, bool, and contiguous arrays of the two."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, get_args, get_origin

import numpy as np
from llvmlite import ir

#: llvmlite has no static types: a type or function, a number known when the code runs, and what writes code.
LLVMType = Any
Number = Any
Builder = Any

INT, FLOAT, BOOL, VOID = ir.IntType(64), ir.DoubleType(), ir.IntType(1), ir.VoidType()
POINTER = ir.PointerType()
_SCALARS = {int: INT, float: FLOAT, bool: BOOL}


class TranslationError(TypeError):
    """A function uses what cannot be translated; the message says where."""


class Array(NamedTuple):
    """Type of an array."""

    element: LLVMType
    dimensions: int


Kind = LLVMType | Array


@dataclass(frozen=True)
class View:
    """An array at run time: where it is, and its sizes."""

    element: LLVMType
    pointer: Number
    sizes: tuple[Number, ...]

    @property
    def kind(self) -> Array:
        return Array(self.element, len(self.sizes))


Value = Number | View


def kind_of(annotation: Any) -> Kind:
    """Type that an annotation of a parameter means."""
    if annotation in _SCALARS:
        return _SCALARS[annotation]
    array, *dimensions = get_args(annotation)
    if not dimensions:
        raise TranslationError(f"{annotation}: neither int, float, bool nor an array of known dimensions")
    element = get_args(get_args(array)[1])[0]
    return Array(FLOAT if element is np.float64 else INT, int(dimensions[0]))


def returned(annotation: Any) -> LLVMType:
    """Type that an annotation of what a function returns means."""
    if annotation is None or annotation is type(None):
        return VOID
    if get_origin(annotation) is tuple:
        return ir.LiteralStructType([_SCALARS[part] for part in get_args(annotation)])
    return _SCALARS[annotation]


def flat(kind: Kind) -> list[LLVMType]:
    """How a value is handed on: an array as its place and its sizes."""
    return [POINTER, *[INT] * kind.dimensions] if isinstance(kind, Array) else [kind]


def constant(value: Any) -> Number:
    """A number that is known when translating."""
    if isinstance(value, (bool, np.bool_)):
        return ir.Constant(BOOL, int(value))
    if isinstance(value, (int, np.integer)):
        return ir.Constant(INT, int(value))
    if isinstance(value, (float, np.floating)):
        return ir.Constant(FLOAT, float(value))
    raise TranslationError(f"{value!r} is no number")
