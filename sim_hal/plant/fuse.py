"""Shorter programs: what nobody reads left out, and pairs of operations put together.

A machine's time goes into going from one instruction to the next, not into arithmetic.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

Line = tuple[int, ...]
WIDTH = 6
"""Of an instruction in the end: operation, target, and four operands, unused ones 0."""

#: What becomes of a pair of which the first serves the second alone, by the second, the first, and which operand of
#: the second it gives. Each rounds as the pair does.
_PAIRS = {
    ("+", "*", 0): "a*b+c",
    ("+", "*", 1): "a*b+c",
    ("-", "*", 0): "a*b-c",
    ("-", "*", 1): "c-a*b",
    ("*", "-", 0): "(a-b)*c",
    ("*", "-", 1): "(a-b)*c",
    ("/", "-", 0): "(a-b)/c",
    ("-", "/", 0): "a/b-c",
    ("*", "*", 0): "a*b*c",
    ("*", "*", 1): "a*b*c",
    ("neg", "*", 0): "-a*b",
    ("where", ">", 0): "a>b?c:d",
    ("where", "<", 0): "a<b?c:d",
    ("where", "-", 1): "c?a-b:d",
    ("where", "*", 1): "c?a*b:d",
    ("where", "/", 1): "c?a/b:d",
    ("(a-b)/c", "-", 0): "(a-b-c)/d",
    ("a/b-c", "+", 0): "(a+b)/c-d",
    ("a*b+c", "*", 2): "a*b+c*d",
}
FUSED = tuple(dict.fromkeys(_PAIRS.values()))
_OPERANDS_OF_FUSED = {name: len(set("abcd").intersection(name)) for name in FUSED}
_UNARY = frozenset(("neg", "abs", "sign", "sqrt", "exp", "log", "sin", "cos", "tan", "tanh", "not", "square"))


def shortened(
    sections: Sequence[list[Line]], opcodes: Mapping[str, int], asked: Iterable[int]
) -> list[list[Line]]:
    """The sections' instructions (operation, target, operands); `asked` are registers that others read too."""
    names = {code: name for name, code in opcodes.items()}
    uses = Counter(asked)
    kept: list[list[Line]] = []
    for lines in reversed(sections):  # later sections read what earlier ones write, never the other way round
        kept.insert(0, [])
        for line in reversed(lines):
            if uses[line[1]] > 0:
                kept[0].insert(0, line)
                uses.update(line[2 : 2 + _operands(names[line[0]])])
    return [_fused(lines, names, opcodes, uses) for lines in kept]


def _operands(name: str) -> int:
    return _OPERANDS_OF_FUSED.get(name) or (3 if name == "where" else 1 if name in _UNARY else 2)


def _fused(
    lines: Sequence[Line], names: Mapping[int, str], opcodes: Mapping[str, int], uses: Counter[int]
) -> list[Line]:
    found: dict[int, Line] = {}
    for plain in lines:
        line = plain
        while (side := _served(line, names, found, uses)) is not None:
            op, target, *operands = line[: 2 + _operands(names[line[0]])]
            first = found.pop(operands.pop(side))
            line = (opcodes[_PAIRS[names[op], names[first[0]], side]], target, *first[2:4], *operands)
        found[line[1]] = line
    return [(*line, *(0,) * (WIDTH - len(line))) for line in found.values()]


def _served(
    line: Line, names: Mapping[int, str], found: Mapping[int, Line], uses: Counter[int]
) -> int | None:
    """Which operand of an instruction another gives, for it alone, that can be put together with it."""
    for side, place in enumerate(line[2 : 2 + _operands(names[line[0]])]):
        first = found.get(place)
        if first and uses[place] == 1 and (names[line[0]], names[first[0]], side) in _PAIRS:
            return side
    return None
