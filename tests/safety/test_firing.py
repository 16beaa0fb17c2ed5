"""Nothing but arm and fire, in order, in time, signed, with all well, reaches the magnet.

Shown twice: by every reachable state of the machine and its interlocks, and by random runs against a model of a few
lines, which knows the readings and the commands and nothing of the machine. Machines that were broken on purpose show
that both would have seen it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import hypothesis.strategies as st
import pytest
from hypothesis import Phase as HypothesisPhase
from hypothesis import settings as hypothesis_settings
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule, run_state_machine_as_test

from flight import commands, hop_machine
from flight import settings as flight_settings
from flight.states import SENSORS, Machine, Phase, Snapshot
from ground.state_space.choices import Alphabet
from ground.state_space.explore import explore
from hal.dictionary import dictionary
from hal.readings import GroundCommand

SETTINGS = flight_settings.load()
PERIOD_S = SETTINGS.tick.period_s
OLD_S, SOON_S, LATE_S = 0.02, 0.25, 5.0  # a reading that is too old; earliest and latest fire after arm
REST = 8.874
TAUT_M, NUT_PER_SPRING = 0.0005, 1.0 + 30600.0 / 190000.0

HOLDING = (Phase.READY, Phase.HOLD, Phase.ARMED, Phase.FIRING)


class Robot:
    """Exact readings of a robot that stands, its spring wound up by the nut as far as it was driven."""

    def __init__(self) -> None:
        self.machine, self.magnet_on = Machine(), False
        self.now_s, self.nut_m, self.latched = 0.0, 0.002, False
        self.silent_since_s: dict[str, float] = {}
        self.shakes = self.log_failed = False
        self.noise = 1e-3

    @property
    def compression_m(self) -> float:
        return max(self.nut_m - TAUT_M, 0.0) / NUT_PER_SPRING if self.latched else 0.0

    def snapshot(self) -> Snapshot:
        self.noise = -self.noise
        force = REST + self.noise + (2.0 if self.shakes else 0.0)
        return Snapshot(
            time_s=self.now_s,
            motor_current_a=self.noise,
            nut_position_m=self.nut_m,
            at_home=self.nut_m <= 0.0,
            latch_closed=self.latched,
            compression_m=self.compression_m,
            specific_force_m_s2=force,
            specific_force_low_m_s2=force,
            specific_force_high_m_s2=force,
            sampled_s={name: self.silent_since_s.get(name, self.now_s) for name in SENSORS},
            log_failed=self.log_failed,
        )

    def tick(self, *orders: GroundCommand) -> None:
        self.now_s += PERIOD_S
        step = hop_machine.step(self.machine, self.snapshot(), orders, SETTINGS)
        self.machine, self.magnet_on = step.machine, step.outputs.magnet_on
        voltage_v, phase = step.outputs.voltage_v, self.machine.phase
        friction = phase in HOLDING or (phase is Phase.TENSIONING and abs(voltage_v) < 1.2)
        if not friction:
            speed_m_s = voltage_v / SETTINGS.drive.torque_constant_n_m_a * SETTINGS.drive.travel_per_radian_m
            self.nut_m = max(self.nut_m + speed_m_s * PERIOD_S, -1e-3)
        self.latched = self.latched or self.nut_m <= 0.0


@cache
def held() -> Robot:
    """A robot that holds 3 J; not to be changed."""
    robot = Robot()
    for _ in range(8000):
        tension = GroundCommand(robot.now_s, "tension", (("energy_j", 3.0),), authenticated=True)
        robot.tick(*(tension,) if robot.machine.phase is Phase.READY else ())
        if robot.machine.phase is Phase.HOLD:
            return robot
    raise AssertionError(f"never held: {robot.machine.phase}, {robot.machine.reason}")


class FiringModel(RuleBasedStateMachine):
    """The model: when it was last armed, and whether nothing has been amiss since the spring was loaded.

    It bounds the machine from both sides: where it says that firing is not allowed the magnet stays off; where all
    has been well throughout, a command to fire is obeyed.
    """

    def __init__(self) -> None:
        super().__init__()
        robot = held()
        self.robot = Robot()
        self.robot.__dict__ |= robot.__dict__ | {"silent_since_s": {}}
        self.well, self.slipped = True, False
        self.armed_s: float | None = None
        self.fired_s: float | None = None

    def amiss(self) -> bool:
        robot = self.robot
        old = any(robot.now_s - since_s > OLD_S + 1e-9 for since_s in robot.silent_since_s.values())
        return old or robot.shakes or robot.log_failed or self.slipped or not robot.latched

    def tick(self, *sent: tuple[str, bool]) -> None:
        robot, was_on = self.robot, self.robot.magnet_on
        orders = [GroundCommand(robot.now_s, name, authenticated=signed) for name, signed in sent]
        robot.tick(*orders)
        amiss, allowed = self.amiss(), False
        self.well = self.well and not amiss and not robot.silent_since_s
        for name, signed in sent:
            if name == "abort" or (signed and name in ("de_tension", "stow")):
                self.well, self.armed_s = False, None
            elif name == "arm" and signed and self.armed_s is None and not amiss:
                self.armed_s = robot.now_s
            elif name == "fire" and signed and self.armed_s is not None and not amiss:
                waited_s = robot.now_s - self.armed_s
                allowed = allowed or SOON_S - 1e-9 <= waited_s <= LATE_S + 1e-9
        if self.armed_s is not None and robot.now_s - self.armed_s > LATE_S:
            self.armed_s = None
        if robot.magnet_on and not was_on:
            assert allowed
            assert self.fired_s is None
            self.fired_s, self.armed_s = robot.now_s, None
        clear = self.armed_s is not None and SOON_S + 1e-9 < robot.now_s - self.armed_s < LATE_S - 1e-9
        if allowed and self.well and clear and self.fired_s is None:
            raise AssertionError("a command to fire was not obeyed though all was well")

    @rule(seconds=st.sampled_from([0.005, 0.1, 0.25, 0.3, 1.0, 5.1]))
    def wait(self, seconds: float) -> None:
        for _ in range(round(seconds / PERIOD_S)):
            self.tick()

    @rule(sent=st.lists(st.tuples(st.sampled_from(sorted(dictionary().commands)), st.booleans()), max_size=3))
    def command_anything(self, sent: list[tuple[str, bool]]) -> None:
        self.tick(*((name, signed) for name, signed in sent if name != "set_parameter"))

    @rule(signed=st.booleans())
    def arm(self, signed: bool) -> None:
        self.tick(("arm", signed))

    @rule(signed=st.booleans())
    def fire(self, signed: bool) -> None:
        self.tick(("fire", signed))

    @rule(waited=st.sampled_from([0.1, 0.26, 1.0, 5.2]), signed=st.booleans())
    def fire_after_arming(self, waited: float, signed: bool) -> None:
        self.tick(("arm", True))
        for _ in range(round(waited / PERIOD_S)):
            self.tick()
        self.tick(("fire", signed))

    @rule(what=st.sampled_from([*SENSORS, "shakes", "log_failed", "slip", "lock"]))
    def something_goes_wrong(self, what: str) -> None:
        robot = self.robot
        if what in SENSORS:
            robot.silent_since_s.setdefault(what, robot.now_s)
        elif what == "slip":
            robot.nut_m, self.slipped = robot.nut_m + 1e-3, True
        elif what == "lock":
            robot.latched = False
        else:
            setattr(robot, what, True)
        self.well = False

    @rule(what=st.sampled_from([*SENSORS, "shakes", "log_failed", "slip", "lock"]))
    def fire_though_something_went_wrong_since_arming(self, what: str) -> None:
        self.tick(("arm", True))
        self.wait(0.3)
        self.something_goes_wrong(what)
        self.wait(0.05)  # until a reading that does not come is too old, and no monitor has tripped
        self.tick(("fire", True))

    @rule()
    def all_is_well_again(self) -> None:
        self.robot.silent_since_s.clear()
        self.robot.shakes = self.robot.log_failed = False

    @invariant()
    def the_magnet_is_not_left_on(self) -> None:
        if self.robot.magnet_on:
            assert self.fired_s is not None
            assert self.robot.now_s - self.fired_s < 0.15


MODEL_RUNS = hypothesis_settings(max_examples=40, stateful_step_count=15, deadline=None, derandomize=True)
# What is broken on purpose shows in few steps; many short runs find it sooner than a few long ones.
QUICK = hypothesis_settings(
    MODEL_RUNS, phases=[HypothesisPhase.generate], max_examples=500, stateful_step_count=4
)
FiringModel.TestCase.settings = MODEL_RUNS
TestFiringModel = FiringModel.TestCase


def without_interlocks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(commands, "firing_interlocks", lambda *_: ())


def without_signature(monkeypatch: pytest.MonkeyPatch) -> None:
    refusals = commands.refusals
    monkeypatch.setattr(
        commands, "refusals", lambda entry, *rest: refusals(replace(entry, authenticated=False), *rest)
    )


def without_order(monkeypatch: pytest.MonkeyPatch) -> None:
    """`fire` is obeyed in HOLD, too."""
    entry = dictionary().commands["fire"]
    monkeypatch.setitem(dictionary().commands, "fire", replace(entry, accepted_in=("armed", "hold")))
    ways = {**hop_machine_ways(), Phase.HOLD: hop_machine_ways()[Phase.HOLD] | {Phase.FIRING}}
    monkeypatch.setattr("flight.machine_tick.TRANSITIONS", ways)


def hop_machine_ways() -> dict[Phase, frozenset[Phase]]:
    from flight.states import TRANSITIONS

    return TRANSITIONS


def without_window(monkeypatch: pytest.MonkeyPatch) -> None:
    def fire(tick: object, command: object) -> None:
        tick.go(Phase.FIRING, fire_s=None)  # type: ignore[attr-defined]

    monkeypatch.setitem(commands._COMMANDS, "fire", fire)


BREAKS = (without_interlocks, without_signature, without_order, without_window)


@pytest.mark.parametrize("broken", BREAKS)
def test_the_model_sees_a_machine_that_fires_when_it_must_not(
    broken: Callable[[pytest.MonkeyPatch], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    held()
    broken(monkeypatch)
    with pytest.raises(AssertionError):
        run_state_machine_as_test(FiringModel, settings=QUICK)  # type: ignore[no-untyped-call]


SMALL = Alphabet(
    ages_s=(0.05, 1.0),
    compressions=(0.0, 1.0),
    disturbances=("none", "old"),
    commands=((), ("tension",), ("arm",), ("fire",), ("reset",)),
)


def test_no_reachable_state_has_an_unsafe_output() -> None:
    """A small alphabet; `python -m benchmarks.states` takes the whole one."""
    found = explore(SETTINGS, SMALL)
    assert found.unsafe == {}
    assert found.magnet_on > 0
    assert {Phase.FIRING, Phase.FLIGHT, Phase.ARMED, Phase.SAFE, Phase.DE_TENSION} <= found.phases
    assert found.states > 30


@pytest.mark.parametrize("broken", BREAKS)
def test_the_exploration_sees_a_machine_that_fires_when_it_must_not(
    broken: Callable[[pytest.MonkeyPatch], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    broken(monkeypatch)
    assert explore(SETTINGS, SMALL, until_unsafe=True).unsafe
