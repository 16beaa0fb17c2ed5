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

from sim_hal.plant.jit import compiled
from sim_hal.plant.program import OPCODES, Floats, Ints, Program

OK, NOT_FINITE, STEP_VANISHED, TOO_MANY_STEPS, CHATTER, EMPTY_BAND, NO_GRIP = range(7)
OFF = 2  # mode of a friction element without strength
IDLE = 3  # mode of a memory without strength
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

    `clock` holds time, next step size, start time and the number of steps tried.
    """

    clock: Floats  # (4,)
    registers: Floats
    state: Floats  # (ns,)
    scale: Floats  # (ns,) largest magnitude so far
    weight: Floats  # (ns,) 0 where a state does not count for the error
    mode: Ints  # (m,)
    force: Floats  # (m,)
    memory: Floats  # (q,)
    memory_mode: Ints  # (q,) 0 holding, 1 at the lower limit, 2 at the upper, 3 idle
    flag: Floats  # (nf,)
    flag_time: Floats  # (nf,)
    input: Floats  # (2, nu): value at the segment's start and slope
    segment: Floats  # (1,): the segment's start


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


@compiled
def section(p: Program, m: Machine, which: int) -> None:
    """Run one section of the program."""
    execute(p.code, p.sections[which], p.sections[which + 1], m.registers)


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


@compiled
def grip(p: Program, r: Floats, i: int, j: int) -> float:
    """What one unit of element j's force adds to the rate of element i's relative velocity."""
    total = 0.0
    for s in range(p.velocity.shape[1]):
        total += r[p.velocity[i, s]] * r[p.per_force[j, s]]
    return total


@compiled
def slide_rate(p: Program, r: Floats, j: int, rate: Floats) -> float:
    """Rate of element j's relative velocity."""
    total = 0.0
    for s in range(len(rate)):
        total += r[p.velocity[j, s]] * rate[s]
    return total


@compiled
def relative_velocity(p: Program, r: Floats, j: int, x: Floats) -> float:
    """Relative velocity of friction element j."""
    total = r[p.velocity_offset[j]]
    for s in range(len(x)):
        total += r[p.velocity[j, s]] * x[s]
    return float(total)


@compiled
def apply_force(p: Program, r: Floats, j: int, force: float, rate: Floats) -> None:
    """Add the force of friction element j to the rates."""
    for s in range(len(rate)):
        rate[s] += r[p.per_force[j, s]] * force


@compiled
def evaluate(p: Program, m: Machine, t: float, x: Floats, rate: Floats) -> int:
    """Rates at time t and state x in the present modes; friction forces go to `m.force`."""
    r = m.registers
    r[p.layout.time] = t
    for k in range(m.input.shape[1]):
        r[p.layout.input + k] = m.input[0, k] + m.input[1, k] * (t - m.segment[0])
    r[p.layout.state : p.layout.state + len(x)] = x
    section(p, m, 1)
    for s in range(len(x)):
        rate[s] = r[p.rates[s]]
    stuck = 0
    for j in range(len(m.mode)):
        if m.mode[j] == 0:
            stuck += 1
        elif m.mode[j] != OFF:
            m.force[j] = -r[p.forward[j]] if m.mode[j] > 0 else r[p.backward[j]]
            apply_force(p, r, j, m.force[j], rate)
    if stuck > 0:
        return hold(p, m, stuck, rate)
    return OK


@compiled
def hold(p: Program, m: Machine, stuck: int, rate: Floats) -> int:
    """Find and apply the forces that keep the stuck elements still (0 where a force has no grip)."""
    r = m.registers
    which = np.empty(stuck, np.int64)
    n = 0
    for j in range(len(m.mode)):
        if m.mode[j] == 0:
            m.force[j] = 0.0
            if grip(p, r, j, j) != 0.0:
                which[n] = j
                n += 1
    if n == 1:
        j = which[0]
        m.force[j] = -slide_rate(p, r, j, rate) / grip(p, r, j, j)
        apply_force(p, r, j, m.force[j], rate)
        return OK
    a = np.empty((n, n))
    b = np.empty(n)
    for i in range(n):
        b[i] = -slide_rate(p, r, which[i], rate)
        for k in range(n):
            a[i, k] = grip(p, r, which[i], which[k])
    if not solve_small(a, b):
        return NO_GRIP
    for i in range(n):
        m.force[which[i]] = b[i]
        apply_force(p, r, which[i], b[i], rate)
    return OK


@compiled
def leaving(p: Program, m: Machine, j: int) -> int:
    """+1 or −1 where the holding force of stuck element j is outside its band, and to which side it moves."""
    r = m.registers
    tolerance = BAND_TOLERANCE * (abs(r[p.forward[j]]) + abs(r[p.backward[j]]))
    if m.force[j] < -r[p.forward[j]] - tolerance:
        return 1
    if m.force[j] > r[p.backward[j]] + tolerance:
        return -1
    return 0


@compiled
def release(p: Program, m: Machine, rate: Floats) -> bool:
    """Decide which stuck elements start to slide, all together (projected Gauss–Seidel on their bands)."""
    r = m.registers
    n = len(m.mode)
    for j in range(n):  # back to the rates without the stuck elements' forces
        if m.mode[j] == 0:
            apply_force(p, r, j, -m.force[j], rate)
            m.force[j] = 0.0
    for _ in range(200):
        for j in range(n):
            if m.mode[j] == 0 and grip(p, r, j, j) != 0.0:
                target = m.force[j] - slide_rate(p, r, j, rate) / grip(p, r, j, j)
                target = min(max(target, -r[p.forward[j]]), r[p.backward[j]])
                apply_force(p, r, j, target - m.force[j], rate)
                m.force[j] = target
    released = False
    for j in range(n):
        if m.mode[j] == 0 and grip(p, r, j, j) != 0.0:
            width = BAND_TOLERANCE * (abs(r[p.forward[j]]) + abs(r[p.backward[j]]))
            pull = slide_rate(p, r, j, rate) / grip(p, r, j, j)
            if abs(pull) > width:
                m.mode[j] = 1 if pull > 0.0 else -1
                released = True
    return released


@compiled
def settle(p: Program, m: Machine, rate: Floats) -> int:
    """Bring flags, friction modes and memories into agreement with the state; gives the rates there."""
    r = m.registers
    for _ in range(100):
        status = evaluate(p, m, m.clock[0], m.state, rate)
        if status != OK:
            return status
        section(p, m, 2)
        changed = False
        for i in range(len(m.flag)):
            if m.flag[i] == 0.0 and p.conditions[i] >= 0 and r[p.conditions[i]] >= 0.0:
                set_flag(p, m, i, m.clock[0])
                changed = True
        if changed:
            continue
        for j in range(len(m.mode)):
            if m.mode[j] != OFF and empty_band(r[p.forward[j]], r[p.backward[j]]):
                return EMPTY_BAND
            if m.mode[j] == 0 and leaving(p, m, j) != 0:
                changed = True
        if changed and release(p, m, rate):
            continue
        settle_memories(p, m, rate)
        return OK
    return CHATTER


@compiled
def empty_band(forward: float, backward: float) -> bool:
    """Whether no force at all would keep a friction element still."""
    return not forward + backward >= -BAND_TOLERANCE * (abs(forward) + abs(backward))


@compiled
def set_flag(p: Program, m: Machine, i: int, at: float) -> None:
    """Latch flag i."""
    m.flag[i] = 1.0
    m.flag_time[i] = at
    m.registers[p.layout.flag + i] = 1.0
    m.registers[p.layout.flag_time + i] = at


@compiled
def limit_rate(r: Floats, slope: Ints, rate: Floats) -> float:
    """Rate of a memory's limit."""
    total = 0.0
    for s in range(len(rate)):
        total += r[slope[s]] * rate[s]
    return total


@compiled
def settle_memories(p: Program, m: Machine, rate: Floats) -> None:
    """Store each memory's value and whether it follows a limit from here on."""
    r = m.registers
    for q in range(len(m.memory)):
        low = r[p.lower[q]]
        high = r[p.upper[q]]
        m.memory[q] = min(max(m.memory[q], low), high)
        r[p.layout.memory + q] = m.memory[q]
        if m.memory_mode[q] == IDLE:
            continue
        m.memory_mode[q] = 0
        if m.memory[q] == low and limit_rate(r, p.lower_slope[q], rate) >= 0.0:
            m.memory_mode[q] = 1
        elif m.memory[q] == high and limit_rate(r, p.upper_slope[q], rate) <= 0.0:
            m.memory_mode[q] = 2


@compiled
def triggered(p: Program, m: Machine, x: Floats, rate: Floats, hits: Ints) -> bool:
    """Whether the mode of anything no longer fits at the point just evaluated; `hits` says of what.

    `hits` lists friction elements, then flags, then memories.
    """
    r = m.registers
    n, nf = len(m.mode), len(m.flag)
    found = False
    for j in range(n):
        hits[j] = 0
        if m.mode[j] == 0:
            hits[j] = leaving(p, m, j)
        elif m.mode[j] != OFF and m.mode[j] * relative_velocity(p, r, j, x) < 0.0:
            hits[j] = 2
        found = found or hits[j] != 0
    for i in range(nf):
        hits[n + i] = 0
        if m.flag[i] == 0.0 and p.conditions[i] >= 0 and r[p.conditions[i]] >= 0.0:
            hits[n + i] = 1
            found = True
    for q in range(len(m.memory)):
        low, high = r[p.lower[q]], r[p.upper[q]]
        mode = m.memory_mode[q]
        hit = mode == 0 and (low > m.memory[q] or high < m.memory[q])
        hit = hit or (mode == 1 and limit_rate(r, p.lower_slope[q], rate) < 0.0)
        hit = hit or (mode == 2 and limit_rate(r, p.upper_slope[q], rate) > 0.0)
        hits[n + nf + q] = 1 if hit else 0
        found = found or hit
    return found


@compiled
def stages(p: Program, m: Machine, h: float, k: Floats, x: Floats, limits: Limits) -> float:
    """One step of size h from the present state; k[0] is the rate there. End in `x`; returns the error."""
    for stage in range(1, 7):
        for s in range(len(x)):
            total = 0.0
            for n in range(stage):
                total += _A[stage, n] * k[n, s]
            x[s] = m.state[s] + h * total
        if evaluate(p, m, m.clock[0] + _C[stage] * h, x, k[stage]) != OK:
            return np.nan
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
def interpolate(m: Machine, h: float, k: Floats, share: float, x: Floats) -> None:
    """State at `share` of the step just taken."""
    for s in range(len(x)):
        total = 0.0
        for n in range(7):
            weight = ((_P[n, 3] * share + _P[n, 2]) * share + _P[n, 1]) * share + _P[n, 0]
            total += weight * k[n, s]
        x[s] = m.state[s] + h * share * total


@compiled
def misfit_at(
    p: Program, m: Machine, h: float, k: Floats, share: float, x: Floats, rate: Floats, hits: Ints
) -> bool:
    """Whether an event has happened by `share` of the step."""
    interpolate(m, h, k, share, x)
    if evaluate(p, m, m.clock[0] + share * h, x, rate) != OK:
        return True
    section(p, m, 2)
    return triggered(p, m, x, rate, hits)


@compiled
def turned_within(p: Program, m: Machine, h: float, k: Floats, x: Floats) -> float:
    """First quarter of the step at which a sliding element has turned, or 0: catches a brief reversal."""
    for quarter in range(1, 4):
        sliding = False
        for j in range(len(m.mode)):
            sliding = sliding or abs(m.mode[j]) == 1
        if not sliding:
            return 0.0
        interpolate(m, h, k, 0.25 * quarter, x)
        for j in range(len(m.mode)):
            if abs(m.mode[j]) == 1 and m.mode[j] * relative_velocity(p, m.registers, j, x) < 0.0:
                return 0.25 * quarter
    return 0.0


@compiled
def apply_events(p: Program, m: Machine, hits: Ints, at: float) -> None:
    """Change the modes of what `triggered` has found at time `at`."""
    n, nf = len(m.mode), len(m.flag)
    for j in range(n):
        if hits[j] == 2:
            m.mode[j] = 0
        elif hits[j] != 0:
            m.mode[j] = hits[j]
    for i in range(nf):
        if hits[n + i] != 0:
            set_flag(p, m, i, at)
    for q in range(len(m.memory)):
        if hits[n + nf + q] != 0 and m.memory_mode[q] == 0:
            low, high = m.registers[p.lower[q]], m.registers[p.upper[q]]
            m.memory[q] = low if abs(low - m.memory[q]) < abs(high - m.memory[q]) else high
            m.registers[p.layout.memory + q] = m.memory[q]


@compiled
def accept(p: Program, m: Machine, finish: float, x: Floats) -> None:
    """Make the step's end the present state: stuck elements exactly still, memories carried along."""
    m.clock[0] = finish
    m.state[:] = x
    r = m.registers
    for j in range(len(m.mode)):
        if m.mode[j] == 0:
            w = relative_velocity(p, r, j, m.state)
            if w != 0.0 and grip(p, r, j, j) != 0.0:
                apply_force(p, r, j, -w / grip(p, r, j, j), m.state)
    for s in range(len(x)):
        m.scale[s] = max(m.scale[s], abs(m.state[s]))
    for q in range(len(m.memory)):
        if m.memory_mode[q] == 1:
            m.memory[q] = r[p.lower[q]]
        elif m.memory_mode[q] == 2:
            m.memory[q] = r[p.upper[q]]
        r[p.layout.memory + q] = m.memory[q]


@compiled
def sample(p: Program, m: Machine, t: float, x: Floats, rate: Floats, output: Floats) -> None:
    """Outputs at time t and state x."""
    evaluate(p, m, t, x, rate)
    r = m.registers
    r[p.layout.rate : p.layout.rate + len(x)] = rate
    section(p, m, 2)
    section(p, m, 3)
    for o in range(len(output)):
        output[o] = r[p.outputs[o]]


@compiled
def start(p: Program, m: Machine) -> None:
    """Prepare a run: parameters are in the registers; loads the rest and finds who slides where."""
    r = m.registers
    section(p, m, 0)
    r[p.layout.flag : p.layout.flag + len(m.flag)] = m.flag
    r[p.layout.flag_time : p.layout.flag_time + len(m.flag)] = m.flag_time
    r[p.layout.memory : p.layout.memory + len(m.memory)] = m.memory
    for j in range(len(m.mode)):
        if m.mode[j] != OFF:
            m.mode[j] = np.int64(np.sign(relative_velocity(p, r, j, m.state)))


@compiled
def open_segment(p: Program, m: Machine, plan: Schedule, b: int, rate: Floats) -> int:
    """Take over the inputs and events from break b on."""
    m.segment[0] = plan.breaks[b]
    m.input[0] = plan.inputs[b]
    m.input[1] = plan.slopes[b]
    for i in range(len(m.flag)):
        if m.flag[i] == 0.0 and plan.events[i] <= m.clock[0]:
            set_flag(p, m, i, plan.events[i])
    return settle(p, m, rate)


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
def emit(
    p: Program, m: Machine, plan: Schedule, done: int, h: float, taken: float, k: Floats, outputs: Floats,
    states: Floats,
) -> int:  # fmt: skip
    """Give the samples that fall into the step, up to `taken`; returns how many are done in all."""
    rate = np.empty(len(m.state))
    until = m.clock[0] + taken
    while done < len(plan.samples) and plan.samples[done] < until:
        interpolate(m, h, k, (plan.samples[done] - m.clock[0]) / h, states[done])
        sample(p, m, plan.samples[done], states[done], rate, outputs[done])
        done += 1
    return done


@compiled
def try_step(p: Program, m: Machine, h: float, last: bool, k: Floats, x: Floats, limits: Limits) -> int:
    """One step of size h with error control: OK, −1 to try again with the smaller step, or what is wrong."""
    error = stages(p, m, h, k, x, limits)
    if error <= 1.0:
        wanted = h * min(5.0, 0.9 * max(error, 1e-6) ** -0.2)
        m.clock[1] = max(wanted, m.clock[1]) if last else wanted
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
    k, x, y, rate = np.zeros((7, ns)), np.empty(ns), np.empty(ns), np.empty(ns)
    hits = np.zeros(len(m.mode) + len(m.flag) + len(m.memory), np.int64)
    done = 0
    at_once = 0  # events in a row without time passing
    for b in range(len(plan.breaks)):
        m.clock[0] = plan.breaks[b]
        status = open_segment(p, m, plan, b, k[0])
        if status != OK:
            return status
        end = plan.breaks[min(b + 1, len(plan.breaks) - 1)]
        while m.clock[0] < end:
            m.clock[3] += 1.0
            if m.clock[3] > limits.steps:
                return TOO_MANY_STEPS
            left = end - m.clock[0]
            last = m.clock[1] >= 0.999999 * left
            h = left if last else m.clock[1]
            status = try_step(p, m, h, last, k, x, limits)
            if status == -1:
                continue
            if status != OK:
                return status
            section(p, m, 2)
            event = triggered(p, m, x, k[6], hits)
            quarter = turned_within(p, m, h, k, y)
            share = 1.0
            if event or quarter > 0.0:
                event = True
                share = locate(p, m, h, k, quarter if quarter > 0.0 else 1.0, y, rate, hits)
            taken = h * share
            before = done
            done = emit(p, m, plan, done, h, taken, k, outputs, states)
            if event:
                stages(p, m, taken, k, x, limits)
                if np.sum(np.abs(hits)) == 0:  # seen at the step's very end only, by rounding
                    section(p, m, 2)
                    triggered(p, m, x, k[6], hits)
                apply_events(p, m, hits, m.clock[0] + taken)
            elif done > before:
                evaluate(p, m, m.clock[0] + h, x, k[6])  # the samples have used the registers
            finish = end if last and share == 1.0 else m.clock[0] + taken
            accept(p, m, finish, x)
            k[0] = k[6]
            if event:
                at_once = at_once + 1 if taken < 1e-12 * max(1.0, abs(finish)) else 0
                status = CHATTER if at_once > 200 else settle(p, m, k[0])
                if status != OK:
                    return status
    while done < len(plan.samples):
        states[done] = m.state
        sample(p, m, plan.samples[done], states[done], rate, outputs[done])
        done += 1
    return OK
