"""The integrator: exponential steps with exactly located events, set-valued friction and memories.

Compiled once for all plants: a plant is data (`Program`) that a register machine executes.

Within a step the mode of each friction element is fixed: +1 or −1 (sliding), 0 (stuck: the holding force keeps
the relative velocity at exactly 0 while it stays within the band [−forward, backward]), 2 (switched off).
Memories are play operators, value = clip(memory, lower, upper): a running maximum has no upper limit.
"""

from sim_hal.plant.engine.machine import (
    CHATTER,
    CLOCK,
    EMPTY_BAND,
    IDLE,
    LASTING,
    NO_GRIP,
    NOT_FINITE,
    OFF,
    OK,
    RATE,
    SCALE,
    STATE,
    STEP_VANISHED,
    STEPS,
    STOPPED,
    TIME,
    TOO_MANY_STEPS,
    WEIGHT,
    Limits,
    Machine,
    Schedule,
    columns_of,
    execute_rows,
    modes_of,
    rows_of,
)
from sim_hal.plant.engine.running import integrate

__all__ = [
    "CHATTER",
    "CLOCK",
    "EMPTY_BAND",
    "IDLE",
    "LASTING",
    "NOT_FINITE",
    "NO_GRIP",
    "OFF",
    "OK",
    "RATE",
    "SCALE",
    "STATE",
    "STEPS",
    "STEP_VANISHED",
    "STOPPED",
    "TIME",
    "TOO_MANY_STEPS",
    "WEIGHT",
    "Limits",
    "Machine",
    "Schedule",
    "columns_of",
    "execute_rows",
    "integrate",
    "modes_of",
    "rows_of",
]
