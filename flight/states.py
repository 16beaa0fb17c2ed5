"""The vocabulary of the hop state machine: phases, what it is told each tick, what it answers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from types import MappingProxyType
from typing import Any, NamedTuple, TypeVar

from hal.dictionary import dictionary


class Phase(StrEnum):
    """Where the robot is between power-up and the evaluated hop."""

    POWER_UP = "power_up"
    SELF_TEST = "self_test"
    HOMING = "homing"
    LATCH_CHECK = "latch_check"
    READY = "ready"
    TENSIONING = "tensioning"
    HOLD = "hold"
    ARMED = "armed"
    FIRING = "firing"
    FLIGHT = "flight"
    LANDED = "landed"
    EVALUATE = "evaluate"
    DE_TENSION = "de_tension"
    SAFE_HOLD = "safe_hold"
    SAFE = "safe"


_ALWAYS = frozenset({Phase.DE_TENSION, Phase.SAFE_HOLD, Phase.SAFE})

# Phases that may follow each phase (besides staying). DE_TENSION, SAFE_HOLD and SAFE may follow any that works.
TRANSITIONS: dict[Phase, frozenset[Phase]] = {
    Phase.POWER_UP: frozenset({Phase.SELF_TEST}) | _ALWAYS,
    Phase.SELF_TEST: frozenset({Phase.HOMING}) | _ALWAYS,
    Phase.HOMING: frozenset({Phase.LATCH_CHECK}) | _ALWAYS,
    Phase.LATCH_CHECK: frozenset({Phase.READY, Phase.HOMING}) | _ALWAYS,
    Phase.READY: frozenset({Phase.TENSIONING}) | _ALWAYS,
    Phase.TENSIONING: frozenset({Phase.HOLD}) | _ALWAYS,
    Phase.HOLD: frozenset({Phase.ARMED}) | _ALWAYS,
    Phase.ARMED: frozenset({Phase.HOLD, Phase.FIRING}) | _ALWAYS,
    Phase.FIRING: frozenset({Phase.FLIGHT}) | _ALWAYS,
    Phase.FLIGHT: frozenset({Phase.LANDED}) | _ALWAYS,
    Phase.LANDED: frozenset({Phase.EVALUATE}) | _ALWAYS,
    Phase.EVALUATE: frozenset({Phase.HOMING}) | _ALWAYS,
    Phase.DE_TENSION: frozenset({Phase.LATCH_CHECK, Phase.SAFE}),
    Phase.SAFE_HOLD: frozenset({Phase.DE_TENSION, Phase.SAFE}),
    Phase.SAFE: frozenset({Phase.SELF_TEST}),  # by the ground's `reset` alone
}

STOWED = "stowed"
"""The reason to end that is no fault: the nut is home and nothing is stored."""

SENSORS = ("motor_current", "nut_encoder", "switches", "spring", "magnet_current", "accelerometer")


NEVER = float("-inf")
"""When a sensor has delivered that has not yet."""


class Snapshot(NamedTuple):
    """The latest reading of every sensor at one tick, each with the time at which it was sampled.

    A time of minus infinity says that the sensor has not delivered yet. Of the streamed sensors the newest
    sample counts; of the accelerometer also the lowest and highest of the newest batch.
    """

    time_s: float
    motor_current_a: float = 0.0
    nut_position_m: float = 0.0
    at_home: bool = False
    latch_closed: bool = False
    compression_m: float = 0.0
    magnet_current_a: float = 0.0
    specific_force_m_s2: float = 0.0
    specific_force_low_m_s2: float = 0.0
    specific_force_high_m_s2: float = 0.0
    sampled_s: Mapping[str, float] = MappingProxyType({})
    tick_late_s: float = 0.0
    unstroked_share: float = 0.0  # time since the watchdog was stroked, of its timeout
    magnet_failed: bool = False  # it did not take its newest command
    log_failed: bool = False  # what happens is no longer recorded
    memory_failed: bool = False  # the state of the spring could not be put on record
    supply_v: float | None = None  # where the board measures it
    failed_reads: int = 0  # at this tick
    ground_heard: bool = False  # a command of the ground came with this tick

    def age_s(self, sensor: str) -> float:
        """Age of the sensor's newest sample; infinite if there is none."""
        return self.time_s - self.sampled_s.get(sensor, NEVER)


@dataclass(frozen=True, slots=True)
class Target:
    """What is to be stored: usable energy and the compression at which the spring stores it."""

    energy_used_j: float
    compression_m: float


@dataclass(frozen=True, slots=True)
class LineFit:
    """Running sums of a straight line s(x); used to see that the spring follows the nut."""

    count: int = 0
    sum_x: float = 0.0
    sum_s: float = 0.0
    sum_xx: float = 0.0
    sum_xs: float = 0.0

    def add(self, x: float, s: float) -> LineFit:
        return LineFit(
            self.count + 1, self.sum_x + x, self.sum_s + s, self.sum_xx + x * x, self.sum_xs + x * s
        )

    @property
    def slope(self) -> float:
        """ds/dx; 0 while the points do not spread."""
        spread = self.count * self.sum_xx - self.sum_x**2
        return (self.count * self.sum_xs - self.sum_x * self.sum_s) / spread if spread > 0.0 else 0.0

    def crossing(self, slope: float) -> float:
        """The x at which a line of the given slope through the points' centre has s = 0."""
        return self.sum_x / self.count - self.sum_s / self.count / slope


class Sameness(NamedTuple):
    """How many new samples in a row have repeated the one before to the last bit."""

    value: float | None = None
    sampled_s: float = float("-inf")
    repeats: int = 0

    def after(self, value: float, sampled_s: float) -> Sameness:
        """With one more reading; one that is not new says nothing."""
        if sampled_s <= self.sampled_s:
            return self
        return Sameness(value, sampled_s, self.repeats + 1 if value == self.value else 0)


class Machine(NamedTuple):
    """The whole state of the hop state machine. Positions are the encoder's.

    A named tuple, because it is made anew in every tick and a data class of this size takes several times as long.
    """

    phase: Phase = Phase.POWER_UP
    since_s: float = 0.0
    hop_index: int = 0
    drive_trusted: bool = True
    reason: str = ""  # why the machine is in SAFE, or will be once the spring is relaxed
    home_m: float | None = None
    taut_m: float | None = None
    target: Target | None = None
    fire_s: float | None = None
    voltage_v: float = 0.0
    wanted_m_s: float = 0.0  # the nut speed asked of the drive
    beyond_ticks: Mapping[str, int] = MappingProxyType({})  # by monitor: ticks beyond its limit
    retries: int = 0  # of the latch test
    quiet_s: float | None = None
    latch_line: LineFit = LineFit()

    # from here on what each tick's readings tell, see `with_observed`
    compression_m: float = 0.0  # spring sensor and encoder, fused
    unloaded_ticks: int = 0
    loaded: bool = True  # until spring sensor and home switch show otherwise
    same_current: Sameness = Sameness()
    same_force: Sameness = Sameness()
    position_m: float | None = None
    last_s: float | None = None
    speed_m_s: float = 0.0
    moved_s: float = 0.0  # last time at which the nut was seen to follow the voltage
    stable_ticks: int = 0
    elapsed_s: float | None = None  # between the two newest ticks
    failed_reads: float = 0.0  # of any sensor, those long ago forgotten
    winding_rise_k: float = 0.0  # of the motor, above its surroundings
    heard_s: float | None = None  # when the ground was heard last
    mean_current_a: float = 0.0

    def reason_after(self, reason: str) -> str:
        """Why it ends, now that `reason` came up too: the first fault. A plan to stow gives way to any."""
        return self.reason if self.reason not in ("", STOWED) else reason


State = TypeVar("State", Machine, Snapshot)


class Outputs(NamedTuple):
    """What the actuators and sensors shall do from this tick on."""

    voltage_v: float = 0.0
    magnet_on: bool = False
    spring_hop_rate: bool = False
    evaluate: bool = False


_PLACES = {kind: {name: at for at, name in enumerate(kind._fields)} for kind in (Machine, Snapshot)}


def changed(state: State, **changes: Any) -> State:
    """As `_replace`, in half of its time where few fields change. Raises `KeyError` for no such field."""
    fields: list[Any] = list(state)
    kind = type(state)
    places = _PLACES[kind]
    for name, value in changes.items():
        fields[places[name]] = value
    return tuple.__new__(kind, fields)  # `_make` would only count them once more


_FIRST_OBSERVED = Machine._fields.index("compression_m")
OBSERVED = Machine._fields[_FIRST_OBSERVED:]
"""The fields that each tick's readings tell."""


def with_observed(machine: Machine, values: tuple[Any, ...]) -> Machine:
    """The machine with the fields `OBSERVED`, in their order: `_replace` takes five times as long."""
    if len(values) != len(OBSERVED):
        raise ValueError(f"{len(values)} values for {len(OBSERVED)} fields")
    return tuple.__new__(Machine, machine[:_FIRST_OBSERVED] + values)


@dataclass(frozen=True, slots=True)
class Event:
    """Something worth telling: a name of the dictionary, its severity there, and the particulars."""

    name: str
    details: dict[str, Any] = field(default_factory=dict)

    @property
    def severity(self) -> str:
        """info, warning or fault. Raises `KeyError` for a name that is not in the dictionary."""
        return dictionary().events[self.name].severity


class Step(NamedTuple):
    """The machine's answer to one tick."""

    machine: Machine
    outputs: Outputs
    events: tuple[Event, ...] = ()
    monitors_alive: bool = True
