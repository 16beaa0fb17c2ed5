"""MATLAB files of version 5 (those that MATLAB writes with -v6 and -v7).

A reader of its own, after MathWorks, "MAT-File Format" (level 5): the usual library trusts what stands in the
file, and a damaged one can bring the whole process down.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ground.recordings.model import RecordingError

_HEADER_BYTES = 128
_ORDERS = {b"IM": "<", b"MI": ">"}
_MATRIX, _COMPRESSED = 14, 15
_CELL, _STRUCT, _TEXT, _NUMBERS = 1, 2, 4, range(6, 16)
_COMPLEX_FLAG = 0x0800
_DEEPEST = 20
#: NumPy type of each plain element type; 16 to 18 are UTF-8, -16 and -32.
_DTYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_ENCODINGS = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}

Element = tuple[int, bytes]


def read_mat(path: Path) -> dict[str, NDArray[Any]]:
    """The variables of a MATLAB file by name; cells as object arrays, a field of a structure as `NAME.FIELD`.

    Variables of other classes (sparse, objects, functions) are left out. Raises `RecordingError` naming the
    file when it is cut, damaged or of another version.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror})") from error
    if data.startswith(b"MATLAB 7.3"):
        raise RecordingError(f"{path}: is a MATLAB file of version 7.3; save it with -v7")
    order = _ORDERS.get(data[126:128])
    if order is None or not data.startswith(b"MATLAB"):
        raise RecordingError(f"{path}: is no MATLAB file of version 5 (save it with -v7)")
    reader = _Reader(order)
    variables: dict[str, NDArray[Any]] = {}
    try:
        for kind, content in reader.elements(data[_HEADER_BYTES:]):
            if kind == _MATRIX:
                variables.update(reader.variables(content))
    except (ValueError, LookupError, struct.error, zlib.error) as error:
        raise RecordingError(f"{path}: is no whole MATLAB file ({error})") from error
    return variables


class _Reader:
    """Reads elements of one byte order."""

    def __init__(self, order: str) -> None:
        self._order = order

    def elements(self, data: bytes) -> Iterator[Element]:
        """Type and content of each element, compressed ones unpacked."""
        start = 0
        while start < len(data):
            if start + 8 > len(data):
                raise ValueError(f"an element is cut at byte {len(data)} of its part")
            kind, size = struct.unpack_from(f"{self._order}II", data, start)
            first, limit = start + 8, len(data)
            if kind >> 16:  # up to four bytes may stand within the tag
                kind, size, first, limit = kind & 0xFFFF, kind >> 16, start + 4, start + 8
            end = first + size
            if end > limit:
                raise ValueError(f"an element of type {kind} is cut at byte {limit} of its part")
            if kind == _COMPRESSED:
                yield from self.elements(zlib.decompress(data[first:end]))
            else:
                yield kind, data[first:end]
            start = end if kind == _COMPRESSED else end + -end % 8  # all but these fill up to eight bytes

    def variables(self, matrix: bytes) -> dict[str, NDArray[Any]]:
        """The named values of one matrix element of the file."""
        name, value = self._matrix(matrix, 0)
        if isinstance(value, dict):
            return {f"{name}.{key}": content for key, content in value.items()}
        return {} if value is None else {name: value}

    def _matrix(self, matrix: bytes, depth: int) -> tuple[str, Any]:
        if depth > _DEEPEST:
            raise ValueError(f"cells are nested deeper than {_DEEPEST}")
        parts = self.elements(matrix)
        if not matrix:  # an empty cell
            return "", np.empty((0, 0))
        flags = self._numbers(_next(parts))
        array_class = int(flags[0]) & 0xFF
        if array_class not in (_CELL, _STRUCT, _TEXT, *_NUMBERS):
            return "", None
        shape = tuple(int(size) for size in self._numbers(_next(parts)))
        name = _next(parts)[1].decode("ascii")
        if min(shape, default=0) < 0:
            raise ValueError(f"variable {name!r} has a negative size")
        if array_class == _CELL:
            return name, _cells([self._matrix(part[1], depth + 1)[1] for part in parts], shape)
        if array_class == _STRUCT:
            return name, self._fields(parts, shape, depth)
        if array_class == _TEXT:
            return name, np.array(self._text(_next(parts)))
        values = self._numbers(_next(parts)).reshape(shape, order="F")
        return name, values.astype(np.complex128) if int(flags[0]) & _COMPLEX_FLAG else values

    def _fields(self, parts: Iterator[Element], shape: tuple[int, ...], depth: int) -> dict[str, Any]:
        width = int(self._numbers(_next(parts))[0])
        text = _next(parts)[1]
        if width < 1:
            raise ValueError("a structure has field names without letters")
        names = [text[at : at + width].rstrip(b"\0").decode("ascii") for at in range(0, len(text), width)]
        values = [self._matrix(part[1], depth + 1)[1] for part in parts]
        if len(values) != len(names) * math.prod(shape):
            raise ValueError("a structure has not as many values as fields")
        if math.prod(shape) == 1:
            return dict(zip(names, values, strict=True))
        return {name: _cells(values[at :: len(names)], shape) for at, name in enumerate(names)}

    def _numbers(self, element: Element) -> NDArray[Any]:
        kind, content = element
        if kind not in _DTYPES:
            raise ValueError(f"an element of type {kind} stands where numbers must")
        return np.frombuffer(content, dtype=np.dtype(self._order + _DTYPES[kind]))

    def _text(self, element: Element) -> str:
        kind, content = element
        encoding = _ENCODINGS[kind]
        if encoding.startswith("utf-") and encoding != "utf-8":
            encoding += "-le" if self._order == "<" else "-be"
        return content.decode(encoding)


def _next(parts: Iterator[Element]) -> Element:
    part = next(parts, None)
    if part is None:
        raise ValueError("a variable lacks a part")
    return part


def _cells(values: list[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    cells = np.empty(len(values), dtype=object)
    for index, value in enumerate(values):  # assigned at once, arrays of one shape would be stacked
        cells[index] = value
    return cells.reshape(shape, order="F")
