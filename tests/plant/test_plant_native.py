"""Translated functions do what they do as Python, to the bit; what cannot be translated is refused with its place."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_hal.plant.native import Floats1, Floats2, Floats3, Ints1, entry
from sim_hal.plant.native.build import MachineCode
from sim_hal.plant.native.values import TranslationError

HALF = 0.5
ROWS = np.int64(2)


def collatz(n: int, limit: int) -> tuple[int, bool]:
    """Steps to 1 of a sequence that only branches and loops tell."""
    steps = 0
    while n != 1 and steps < limit:
        n = n * 3 + 1 if n % 2 == 1 else halved(n)
        steps += 1
    return steps, n == 1


def halved(n: int) -> int:
    for half in range(n):
        if half + half >= n:
            return half
    return 0


def row_of(table: Floats2, row: int, out: Floats1) -> None:
    for column in range(table.shape[1] - 1, -1, -1):
        if table[row, column] < 0.0:
            continue
        out[column] += table[row, column] ** 2.0
        if out[column] > 100.0:
            break


@entry
def everything(counts: Ints1, numbers: Floats1, cube: Floats3, out: Floats1) -> None:
    """One of each: what the engine is written in."""
    a, b = numbers[0], numbers[1]
    for n in range(len(counts)):
        steps, done = collatz(counts[n], 200)
        counts[n] = -1 if not done or steps == 7 else steps
    out[0] = a + b * HALF - a / 3.0
    out[1] = min(a, b, 1) if a < b or a > 2.0 * b else max(a, b)
    out[2] = np.exp(-abs(a)) + np.sqrt(abs(b)) + np.sin(a) * np.cos(b) + np.tanh(a) + np.floor(b) + np.ceil(a)
    out[3] = np.sign(a) + int(b) + float(counts[0]) + abs(counts[0] - 3)
    out[4] = 1.0 if np.isfinite(a / (b - b)) else 2.0
    out[5] = 3.0 if 0.0 < a < b else 4
    total = first = 0.0
    for k in range(1, int(ROWS) + 1, 1):
        row_of(cube[k - 1], 1, out)
        total, first = total + cube[k - 1, 0, 0], a
        out[6] -= total * first


FLOATS = st.floats(-50.0, 50.0) | st.sampled_from([0.0, -0.0, float("nan"), float("inf"), -float("inf")])


@given(a=FLOATS, b=FLOATS, counts=st.lists(st.integers(1, 60), min_size=1, max_size=5))
def test_machine_code_does_what_python_does(a: float, b: float, counts: list[int]) -> None:
    cube = np.linspace(-9.0, 14.0, 24).reshape(2, 3, 4)
    found = []
    # Python's int of what is no finite number is an error; machine code is asked for none either.
    numbers = np.array([a, b if np.isfinite(b) else 1.5])
    for function in (everything, everything.function):
        own, out = np.array(counts, dtype=np.int64), np.linspace(1.0, 8.0, 8)
        with np.errstate(all="ignore"):
            function(own, numbers, cube, out)
        found.append((own, out))
    assert np.array_equal(found[0][0], found[1][0])
    # NumPy's functions round their last bit as they like, and a sum may cancel down to that
    assert np.allclose(found[0][1], found[1][1], rtol=1e-14, atol=1e-15, equal_nan=True)


def no_return_type(x: Floats1):  # type: ignore[no-untyped-def]
    x[0] = 1.0


def a_list(x: Floats1) -> None:
    found = [x[0]]
    x[0] = found[0]


def another_type(x: Floats1) -> None:
    count = 0
    count = count + x[0]
    x[0] = count


def an_unknown_name(x: Floats1) -> None:
    x[0] = nobody_knows  # type: ignore[name-defined]  # noqa: F821


def text(x: Floats1) -> None:
    x[0] = "one"  # type: ignore[assignment]


def too_many_indices(x: Floats1) -> None:
    x[0] = x[0, 0]


def a_result(x: Floats1) -> float:
    return float(x[0])


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (no_return_type, "must be annotated"),
        (a_list, r"test_plant_native.py, line \d+: no such expression: \[x\[0\]\]"),
        (another_type, "double where i64 is needed"),
        (an_unknown_name, "nobody_knows is not known here"),
        (text, "'one' is no number"),
        (too_many_indices, "too many indices"),
        (a_result, "Python hands over arrays and ints, and gets nothing"),
    ],
)
def test_what_cannot_be_translated_is_refused_with_its_place(
    function: Callable[..., None], words: str
) -> None:
    with pytest.raises(TranslationError, match=words):
        MachineCode(function)


@pytest.mark.parametrize("wrong", [np.zeros(3, dtype=np.float32), np.zeros((3, 2)), np.zeros(6)[::2]])
def test_other_arrays_are_refused(wrong: np.ndarray) -> None:
    with pytest.raises(TypeError, match="needs a contiguous array of 1 dimensions of float64"):
        everything(np.ones(1, dtype=np.int64), wrong, np.zeros((2, 3, 4)), np.zeros(8))


RUN = """
import sys
sys.path[:0] = sys.argv[1:2]
import numpy as np
from pathlib import Path
from sim_hal.plant.native import build
if sys.argv[2] != "beside":
    build._SOURCES = Path(sys.argv[2])  # a package that nobody may write to
made = []
build._compiled = lambda function, compiled=build._compiled: made.append(function) or compiled(function)
import plant_helpers as helpers
found = helpers.simulate(helpers.shipped("bb0b_hop"), helpers.hop_run(np.arange(0.0, 0.1, 0.01)))
print(len(made), repr(found["spring_compression_m"].tolist()))
"""


def simulated(sources: str, home: Path) -> tuple[int, str]:
    """How often machine code was made for a simulation, and the simulation."""
    done = subprocess.run(
        [sys.executable, "-c", RUN, str(Path(__file__).parent), sources],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {"XDG_CACHE_HOME": str(home)},
    )
    count, values = done.stdout.split(" ", 1)
    return int(count), values


def test_machine_code_of_a_package_that_is_read_only_is_kept_for_the_user(tmp_path: Path) -> None:
    nowhere, home = "/proc/self", tmp_path / "home"
    first, values = simulated(nowhere, home)
    again, same = simulated(nowhere, home)
    assert (first, again) == (2, 0)
    assert values == same == simulated("beside", home)[1]
    kept = sorted((home / "hopper").glob("integrate-*.o"))
    assert len(kept) == 1
    kept[0].write_bytes(kept[0].read_bytes()[:-1])  # damaged: made anew
    assert simulated(nowhere, home) == (1, values)
    home.joinpath("hopper").rename(home / "gone")
    (home / "hopper").write_text("in the way", encoding="utf-8")  # nowhere to keep it: runs all the same
    assert stat.S_ISREG((home / "hopper").stat().st_mode)
    assert simulated(nowhere, home) == (2, values)
