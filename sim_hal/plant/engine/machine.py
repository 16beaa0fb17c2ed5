"""What the engine works on, and the register machine that executes a plant's program.

Compiled functions take plain arrays, always in this order and by these names, since handing on tuples of arrays costs
more than the arithmetic, and minutes of compiling:

code: the program's instructions. tab: its table, whose first entries are the layout (`tab[NS]` is the number of
states).
r: the registers; flags, memories, inputs and friction forces live there. mode: of the friction elements, then of the
memories (0 holding, 1 at the lower limit, 2 at the upper, 3 idle), then the side of each kink (±1, 0 on it), then
from and up to which column each row of the derivatives is not 0.
w: all else, in rows as listed below; (rows, columns), as `rows_of` and `columns_of` say.
"""

from __future__ import annotations

from typing import NamedTuple, cast

import numpy as np

from sim_hal.plant.native import Floats1, Floats2, Ints1, Ints2, entry
from sim_hal.plant.program import OPCODES, Floats, Ints, Layout

OK, NOT_FINITE, STEP_VANISHED, TOO_MANY_STEPS, CHATTER, EMPTY_BAND, NO_GRIP, STOPPED = range(8)
OFF = 2  # mode of a friction element without strength
IDLE = 3  # mode of a memory or kink without strength

_ADD, _SUB, _MUL, _DIV, _POW, _NEG, _ABS, _SIGN, _SQRT, _EXP = range(10)
_LOG, _SIN, _COS, _TAN, _TANH, _MIN, _MAX, _WHERE, _LT, _LE, _GT, _GE = range(10, 22)
_AND, _OR, _NOT, _SINCE, _SQUARE = range(22, 27)
_MUL_ADD, _MUL_SUB, _LESS_MUL, _SUB_MUL, _SUB_DIV, _DIV_SUB, _MUL_MUL, _NEG_MUL = range(27, 35)
_IF_GREATER, _IF_LESS, _WHERE_SUB, _WHERE_MUL, _WHERE_DIV, _SUB_SUB_DIV, _ADD_DIV_SUB, _MULS_ADD = range(
    35, 43
)
assert len(OPCODES) == _MULS_ADD + 1

# Places of the layout in the table.
(NS, NU, NF, M, Q, NW, TIME_AT, PARAMETER, INPUT, START_VALUE, SLOPE, SEGMENT, FLAG, FLAG_TIME) = range(14)
(STATE_AT, MEMORY, AT_LOWER, AT_UPPER, RATE_AT, FORCE_AT) = range(14, 20)
(RATES, JACOBIAN, VELOCITY, VELOCITY_OFFSET, PER_FORCE, FORWARD, BACKWARD) = range(20, 27)
(FORWARD_SLOPE, BACKWARD_SLOPE, LOWER, UPPER, LOWER_SLOPE, UPPER_SLOPE) = range(27, 33)
(CONDITIONS, WATCHES, TRENDS, OUTPUTS, MODAL, DYNAMIC, DERIVATIVE, CONDITION, OUTPUT, END_OF_CODE) = range(
    33, 43
)
assert Layout._fields[NW] == "nw" and Layout._fields[FORCE_AT] == "force"
assert Layout._fields[LOWER] == "lower" and len(Layout._fields) == END_OF_CODE + 1


def _places(*numbers: int) -> tuple[int, ...]:
    """Places in w: plain integers would have functions compiled once for each of them as an argument."""
    return cast(tuple[int, ...], tuple(np.array(numbers)))


# Rows of w. CLOCK has in its columns: time, wanted step size, steps tried, tolerances, largest number of steps,
# whether the last step was taken in spite of its error, whether the propagators are this machine's.
# SCALE is the largest magnitude of each state so far, WEIGHT 0 where a state does not count. FOUND: margins at both
# sides of an event, between, and at the step's start; TREND: their rates. Rates and points have four rows each: at a
# step's start, end and middle, and wherever one looks.
CLOCK, STATE, SCALE, WEIGHT, FOUND, TREND, FORCE, DEFECT, CHANGE = _places(0, 1, 2, 3, 4, 8, 12, 16, 18)
SPARE, RATE, POINT, TERMS = _places(19, 20, 24, 28)
TIME, WANTED, STEPS, RELATIVE, ABSOLUTE, MOST_STEPS, FORCED, OWN = _places(0, 1, 2, 3, 4, 5, 6, 7)
LASTING = 4
START, END, HALF, HERE = _places(0, 1, 2, 3)
LOW, HIGH, BETWEEN, BEFORE = _places(0, 1, 2, 3)
WHOLE_STEP, HALF_STEP, NO_PROPAGATOR = _places(0, 1, 0)
LONGEST = 50  # terms of a Taylor series
KEPT = TERMS + LONGEST  # propagators in use, the last one made, step size of each
SLOTS = 8
JAC = (
    KEPT + 1
)  # (ns, ns + 1) derivatives of the rates by the states and time; then the propagators, then scratch


def kept_at(ns: int, slot: int) -> int:
    """First row of a kept propagator: its matrix, then the weights of F0 … F3 for a whole step and for half of it.

    Behind the last slot, SLOTS, is room for what nobody keeps.
    """
    return int(JAC + ns * (1 + 9 * slot))


def span_at(tab: Ints1) -> int:
    """Place in `mode` of where the rows of the derivatives begin; where they end comes behind."""
    return int(tab[M] + tab[Q] + tab[NW])


def modes_of(layout: Layout) -> int:
    """How many there are in `mode`."""
    return layout.m + layout.q + layout.nw + 2 * layout.ns


def rows_of(layout: Layout) -> int:
    """Rows of w: a propagator is nine matrices, (ns, ns) each; making one takes seven more and a row."""
    return int(JAC) + layout.ns * (1 + 9 * SLOTS) + max(7 * layout.ns + 1, layout.m)


def columns_of(layout: Layout) -> int:
    """Columns of w."""
    return max(layout.ns + 1, layout.m + 1 + layout.q + layout.nw + layout.nf, SLOTS + 2)


class Machine(NamedTuple):
    """What changes while plants run, all in place: the above for each of n runs."""

    registers: Floats  # (n, registers)
    modes: Ints  # (n, modes)
    starts: Floats  # (n, LASTING, columns): the first rows of w, which tell where each is
    room: Floats  # w, (rows, columns): one serves for all


class Schedule(NamedTuple):
    """Segments between known breaks, and when to give outputs."""

    breaks: Floats  # (nb + 1,)
    inputs: Floats  # (nb + 1, nu)
    slopes: Floats  # (nb + 1, nu)
    events: Floats  # (nf,): when each event latches, inf for never
    samples: Floats  # (n,)


class Limits(NamedTuple):
    """Tolerances of the integration: error per step relative to each state, its floor, and the most steps."""

    relative: float
    absolute: float
    steps: int


@entry
def execute_rows(code: Ints2, start: int, stop: int, registers: Floats2) -> None:
    """Run instructions start … stop−1 on each of several register files (n, registers)."""
    for i in range(len(registers)):
        execute(code, start, stop, registers[i])


def execute(code: Ints2, start: int, stop: int, r: Floats1) -> None:
    """Run instructions start … stop−1 on the registers `r`."""
    for n in range(start, stop):
        op = code[n, 0]
        to = code[n, 1]
        a = r[code[n, 2]]
        b = r[code[n, 3]]
        if op == _ADD:
            r[to] = a + b
        elif op == _SUB:
            r[to] = a - b
        elif op == _MUL:
            r[to] = a * b
        elif op == _MUL_ADD:
            r[to] = a * b + r[code[n, 4]]
        elif op == _MUL_SUB:
            r[to] = a * b - r[code[n, 4]]
        elif op == _LESS_MUL:
            r[to] = r[code[n, 4]] - a * b
        elif op == _SUB_MUL:
            r[to] = (a - b) * r[code[n, 4]]
        elif op == _SUB_DIV:
            r[to] = (a - b) / r[code[n, 4]]
        elif op == _DIV_SUB:
            r[to] = a / b - r[code[n, 4]]
        elif op == _MUL_MUL:
            r[to] = a * b * r[code[n, 4]]
        elif op == _IF_GREATER:
            r[to] = r[code[n, 4]] if a > b else r[code[n, 5]]
        elif op == _IF_LESS:
            r[to] = r[code[n, 4]] if a < b else r[code[n, 5]]
        elif op == _WHERE_SUB:
            r[to] = a - b if r[code[n, 4]] != 0.0 else r[code[n, 5]]
        elif op == _WHERE_MUL:
            r[to] = a * b if r[code[n, 4]] != 0.0 else r[code[n, 5]]
        elif op == _WHERE_DIV:
            r[to] = a / b if r[code[n, 4]] != 0.0 else r[code[n, 5]]
        elif op == _SUB_SUB_DIV:
            r[to] = (a - b - r[code[n, 4]]) / r[code[n, 5]]
        elif op == _ADD_DIV_SUB:
            r[to] = (a + b) / r[code[n, 4]] - r[code[n, 5]]
        elif op == _MULS_ADD:
            r[to] = a * b + r[code[n, 4]] * r[code[n, 5]]
        elif op == _NEG_MUL:
            r[to] = -(a * b)
        elif op == _DIV:
            r[to] = a / b
        elif op == _SQUARE:
            r[to] = a * a
        elif op == _NEG:
            r[to] = -a
        elif op == _WHERE:
            r[to] = b if a != 0.0 else r[code[n, 4]]
        elif op == _MIN:
            r[to] = min(a, b)
        elif op == _MAX:
            r[to] = max(a, b)
        elif op == _ABS:
            r[to] = abs(a)
        elif op == _SIGN:
            r[to] = np.sign(a)
        elif op == _LT:
            r[to] = 1.0 if a < b else 0.0
        elif op == _LE:
            r[to] = 1.0 if a <= b else 0.0
        elif op == _GT:
            r[to] = 1.0 if a > b else 0.0
        elif op == _GE:
            r[to] = 1.0 if a >= b else 0.0
        elif op == _AND:
            r[to] = a * b
        elif op == _OR:
            r[to] = max(a, b)
        elif op == _NOT:
            r[to] = 1.0 - a
        elif op == _SINCE:
            r[to] = r[0] - b if a != 0.0 else 0.0
        elif op == _EXP:
            r[to] = np.exp(a)
        elif op == _POW:
            r[to] = a**b
        elif op == _SQRT:
            r[to] = np.sqrt(a)
        elif op == _LOG:
            r[to] = np.log(a)
        elif op == _SIN:
            r[to] = np.sin(a)
        elif op == _COS:
            r[to] = np.cos(a)
        elif op == _TAN:
            r[to] = np.tan(a)
        elif op == _TANH:
            r[to] = np.tanh(a)
