"""The integrator: Dormand–Prince 5(4) with exactly located events, set-valued friction and memories.

Compiled once for all plants: a plant is data (`Program`) that a register machine executes. All compiled
functions live in this one file because a compiled caller on disk does not notice a change of a callee elsewhere.

Within a step the mode of each friction element is fixed: +1 or −1 (sliding), 0 (stuck: the holding force keeps
the relative velocity at exactly 0 while it stays within the band [−forward, backward]), 2 (switched off).
Memories are play operators, value = clip(memory, lower, upper): a running maximum has no upper limit. Crossings
are bracketed by bisection on the step's own interpolant, then the step is taken again up to there.

Coefficients: Dormand and Prince, J. Comput. Appl. Math. 6 (1980) 19; interpolant: Shampine, Math. Comput. 46
(1986) 135.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sim_hal.plant.jit import compiled, inlined
from sim_hal.plant.program import OPCODES, Floats, Ints, Layout, Program

OK, NOT_FINITE, STEP_VANISHED, TOO_MANY_STEPS, CHATTER, EMPTY_BAND, NO_GRIP = range(7)
OFF = 2  # mode of a friction element without strength
IDLE = 3  # mode of a memory or kink without strength
BAND_TOLERANCE = (
    1e-9  # share of the band by which the holding force must leave it: keeps stick from flickering
)
FLOOR = 0.01  # share of a state's largest value so far below which its relative tolerance no longer shrinks
MIN_STEP = 1e-14

_ADD, _SUB, _MUL, _DIV, _POW, _NEG, _ABS, _SIGN, _SQRT, _EXP = range(10)
_LOG, _SIN, _COS, _TAN, _TANH, _MIN, _MAX, _WHERE, _LT, _LE, _GT, _GE = range(10, 22)
_AND, _OR, _NOT, _SINCE, _SQUARE = range(22, 27)
assert len(OPCODES) == _SQUARE + 1

_C = (0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0)
_A = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [1 / 5, 0.0, 0.0, 0.0, 0.0, 0.0],
        [3 / 40, 9 / 40, 0.0, 0.0, 0.0, 0.0],
        [44 / 45, -56 / 15, 32 / 9, 0.0, 0.0, 0.0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0.0, 0.0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0.0],
        [35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
    ]
)
_E = np.array([71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])
_P = np.array(
    [
        [1.0, -8048581381 / 2820520608, 8663915743 / 2820520608, -12715105075 / 11282082432],
        [0.0, 0.0, 0.0, 0.0],
        [0.0, 131558114200 / 32700410799, -68118460800 / 10900136933, 87487479700 / 32700410799],
        [0.0, -1754552775 / 470086768, 14199869525 / 1410260304, -10690763975 / 1880347072],
        [0.0, 127303824393 / 49829197408, -318862633887 / 49829197408, 701980252875 / 199316789632],
        [0.0, -282668133 / 205662961, 2019193451 / 616988883, -1453857185 / 822651844],
        [0.0, 40617522 / 29380423, -110615467 / 29380423, 69997945 / 29380423],
    ]
)


class Machine(NamedTuple):
    """What changes while a plant runs; every array is written in place.

    clock: time, next step size, steps tried, error of the last step. scale: largest magnitude of each state so
    far. weight: 0 where a state does not count for the error. mode: of the friction elements, then of the
    memories (0 holding, 1 at the lower limit, 2 at the upper, 3 idle), then the side of each kink (±1, 0 on it).
    Flags, memories, inputs and friction forces live in the registers.
    """

    clock: Floats  # (4,)
    registers: Floats
    state: Floats  # (ns,)
    scale: Floats  # (ns,)
    weight: Floats  # (ns,)
    mode: Ints  # (m + q + nw,)


class Schedule(NamedTuple):
    """Segments between known breaks, and when to give outputs."""

    breaks: Floats  # (nb + 1,)
    inputs: Floats  # (nb + 1, nu)
    slopes: Floats  # (nb + 1, nu)
    events: Floats  # (nf,): when each event latches, inf for never
    samples: Floats  # (n,)


class Limits(NamedTuple):
    """Tolerances of the integration."""

    relative: float
    absolute: float
    steps: int


# In what follows `code`, `tab` and `lay` are the program, `r` the registers and `mode` the machine's modes: plain
# arrays, since taking them out of a tuple in the innermost loop costs more than the arithmetic.


@compiled
def execute(code: Ints, start: int, stop: int, r: Floats) -> None:
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


@inlined
def section(code: Ints, lay: Layout, r: Floats, which: int) -> None:
    """Run one section of the program."""
    execute(code, lay.sections[which], lay.sections[which + 1], r)


@compiled
def solve_small(a: Floats, b: Floats) -> bool:
    """Solve a·x = b in place (x in b) by elimination with pivoting; False where a is singular."""
    n = len(b)
    for col in range(n):
        pivot = col + np.argmax(np.abs(a[col:, col]))
        if a[pivot, col] == 0.0:
            return False
        for k in range(n):
            a[col, k], a[pivot, k] = a[pivot, k], a[col, k]
        b[col], b[pivot] = b[pivot], b[col]
        for row in range(col + 1, n):
            factor = a[row, col] / a[col, col]
            for k in range(col, n):
                a[row, k] -= factor * a[col, k]
            b[row] -= factor * b[col]
    for row in range(n - 1, -1, -1):
        for k in range(row + 1, n):
            b[row] -= a[row, k] * b[k]
        b[row] /= a[row, row]
    return True


@inlined
def dot(tab: Ints, row: int, r: Floats, x: Floats) -> float:
    """Sum of registers listed from `row` on times x."""
    total = 0.0
    for s in range(len(x)):
        total += r[tab[row + s]] * x[s]
    return total


@compiled
def grip(tab: Ints, lay: Layout, r: Floats, i: int, j: int) -> float:
    """What one unit of element j's force adds to the rate of element i's relative velocity."""
    total = 0.0
    for s in range(lay.ns):
        total += r[tab[lay.velocity + i * lay.ns + s]] * r[tab[lay.per_force + j * lay.ns + s]]
    return float(total)


@compiled
def slide_rate(tab: Ints, lay: Layout, r: Floats, j: int, rate: Floats) -> float:
    """Rate of element j's relative velocity."""
    return dot(tab, lay.velocity + j * lay.ns, r, rate)


@compiled
def relative_velocity(tab: Ints, lay: Layout, r: Floats, j: int, x: Floats) -> float:
    """Relative velocity of friction element j."""
    return float(r[tab[lay.velocity_offset + j]] + dot(tab, lay.velocity + j * lay.ns, r, x))


@inlined
def add_force(tab: Ints, lay: Layout, r: Floats, j: int, force: float, rate: Floats) -> None:
    """Add a force of friction element j to the rates."""
    row = lay.per_force + j * lay.ns
    for s in range(len(rate)):
        rate[s] += r[tab[row + s]] * force


@inlined
def rates_at(
    code: Ints, tab: Ints, lay: Layout, r: Floats, mode: Ints, t: float, x: Floats, rate: Floats
) -> bool:
    """Rates at time t and state x in the present modes; friction forces go to their registers. False: no grip."""
    r[lay.time] = t
    for k in range(lay.nu):
        r[lay.input + k] = r[lay.start_value + k] + r[lay.slope + k] * (t - r[lay.segment])
    for s in range(lay.ns):
        r[lay.state + s] = x[s]
    execute(code, lay.sections[1], lay.sections[2], r)
    for s in range(lay.ns):
        rate[s] = r[tab[lay.rates + s]]
    stuck = 0
    for j in range(lay.m):
        if mode[j] == 0:
            stuck += 1
        elif mode[j] != OFF:
            level = -r[tab[lay.forward + j]] if mode[j] > 0 else r[tab[lay.backward + j]]
            r[lay.force + j] = level
            add_force(tab, lay, r, j, level, rate)
    held = True
    if stuck > 0:
        held = hold(tab, lay, r, mode, rate)
    return held


@compiled
def evaluate(
    code: Ints, tab: Ints, lay: Layout, r: Floats, mode: Ints, t: float, x: Floats, rate: Floats
) -> bool:
    """`rates_at`, for where speed does not matter: one copy of it in machine code."""
    return rates_at(code, tab, lay, r, mode, t, x, rate)


@compiled
def hold(tab: Ints, lay: Layout, r: Floats, mode: Ints, rate: Floats) -> bool:
    """Find and apply the forces that keep the stuck elements still (0 where a force has no grip)."""
    which = np.empty(lay.m, np.int64)
    n = 0
    for j in range(lay.m):
        if mode[j] == 0:
            r[lay.force + j] = 0.0
            if grip(tab, lay, r, j, j) != 0.0:
                which[n] = j
                n += 1
    if n == 1:
        j = which[0]
        r[lay.force + j] = -slide_rate(tab, lay, r, j, rate) / grip(tab, lay, r, j, j)
        add_force(tab, lay, r, j, r[lay.force + j], rate)
        stand_still(tab, lay, r, j, rate)
        return True
    a = np.empty((n, n))
    b = np.empty(n)
    for i in range(n):
        b[i] = -slide_rate(tab, lay, r, which[i], rate)
        for k in range(n):
            a[i, k] = grip(tab, lay, r, which[i], which[k])
    if not solve_small(a, b):
        return False
    for i in range(n):
        r[lay.force + which[i]] = b[i]
        add_force(tab, lay, r, which[i], b[i], rate)
    for i in range(n):
        stand_still(tab, lay, r, which[i], rate)
    return True


@compiled
def stand_still(tab: Ints, lay: Layout, r: Floats, j: int, rate: Floats) -> None:
    """Make a held state's rate exactly 0, where the sum of forces leaves a rounding error."""
    only = -1
    for s in range(lay.ns):
        if r[tab[lay.velocity + j * lay.ns + s]] != 0.0:
            only = s if only == -1 else -2
    if only >= 0:
        rate[only] = 0.0


@compiled
def band(tab: Ints, lay: Layout, r: Floats, j: int) -> float:
    """By how much element j's force may miss its band before that counts."""
    return float(BAND_TOLERANCE * (abs(r[tab[lay.forward + j]]) + abs(r[tab[lay.backward + j]])))


@compiled
def leaving(tab: Ints, lay: Layout, r: Floats, j: int) -> int:
    """+1 or −1 where the holding force of stuck element j is outside its band, and to which side it moves."""
    if r[lay.force + j] < -r[tab[lay.forward + j]] - band(tab, lay, r, j):
        return 1
    if r[lay.force + j] > r[tab[lay.backward + j]] + band(tab, lay, r, j):
        return -1
    return 0


@compiled
def release(tab: Ints, lay: Layout, r: Floats, mode: Ints, rate: Floats) -> bool:
    """Decide which stuck elements start to slide, all together (projected Gauss–Seidel on their bands)."""
    for j in range(lay.m):  # back to the rates without the stuck elements' forces
        if mode[j] == 0:
            add_force(tab, lay, r, j, -r[lay.force + j], rate)
            r[lay.force + j] = 0.0
    for _ in range(200):
        for j in range(lay.m):
            if mode[j] == 0 and grip(tab, lay, r, j, j) != 0.0:
                force = r[lay.force + j]
                target = force - slide_rate(tab, lay, r, j, rate) / grip(tab, lay, r, j, j)
                target = min(max(target, -r[tab[lay.forward + j]]), r[tab[lay.backward + j]])
                add_force(tab, lay, r, j, target - force, rate)
                r[lay.force + j] = target
    released = False
    for j in range(lay.m):
        if mode[j] == 0 and grip(tab, lay, r, j, j) != 0.0:
            pull = slide_rate(tab, lay, r, j, rate) / grip(tab, lay, r, j, j)
            if abs(pull) > band(tab, lay, r, j):
                mode[j] = 1 if pull > 0.0 else -1
                released = True
    return released


@compiled
def set_flag(lay: Layout, r: Floats, i: int, at: float) -> None:
    """Latch flag i."""
    r[lay.flag + i] = 1.0
    r[lay.flag_time + i] = at


@compiled
def crossed(tab: Ints, lay: Layout, r: Floats, i: int) -> bool:
    """Whether flag i is not set although its condition holds."""
    condition = tab[lay.conditions + i]
    return bool(r[lay.flag + i] == 0.0 and condition >= 0 and r[condition] >= 0.0)


@inlined
def side_of(tab: Ints, lay: Layout, r: Floats, w: int) -> int:
    """On which side of its kink entry w of the modes is."""
    value = r[tab[lay.watches + w - lay.m - lay.q]]
    return 1 if value > 0.0 else -1 if value < 0.0 else 0


@compiled
def take_sides(tab: Ints, lay: Layout, r: Floats, mode: Ints, every: bool) -> None:
    """Note on which side of each kink the state is; of those only that were on it, unless `every`."""
    for w in range(lay.m + lay.q, lay.m + lay.q + lay.nw):
        if mode[w] == 0 or (every and mode[w] != IDLE):
            mode[w] = side_of(tab, lay, r, w)


@compiled
def settle(
    code: Ints, tab: Ints, lay: Layout, r: Floats, mode: Ints, t: float, state: Floats, rate: Floats
) -> int:
    """Bring flags, friction modes and memories into agreement with the state; gives the rates there."""
    for _ in range(100):
        if not evaluate(code, tab, lay, r, mode, t, state, rate):
            return NO_GRIP
        section(code, lay, r, 2)
        changed = False
        for i in range(lay.nf):
            if crossed(tab, lay, r, i):
                set_flag(lay, r, i, t)
                changed = True
        if changed:
            continue
        for j in range(lay.m):
            width = r[tab[lay.forward + j]] + r[tab[lay.backward + j]]
            if mode[j] != OFF and not width >= -band(tab, lay, r, j):
                return EMPTY_BAND
            if mode[j] == 0 and leaving(tab, lay, r, j) != 0:
                changed = True
        if changed and release(tab, lay, r, mode, rate):
            continue
        settle_memories(tab, lay, r, mode, rate)
        take_sides(tab, lay, r, mode, True)
        return OK
    return CHATTER


@compiled
def settle_memories(tab: Ints, lay: Layout, r: Floats, mode: Ints, rate: Floats) -> None:
    """Store each memory's value and whether it follows a limit from here on (at rest it follows none)."""
    for q in range(lay.q):
        low, high = r[tab[lay.lower + q]], r[tab[lay.upper + q]]
        value = min(max(r[lay.memory + q], low), high)
        r[lay.memory + q] = value
        if mode[lay.m + q] == IDLE:
            continue
        mode[lay.m + q] = 0
        if value == low and dot(tab, lay.lower_slope + q * lay.ns, r, rate) > 0.0:
            mode[lay.m + q] = 1
        elif value == high and dot(tab, lay.upper_slope + q * lay.ns, r, rate) < 0.0:
            mode[lay.m + q] = 2


@compiled
def memory_turned(tab: Ints, lay: Layout, r: Floats, q: int, mode: int, rate: Floats) -> bool:
    """Whether memory q no longer does what its mode says."""
    if mode == 0:
        value = r[lay.memory + q]
        return bool(r[tab[lay.lower + q]] > value or r[tab[lay.upper + q]] < value)
    if mode == 1:
        return bool(dot(tab, lay.lower_slope + q * lay.ns, r, rate) < 0.0)
    if mode == 2:
        return bool(dot(tab, lay.upper_slope + q * lay.ns, r, rate) > 0.0)
    return False


@compiled
def triggered(tab: Ints, lay: Layout, r: Floats, mode: Ints, x: Floats, rate: Floats, hits: Ints) -> bool:
    """Whether the mode of anything no longer fits at the point just evaluated; `hits` says of what.

    `hits` lists friction elements (2: has turned, ±1: breaks away), then memories, kinks and flags.
    """
    found = False
    for j in range(lay.m):
        hits[j] = 0
        if mode[j] == 0:
            hits[j] = leaving(tab, lay, r, j)
        elif mode[j] != OFF and mode[j] * relative_velocity(tab, lay, r, j, x) < 0.0:
            hits[j] = 2
        found = found or hits[j] != 0
    for q in range(lay.q):
        hit = memory_turned(tab, lay, r, q, mode[lay.m + q], rate)
        hits[lay.m + q] = 1 if hit else 0
        found = found or hit
    for w in range(lay.m + lay.q, lay.m + lay.q + lay.nw):
        hit = mode[w] != IDLE and side_of(tab, lay, r, w) * mode[w] < 0
        hits[w] = 1 if hit else 0
        found = found or hit
    for i in range(lay.nf):
        hit = crossed(tab, lay, r, i)
        hits[lay.m + lay.q + lay.nw + i] = 1 if hit else 0
        found = found or hit
    return found


@compiled
def stages(
    code: Ints,
    tab: Ints,
    lay: Layout,
    r: Floats,
    mode: Ints,
    t: float,
    h: float,
    state: Floats,
    k: Floats,
    x: Floats,
) -> bool:
    """The stages of one step of size h; k[0] is the rate at its start. End in `x`; False: no grip."""
    held = True
    for stage in range(1, 7):
        for s in range(lay.ns):
            total = 0.0
            for n in range(stage):
                total += _A[stage, n] * k[n, s]
            x[s] = state[s] + h * total
        held = rates_at(code, tab, lay, r, mode, t + _C[stage] * h, x, k[stage]) and held
    return held


@compiled
def step_error(m: Machine, h: float, k: Floats, x: Floats, limits: Limits) -> float:
    """Largest error of a step relative to its tolerance, over the states that count."""
    worst = 0.0
    for s in range(len(x)):
        error = 0.0
        for n in range(7):
            error += _E[n] * k[n, s]
        size = max(abs(x[s]), abs(m.state[s]), FLOOR * m.scale[s])
        error = m.weight[s] * abs(h * error) / (limits.absolute + limits.relative * size)
        if not error <= worst:  # also catches what is not a number
            worst = error
    return float(worst)


@compiled
def interpolate(state: Floats, h: float, k: Floats, share: float, x: Floats) -> None:
    """State at `share` of the step just taken."""
    for s in range(len(x)):
        total = 0.0
        for n in range(7):
            weight = ((_P[n, 3] * share + _P[n, 2]) * share + _P[n, 1]) * share + _P[n, 0]
            total += weight * k[n, s]
        x[s] = state[s] + h * share * total


@compiled
def misfit_at(
    p: Program, m: Machine, h: float, k: Floats, share: float, x: Floats, rate: Floats, hits: Ints
) -> bool:
    """Whether an event has happened by `share` of the step."""
    interpolate(m.state, h, k, share, x)
    r = m.registers
    if not evaluate(p.code, p.table, p.layout, r, m.mode, m.clock[0] + share * h, x, rate):
        return True
    section(p.code, p.layout, r, 2)
    return triggered(p.table, p.layout, r, m.mode, x, rate, hits)


@compiled
def turned_within(p: Program, m: Machine, h: float, k: Floats, x: Floats) -> float:
    """First quarter of the step at which a sliding element has turned, or 0: catches a brief reversal."""
    tab, lay, r = p.table, p.layout, m.registers
    for j in range(lay.m):
        sign = m.mode[j]
        if abs(sign) != 1 or sign * slide_rate(tab, lay, r, j, k[0]) >= 0.0:
            continue
        if sign * slide_rate(tab, lay, r, j, k[6]) <= 0.0:
            continue
        for quarter in range(1, 4):
            interpolate(m.state, h, k, 0.25 * quarter, x)
            if sign * relative_velocity(tab, lay, r, j, x) < 0.0:
                return 0.25 * quarter
    return 0.0


@compiled
def locate(
    p: Program, m: Machine, h: float, k: Floats, share: float, x: Floats, rate: Floats, hits: Ints
) -> float:
    """Share of the step at which the first event happens, given one that is behind it (bisection)."""
    low = 0.0
    for _ in range(60):
        middle = 0.5 * (low + share)
        if not low < middle < share:
            break
        if misfit_at(p, m, h, k, middle, x, rate, hits):
            share = middle
        else:
            low = middle
    misfit_at(p, m, h, k, share, x, rate, hits)
    return share


@compiled
def apply_events(p: Program, m: Machine, hits: Ints, at: float) -> None:
    """Change the modes of what `triggered` has found at time `at`."""
    tab, lay, r = p.table, p.layout, m.registers
    for j in range(lay.m):
        if hits[j] == 2:
            m.mode[j] = 0
        elif hits[j] != 0:
            m.mode[j] = hits[j]
    for q in range(lay.q):
        if hits[lay.m + q] != 0 and m.mode[lay.m + q] == 0:
            low, high, value = r[tab[lay.lower + q]], r[tab[lay.upper + q]], r[lay.memory + q]
            r[lay.memory + q] = low if abs(low - value) < abs(high - value) else high
    for i in range(lay.nf):
        if hits[lay.m + lay.q + lay.nw + i] != 0:
            set_flag(lay, r, i, at)


@compiled
def accept(p: Program, m: Machine, finish: float, x: Floats) -> None:
    """Make the step's end the present state: stuck elements exactly still, memories carried along."""
    tab, lay, r = p.table, p.layout, m.registers
    m.clock[0] = finish
    for s in range(len(x)):
        m.state[s] = x[s]
    for j in range(lay.m):
        if m.mode[j] == 0:
            w = relative_velocity(tab, lay, r, j, m.state)
            if w != 0.0 and grip(tab, lay, r, j, j) != 0.0:
                add_force(tab, lay, r, j, -w / grip(tab, lay, r, j, j), m.state)
    for s in range(len(x)):
        m.scale[s] = max(m.scale[s], abs(m.state[s]))
    for q in range(lay.q):
        if m.mode[lay.m + q] == 1:
            r[lay.memory + q] = r[tab[lay.lower + q]]
        elif m.mode[lay.m + q] == 2:
            r[lay.memory + q] = r[tab[lay.upper + q]]


@compiled
def sample(p: Program, m: Machine, t: float, x: Floats, rate: Floats, output: Floats) -> None:
    """Outputs at time t and state x."""
    r, lay = m.registers, p.layout
    evaluate(p.code, p.table, lay, r, m.mode, t, x, rate)
    for s in range(len(x)):
        r[lay.rate + s] = rate[s]
    section(p.code, lay, r, 2)
    section(p.code, lay, r, 3)
    for o in range(len(output)):
        output[o] = r[p.table[lay.outputs + o]]


@compiled
def emit(
    p: Program, m: Machine, plan: Schedule, done: int, h: float, taken: float, k: Floats, outputs: Floats,
    states: Floats,
) -> int:  # fmt: skip
    """Give the samples that fall into the step, up to `taken`; returns how many are done in all."""
    until = m.clock[0] + taken
    if done >= len(plan.samples) or plan.samples[done] >= until:
        return done
    rate = np.empty(len(m.state))
    while done < len(plan.samples) and plan.samples[done] < until:
        interpolate(m.state, h, k, (plan.samples[done] - m.clock[0]) / h, states[done])
        sample(p, m, plan.samples[done], states[done], rate, outputs[done])
        done += 1
    return done


@compiled
def start(p: Program, m: Machine) -> None:
    """Prepare a run whose parameters, flags and memories are in the registers: finds what slides which way."""
    section(p.code, p.layout, m.registers, 0)
    for j in range(p.layout.m):
        if m.mode[j] != OFF:
            w = relative_velocity(p.table, p.layout, m.registers, j, m.state)
            m.mode[j] = 1 if w > 0.0 else -1 if w < 0.0 else 0


@compiled
def open_segment(p: Program, m: Machine, plan: Schedule, b: int, rate: Floats) -> int:
    """Take over the inputs and events from break b on."""
    lay, r = p.layout, m.registers
    r[lay.segment] = plan.breaks[b]
    for k in range(lay.nu):
        r[lay.start_value + k] = plan.inputs[b, k]
        r[lay.slope + k] = plan.slopes[b, k]
    for i in range(lay.nf):
        if r[lay.flag + i] == 0.0 and plan.events[i] <= m.clock[0]:
            set_flag(lay, r, i, plan.events[i])
    return settle(p.code, p.table, lay, r, m.mode, m.clock[0], m.state, rate)


@compiled
def try_step(p: Program, m: Machine, h: float, last: bool, k: Floats, x: Floats, limits: Limits) -> int:
    """One step of size h with error control: OK, −1 to try again with the smaller step, or what is wrong.

    The size follows the error with a little damping (Hairer, Nørsett, Wanner, Solving ODEs I, sec. II.4: beta 0.04).
    """
    held = stages(p.code, p.table, p.layout, m.registers, m.mode, m.clock[0], h, m.state, k, x)
    error = step_error(m, h, k, x, limits) if held else np.nan
    if error <= 1.0:
        error = max(error, 1e-6)
        wanted = h * min(5.0, 0.9 * error**-0.17 * m.clock[3] ** 0.04)
        m.clock[1] = max(wanted, m.clock[1]) if last else wanted
        m.clock[3] = error
        return OK
    finite = np.isfinite(error)
    m.clock[1] = h * (max(0.2, 0.9 * error**-0.2) if finite else 0.1)
    if m.clock[1] < MIN_STEP * max(1.0, abs(m.clock[0])):
        return STEP_VANISHED if finite else NOT_FINITE
    return -1


@compiled
def integrate(p: Program, m: Machine, plan: Schedule, limits: Limits, outputs: Floats, states: Floats) -> int:
    """Run through all segments, filling `outputs` (n, no) and `states` (n, ns) at the samples; a status.

    The machine must have been prepared by `start`.
    """
    ns = len(m.state)
    lay, r, mode = p.layout, m.registers, m.mode
    k, x, y, rate = np.zeros((7, ns)), np.empty(ns), np.empty(ns), np.empty(ns)
    hits = np.zeros(len(mode) + lay.nf, np.int64)
    done = 0
    at_once = 0  # events in a row without time passing
    for b in range(len(plan.breaks)):
        m.clock[0] = plan.breaks[b]
        status = open_segment(p, m, plan, b, k[0])
        if status != OK:
            return status
        end = plan.breaks[min(b + 1, len(plan.breaks) - 1)]
        while m.clock[0] < end:
            m.clock[2] += 1.0
            if m.clock[2] > limits.steps:
                return TOO_MANY_STEPS
            left = end - m.clock[0]
            last = m.clock[1] >= 0.999999 * left
            h = left if last else m.clock[1]
            status = try_step(p, m, h, last, k, x, limits)
            if status == -1:
                continue
            if status != OK:
                return status
            section(p.code, lay, r, 2)
            event = triggered(p.table, lay, r, mode, x, k[6], hits)
            quarter = turned_within(p, m, h, k, y)
            share = 1.0
            if event or quarter > 0.0:
                event = True
                share = locate(p, m, h, k, quarter if quarter > 0.0 else 1.0, y, rate, hits)
            else:
                take_sides(p.table, lay, r, mode, False)
            taken = h * share
            before = done
            done = emit(p, m, plan, done, h, taken, k, outputs, states)
            if event:
                stages(p.code, p.table, lay, r, mode, m.clock[0], taken, m.state, k, x)
                if np.sum(np.abs(hits)) == 0:  # seen at the step's very end only, by rounding
                    section(p.code, lay, r, 2)
                    triggered(p.table, lay, r, mode, x, k[6], hits)
                apply_events(p, m, hits, m.clock[0] + taken)
            elif done > before:  # the samples have used the registers
                evaluate(p.code, p.table, lay, r, mode, m.clock[0] + h, x, k[6])
            finish = end if last and share == 1.0 else m.clock[0] + taken
            accept(p, m, finish, x)
            k[0] = k[6]
            if event:
                at_once = at_once + 1 if taken < 1e-12 * max(1.0, abs(finish)) else 0
                if at_once > 200:
                    return CHATTER
                status = settle(p.code, p.table, lay, r, mode, finish, m.state, k[0])
                if status != OK:
                    return status
    while done < len(plan.samples):
        states[done] = m.state
        sample(p, m, plan.samples[done], states[done], rate, outputs[done])
        done += 1
    return OK
