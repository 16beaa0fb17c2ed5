"""Instructions put together: each does what its parts do, to the bit, and nothing that others read is lost."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_hal.plant.engine import execute_rows
from sim_hal.plant.fuse import _PAIRS, WIDTH, shortened
from sim_hal.plant.program import OPCODES

VALUES = (0.0, -0.0, 1.0, -2.5, 1e-300, 3e200, 0.1, float("inf"), float("nan"))
FIRST, SECOND, INNER = 7, 8, 9  # registers of the results; 1 to 5 hold the operands
Line = tuple[int, ...]


def result(lines: list[Line], registers: NDArray[np.float64]) -> NDArray[np.float64]:
    """The second part's result in each row (n, registers)."""
    code = np.array([(*line, *(0,) * (WIDTH - len(line))) for line in lines], dtype=np.int64)
    content = registers.copy()
    execute_rows(code, 0, len(code), content)
    return np.asarray(content[:, SECOND])


def second_part(name: str, side: int) -> list[Line]:
    """Plain instructions of a pair's second part, which has the first's result for its operand `side`."""
    for (outer, inner, place), made in _PAIRS.items():
        if made == name:  # it is a pair itself
            own = [FIRST if at == side else 3 + at for at in range(2)]
            last = [FIRST if side == 2 else 5] * 2
            last[place] = INNER
            return [(OPCODES[inner], INNER, *own, 0), (OPCODES[outer], SECOND, *last, 0)]
    return [(OPCODES[name], SECOND, *(FIRST if at == side else 3 + at for at in range(3)))]


@pytest.mark.parametrize(("second", "first", "side"), list(_PAIRS))
def test_a_pair_does_what_its_parts_do(second: str, first: str, side: int) -> None:
    """Whatever the operands: signed zeros, too large, no number."""
    rng = np.random.default_rng(4)
    rows = np.concatenate([rng.choice(VALUES, size=(300, 10)), rng.normal(size=(300, 10))])
    lines = [(OPCODES[first], FIRST, 1, 2, 0), *second_part(second, side)]
    (together,) = shortened([lines], OPCODES, [SECOND])
    assert len(together) == 1
    with np.errstate(all="ignore"):
        whole, parts = result(together, rows), result(lines, rows)
    numbers = ~np.isnan(parts)
    assert np.array_equal(numbers, ~np.isnan(whole))
    assert whole[numbers].tobytes() == parts[numbers].tobytes()


def test_what_two_read_stays() -> None:
    """A product that is added and read elsewhere keeps its own register."""
    lines = [(OPCODES["*"], 4, 1, 2, 0), (OPCODES["+"], 5, 4, 3, 0)]
    (kept,) = shortened([lines], OPCODES, [4, 5])
    assert [line[1] for line in kept] == [4, 5]
    (kept,) = shortened([lines], OPCODES, [5])
    assert [line[1] for line in kept] == [5]
