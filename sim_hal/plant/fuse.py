"""Shorter programs: what nobody reads left out, and pairs of operations put together.

A machine's time goes into going from one instruction to the next, not into arithmetic.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

Line = tuple[int, ...]

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
}
FUSED = tuple(dict.fromkeys(_PAIRS.values()))
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
    return 3 if name == "where" else 1 if name in _UNARY else 2


def _fused(
    lines: Sequence[Line], names: Mapping[int, str], opcodes: Mapping[str, int], uses: Counter[int]
) -> list[Line]:
    found: dict[int, Line] = {}
    for line in lines:
        op, target, *operands = line
        found[target] = line
        for side in (0, 1):
            first = found.get(operands[side])
            pair = _PAIRS.get((names[op], names[first[0]], side)) if first else None
            if first and pair and uses[first[1]] == 1:
                found[target] = (opcodes[pair], target, first[2], first[3], operands[1 - side])
                del found[first[1]]
                break
    return list(found.values())
