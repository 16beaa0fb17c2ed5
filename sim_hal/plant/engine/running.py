"""A run: step by step through the segments between known breaks, from sample to sample and event to event."""

from __future__ import annotations

import numpy as np

from sim_hal.plant.engine.events import apply_events, copy, dip, keep_memories, margins, settle, take_sides
from sim_hal.plant.engine.friction import add_force, grip, relative_velocity
from sim_hal.plant.engine.locating import hits, locate
from sim_hal.plant.engine.machine import (
    BEFORE,
    BETWEEN,
    CHATTER,
    CLOCK,
    END,
    END_OF_CODE,
    FLAG,
    FLAG_TIME,
    HERE,
    HIGH,
    KEPT,
    LASTING,
    MOST_STEPS,
    NF,
    NS,
    NU,
    NW,
    OFF,
    OK,
    OUTPUT,
    OUTPUTS,
    OWN,
    POINT,
    RATE,
    RATE_AT,
    SCALE,
    SEGMENT,
    SLOPE,
    START,
    START_VALUE,
    STATE,
    STEPS,
    STOPPED,
    TIME,
    TOO_MANY_STEPS,
    WANTED,
    M,
    Q,
    execute,
)
from sim_hal.plant.engine.propagate import SERIES_REACH, strength
from sim_hal.plant.engine.rates import jacobian_at, rates_at
from sim_hal.plant.engine.stepping import AGAIN, try_step
from sim_hal.plant.native import Floats1, Floats2, Floats3, Ints1, Ints2, entry

SWING = 0.8
"""Most by which an oscillation may go on within a step, in radians: what happens between two looks is told by the
values and rates at both, which serves for less than half a turn."""


def start(tab: Ints1, r: Floats1, mode: Ints1, w: Floats2) -> None:
    """Find what slides which way."""
    for j in range(tab[M]):
        if mode[j] != OFF:
            v = relative_velocity(tab, r, j, w, STATE)
            mode[j] = 1 if v > 0.0 else -1 if v < 0.0 else 0


def open_segment(
    code: Ints2, tab: Ints1, r: Floats1, mode: Ints1, w: Floats2, at: float, values: Floats1, slopes: Floats1,
    events: Floats1,
) -> int:  # fmt: skip
    """Take over the inputs and events from a break on; gives the rates there (row START)."""
    r[tab[SEGMENT]] = at
    for k in range(tab[NU]):
        r[tab[START_VALUE] + k] = values[k]
        r[tab[SLOPE] + k] = slopes[k]
    for i in range(tab[NF]):
        if r[tab[FLAG] + i] == 0.0 and events[i] <= w[CLOCK, TIME]:
            r[tab[FLAG] + i] = 1.0
            r[tab[FLAG_TIME] + i] = events[i]
    return settle(code, tab, r, mode, w, w[CLOCK, TIME])


def accept(code: Ints2, tab: Ints1, r: Floats1, mode: Ints1, w: Floats2, finish: float, look: int) -> None:
    """Make a point the present state: stuck elements exactly still, memories carried along.

    Where an event has been (the point HERE) its rates are left to `settle`.
    """
    w[CLOCK, TIME] = finish
    for s in range(tab[NS]):
        w[STATE, s] = w[POINT + look, s]
        w[RATE + START, s] = w[RATE + look, s]
    moved = False
    for j in range(tab[M]):
        if mode[j] == 0:
            v = relative_velocity(tab, r, j, w, STATE)
            if v != 0.0 and grip(tab, r, j, j) != 0.0:
                add_force(tab, r, j, -v / grip(tab, r, j, j), w, STATE)
                moved = True
    for s in range(tab[NS]):
        w[SCALE, s] = max(w[SCALE, s], abs(w[STATE, s]))
    if moved and look == END:
        rates_at(code, tab, r, mode, w, finish, STATE, RATE + START)
    keep_memories(tab, r, mode)


def within(code: Ints2, tab: Ints1, r: Floats1, mode: Ints1, w: Floats2, h: float, terms: int) -> float:
    """Share of the step taken by which something has happened that its end does not show, 1 if nothing has.

    Negative where that cannot be told, for want of a series.
    """
    found = 1.0
    for i in range(tab[M] + tab[Q] + tab[NW] + tab[NF]):
        share = dip(w, h, i)
        if share > 0.0 and terms == 0:
            return -1.0
        if share > 0.0 and share < found and hits(code, tab, r, mode, w, h, terms, share, BETWEEN):
            found = share
    return found


def step_size(wanted: float, left: float, whole: float, stiff: bool) -> float:
    """Size of the next step: at most what is wanted and what is left.

    Stiff steps are the whole stretch between two samples halved some times: propagators of few sizes are needed.
    """
    h = left
    if wanted < 0.999999 * left and not stiff:
        h = left / np.ceil(left / wanted)
    elif wanted < 0.999999 * left:
        h = whole
        while h > wanted or h > 1.000001 * left:
            h *= 0.5
        h = left if h > 0.999999 * left else h
    return h


def go_on(
    code: Ints2, tab: Ints1, r: Floats1, mode: Ints1, w: Floats2, until: float, whole: float, careful: float
) -> tuple[int, int, float]:
    """One step towards `until`, not past the first event.

    `whole` is how long the way was from the last sample or event, `careful` the time up to which steps must tell what
    is within them. A status, the number of events and the new `careful`.
    """
    size, swing = strength(w, tab[NS])
    left = until - w[CLOCK, TIME]
    most = min(w[CLOCK, WANTED], SWING / swing if swing > 0.0 else np.inf)
    if w[CLOCK, TIME] < careful:
        most = min(most, SERIES_REACH / size)
    h = step_size(most, left, whole, size * min(most, left) > 1.001 * SERIES_REACH)
    last = h == left
    status, terms, share = try_step(code, tab, r, mode, w, h, last, size * h > 1.001 * SERIES_REACH)
    events = 1 if share < 1.0 else 0
    if status == OK and events == 0:
        event = margins(code, tab, r, mode, w, POINT + END, RATE + END, HIGH)
        share = within(code, tab, r, mode, w, h, terms)
        if share < 0.0 or (event and terms == 0):
            status, careful = AGAIN, w[CLOCK, TIME] + h
        elif event or share < 1.0:
            events = 1
            share = locate(code, tab, r, mode, w, h, terms, share)
    if status == OK:
        finish = until if last and share == 1.0 else w[CLOCK, TIME] + h * share
        changed = events > 0
        if changed:
            apply_events(tab, r, mode, w, HIGH, finish)
        else:
            changed = take_sides(tab, r, mode, False)
        accept(code, tab, r, mode, w, finish, END if events == 0 else HERE)
        if events > 0:
            status = settle(code, tab, r, mode, w, finish)
        if changed:
            margins(code, tab, r, mode, w, STATE, RATE + START, BEFORE)
        else:
            copy(w, BEFORE, HIGH)
    return status, events, careful


def segment(
    code: Ints2, tab: Ints1, r: Floats1, mode: Ints1, w: Floats2, end: float, stop: int, samples: Floats1, done: int,
    outputs: Floats2, states: Floats2,
) -> tuple[int, int]:  # fmt: skip
    """Go through a segment whose start is settled, giving the samples before its end; a status, and how many are done
    in all.
    """
    at_once = 0  # events in a row without time passing
    careful, whole_from, aim = -np.inf, w[CLOCK, TIME], -np.inf
    status = OK
    jacobian_at(code, tab, r, mode, w)
    margins(code, tab, r, mode, w, STATE, RATE + START, BEFORE)
    done = emit(code, tab, r, w, samples, done, outputs, states)
    while status == OK and w[CLOCK, TIME] < end:
        until = min(end, samples[done]) if done < len(samples) else end
        before = w[CLOCK, TIME]
        if until != aim:
            aim, whole_from = until, before
        status, events = AGAIN, 0
        while status == AGAIN:
            w[CLOCK, STEPS] += 1.0
            status = TOO_MANY_STEPS
            if w[CLOCK, STEPS] <= w[CLOCK, MOST_STEPS]:
                status, events, careful = go_on(code, tab, r, mode, w, until, until - whole_from, careful)
        if status == OK and events > 0:
            whole_from = w[CLOCK, TIME]
            at_once = at_once + 1 if whole_from - before < 1e-12 * max(1.0, abs(before)) else 0
            if at_once > 200:
                status = CHATTER
            elif stop >= 0 and r[tab[FLAG] + stop] != 0.0:
                status = STOPPED
        if status == OK and w[CLOCK, TIME] < end:
            jacobian_at(code, tab, r, mode, w)
            done = emit(code, tab, r, w, samples, done, outputs, states)
    return status, done


def emit(
    code: Ints2,
    tab: Ints1,
    r: Floats1,
    w: Floats2,
    samples: Floats1,
    done: int,
    outputs: Floats2,
    states: Floats2,
) -> int:
    """Give the samples that are due at the point just evaluated; returns how many are done in all."""
    while done < len(samples) and samples[done] <= w[CLOCK, TIME]:
        for s in range(tab[NS]):
            r[tab[RATE_AT] + s] = w[RATE + START, s]
            states[done, s] = w[STATE, s]
        execute(code, tab[OUTPUT], tab[END_OF_CODE], r)
        for o in range(outputs.shape[1]):
            outputs[done, o] = r[tab[tab[OUTPUTS] + o]]
        done += 1
    return done


@entry
def integrate(
    code: Ints2, tab: Ints1, registers: Floats2, modes: Ints2, starts: Floats3, w: Floats2, breaks: Floats1,
    inputs: Floats2, slopes: Floats2, events: Floats1, samples: Floats1, stop: int, outputs: Floats3, states: Floats3,
    statuses: Ints1,
) -> None:  # fmt: skip
    """Run machines one after the other through the same segments; each gets a status.

    registers (n, registers), modes (n, modes) and starts (n, LASTING, columns) are those of the machines, with
    parameters, initial state, flags and memories filled in, and get what these are at the end; w is room. breaks
    (nb,), inputs and slopes (nb, nu), events (nf,) and samples (ns,) are the schedule's; fills outputs (n, ns, no)
    and states (n, ns, ns) at the samples. A run ends early where flag `stop` latches (−1: none).
    """
    for i in range(len(registers)):
        r, mode, kept = registers[i], modes[i], starts[i]
        for row in range(LASTING):
            for column in range(w.shape[1]):
                w[row, column] = kept[row, column]
        if w[CLOCK, OWN] == 0.0:
            w[KEPT, 0] = 0.0
        w[CLOCK, OWN] = 1.0
        start(tab, r, mode, w)
        done, status = 0 * len(samples), OK  # no plain 0: see machine.py
        for b in range(len(breaks)):
            w[CLOCK, TIME] = breaks[b]
            status = open_segment(code, tab, r, mode, w, breaks[b], inputs[b], slopes[b], events)
            if status != OK:
                break
            end = breaks[min(b + 1, len(breaks) - 1)]
            status, done = segment(code, tab, r, mode, w, end, stop, samples, done, outputs[i], states[i])
            if status != OK:
                break
        statuses[i] = status
        for row in range(LASTING):
            for column in range(w.shape[1]):
                kept[row, column] = w[row, column]
