"""The state machine under random readings and commands: what must never happen, never does.

A shadow keeps, in a few lines, what an observer knows: which commands were accepted in which order.
"""

from __future__ import annotations

import hypothesis.strategies as st
import pytest
from hypothesis import Phase as HypothesisPhase
from hypothesis import settings as hypothesis_settings
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from flight import hop_machine
from flight import settings as flight_settings
from flight.commands import COMMAND_NAMES
from flight.monitors import firing_interlocks, reset_interlocks
from flight.states import SENSORS, TRANSITIONS, Machine, Phase, Snapshot, Step, Target, changed
from flight.tensioning import compression_for_energy_m
from hal.readings import GroundCommand

SETTINGS = flight_settings.load()
PERIOD_S = SETTINGS.tick.period_s
REST = SETTINGS.rig.static_reading_m_s2
SHIFTS = ("compression_m", "specific_force_m_s2", "motor_current_a")
HOP_PHASES = (
    Phase.LATCH_CHECK,
    Phase.TENSIONING,
    Phase.HOLD,
    Phase.ARMED,
    Phase.FIRING,
    Phase.FLIGHT,
    Phase.EVALUATE,
)
RATIO = SETTINGS.rig.travel_per_compression


class HopRules(RuleBasedStateMachine):
    """Drives the machine with a rough robot (nut follows voltage) that can be disturbed at any tick."""

    def __init__(self) -> None:
        super().__init__()
        self.machine = Machine()
        self.step: Step | None = None
        self.now_s = 0.0
        self.nut_m = 0.003
        self.latched = False
        self.silent: set[str] = set()
        self.shifts = dict.fromkeys(SHIFTS, 0.0)
        self.cut = False
        self.noise = 0.001  # 0 when sensors are stuck
        self.opens = True
        self.history: list[Phase] = []

    @initialize(loaded=st.booleans(), opens=st.booleans(), undisturbed_hops=st.integers(0, 2))
    def power_up(self, loaded: bool, opens: bool, undisturbed_hops: int) -> None:
        """Found in any state; often left alone for a while, so that the deep phases are reached."""
        if loaded:
            self.nut_m, self.latched = 0.012, True
        self.was_loaded, self.opens = loaded, opens
        for _ in range(undisturbed_hops):
            self.hop_on(3.0, Phase.EVALUATE)

    def snapshot(self) -> Snapshot:
        compression = max(self.nut_m - 0.001, 0.0) / RATIO if self.latched else 0.0
        self.noise = -self.noise
        force = REST + self.shifts["specific_force_m_s2"] + self.noise
        sampled = {name: -1.0 if name in self.silent else self.now_s for name in SENSORS}
        return Snapshot(
            time_s=self.now_s,
            motor_current_a=self.shifts["motor_current_a"] + self.noise,
            nut_position_m=self.nut_m,
            at_home=self.nut_m <= 0.0,
            latch_closed=self.latched,
            compression_m=compression + self.shifts["compression_m"],
            specific_force_m_s2=force,
            specific_force_low_m_s2=force,
            specific_force_high_m_s2=force,
            sampled_s=sampled,
            unstroked_share=0.6 if self.cut else 0.0,
        )

    def tick(self, *commands: GroundCommand) -> None:
        self.now_s += PERIOD_S
        snap, before = self.snapshot(), self.machine
        self.step = hop_machine.step(before, snap, commands, SETTINGS)
        if commands or self.step.events:
            assert self.step == hop_machine.step(before, snap, commands, SETTINGS)  # pure
        self.machine = self.step.machine
        self.check_transition(before, snap, commands)
        speed = self.machine.voltage_v / SETTINGS.drive.torque_constant_n_m_a
        moved = speed * SETTINGS.drive.travel_per_radian_m * PERIOD_S
        holding = self.machine.phase in (Phase.READY, Phase.HOLD, Phase.ARMED, Phase.FIRING)
        still = holding or (self.machine.phase is Phase.TENSIONING and abs(self.machine.voltage_v) < 1.2)
        self.nut_m = max(self.nut_m + (0.0 if still else moved), -0.001)
        if self.step.outputs.magnet_on and self.opens:
            self.latched = False
        elif self.nut_m <= 0.0:
            self.latched = True

    def check_transition(self, before: Machine, snap: Snapshot, commands: tuple[GroundCommand, ...]) -> None:
        old, new = before.phase, self.machine.phase
        if (
            old is Phase.SAFE and new is not Phase.SAFE
        ):  # only the ground lets it out, and only to start again
            assert any(command.name == "reset" and command.authenticated for command in commands)
            assert not reset_interlocks(self.machine, snap, SETTINGS)
            assert self.machine.loaded or new in (Phase.SELF_TEST, Phase.HOMING, Phase.DE_TENSION)
            self.history.append(Phase.SELF_TEST)
        elif new is not old and new not in TRANSITIONS[old]:
            # A fault may cross two phases in one tick, but only to relax the spring or to stop.
            assert new in (Phase.SAFE, Phase.SAFE_HOLD, Phase.DE_TENSION)
        assert self.step is not None
        faults = [event for event in self.step.events if event.name == "fault"]
        if faults and old is not Phase.SAFE:
            assert new in (Phase.SAFE, Phase.SAFE_HOLD, Phase.DE_TENSION)
            assert self.machine.reason
        if new is Phase.FIRING and old is not Phase.FIRING:
            assert old is Phase.ARMED
            assert any(command.name == "fire" and command.authenticated for command in commands)
            assert not firing_interlocks(self.machine, snap, SETTINGS)
            assert not before.reason
        if new is Phase.ARMED and old is not Phase.ARMED:
            assert old is Phase.HOLD
            assert any(command.name == "arm" and command.authenticated for command in commands)
        if new is not old:
            self.history.append(new)

    @rule(count=st.integers(1, 400))
    def let_time_pass(self, count: int) -> None:
        for _ in range(count):
            self.tick()

    @rule(
        name=st.sampled_from([*COMMAND_NAMES, "launch"]),
        energy_j=st.floats(allow_nan=True),
        signed=st.booleans(),
    )
    def command_anything(self, name: str, energy_j: float, signed: bool) -> None:
        arguments = (("energy_j", energy_j),) if name == "tension" else ()
        self.tick(GroundCommand(self.now_s, name, arguments, authenticated=signed))

    @rule(energy_j=st.floats(1.0, 5.0), until=st.sampled_from(HOP_PHASES))
    def go_on_with_the_hop(self, energy_j: float, until: Phase) -> None:
        self.hop_on(energy_j, until)

    def hop_on(self, energy_j: float, until: Phase) -> None:
        """The commands that a mission gives, so that the deep phases are reached."""
        for _ in range(6000):
            phase, waited = self.machine.phase, self.now_s - self.machine.since_s
            commands: tuple[GroundCommand, ...] = ()
            if phase is Phase.READY:
                commands = (
                    GroundCommand(self.now_s, "tension", (("energy_j", energy_j),), authenticated=True),
                )
            elif phase is Phase.HOLD:
                commands = (GroundCommand(self.now_s, "arm", authenticated=True),)
            elif phase is Phase.ARMED and waited > SETTINGS.timeouts.arm_min_s:
                commands = (GroundCommand(self.now_s, "fire", authenticated=True),)
            self.tick(*commands)
            if phase in (Phase.SAFE, until):
                break

    @rule(
        what=st.sampled_from([*SENSORS, *SHIFTS, "lock", "power", "stick"]),
        shift=st.sampled_from([-5.0, 0.01, 5.0]),
    )
    def something_goes_wrong(self, what: str, shift: float) -> None:
        """A sensor falls silent, sticks or reads off, the lock lets go, or the watchdog may have cut the power."""
        if what == "lock":
            self.latched = False
        elif what in SHIFTS:
            self.shifts[what] = shift
        elif what == "stick":
            self.noise = 0.0
        elif what in SENSORS:
            self.silent.add(what)
        self.cut = what == "power"
        self.tick()
        self.cut = False

    @rule()
    def sensors_return(self) -> None:
        self.silent.clear()
        self.noise = 0.001
        self.shifts = dict.fromkeys(SHIFTS, 0.0)

    @invariant()
    def magnet_is_on_in_firing_only(self) -> None:
        if self.step is not None and self.step.outputs.magnet_on:
            assert self.machine.phase is Phase.FIRING
            assert self.history[-2:] == [Phase.ARMED, Phase.FIRING]

    @invariant()
    def safe_is_named_and_dead(self) -> None:
        if self.machine.phase is Phase.SAFE:
            assert self.machine.reason
            assert self.step is not None
            assert self.step.outputs == self.step.outputs._replace(
                voltage_v=0.0, magnet_on=False, evaluate=False
            )

    @invariant()
    def power_limit_of_the_drive_is_kept(self) -> None:
        if self.step is not None:
            assert abs(self.step.outputs.voltage_v) <= SETTINGS.drive.max_voltage_v

    @invariant()
    def a_spring_loaded_at_power_up_is_relaxed_before_anything_else(self) -> None:
        before_ready = self.history[: self.history.index(Phase.READY)] if Phase.READY in self.history else []
        relaxed = {Phase.DE_TENSION, Phase.HOMING} & set(before_ready)
        if Phase.READY in self.history and self.was_loaded:
            assert relaxed


NO_SHRINK = tuple(phase for phase in HypothesisPhase if phase is not HypothesisPhase.shrink)  # a tick is slow
HopRules.TestCase.settings = hypothesis_settings(
    max_examples=32, stateful_step_count=12, deadline=None, derandomize=True, phases=NO_SHRINK
)
TestHopRules = HopRules.TestCase


def standing(compression_m: float, **changes: object) -> Snapshot:
    snap = Snapshot(
        time_s=100.0,
        nut_position_m=0.001 + compression_m * RATIO,
        latch_closed=True,
        compression_m=compression_m,
        specific_force_m_s2=REST,
        specific_force_low_m_s2=REST,
        specific_force_high_m_s2=REST,
        sampled_s=dict.fromkeys(SENSORS, 100.0),
    )
    return snap._replace(**changes)  # type: ignore[arg-type]


def test_a_changed_state_is_as_by_replace_and_an_unknown_field_is_an_error() -> None:
    machine, snap = Machine(phase=Phase.HOLD, reason="abort"), Snapshot(1.0)
    assert changed(machine, voltage_v=2.0, taut_m=0.1) == machine._replace(voltage_v=2.0, taut_m=0.1)
    assert changed(snap, latch_closed=True) == snap._replace(latch_closed=True)
    assert isinstance(changed(snap), Snapshot)
    with pytest.raises(KeyError, match="speed"):
        changed(machine, speed=1.0)


def test_each_interlock_alone_forbids_firing() -> None:
    s = compression_for_energy_m(15.0, SETTINGS.rig)
    machine = Machine(
        phase=Phase.ARMED,
        since_s=99.0,
        taut_m=0.001,
        target=Target(15.0, s),
        compression_m=s,
        stable_ticks=100,
        position_m=0.001 + s * RATIO,
        last_s=99.995,
        moved_s=99.9,
    )
    good = standing(s)
    assert firing_interlocks(machine, good, SETTINGS) == ()
    old = dict.fromkeys(SENSORS, 100.0) | {"spring": 99.97}
    refused = {
        "latch_open": (machine, good._replace(latch_closed=False)),
        "energy_off_target": (machine._replace(compression_m=s * 1.02), good),
        "not_stable": (machine._replace(stable_ticks=3), good),
        "not_standing_still": (machine, good._replace(specific_force_high_m_s2=REST + 2.0)),
        "spring_old": (machine, good._replace(sampled_s=old)),
        "fault_pending": (machine._replace(reason="stall"), good),
        "no_target": (machine._replace(target=None), good),
    }
    for name, (state, snap) in refused.items():
        assert name in firing_interlocks(state, snap, SETTINGS)
        fired = hop_machine.step(state, snap, (GroundCommand(100.0, "fire", authenticated=True),), SETTINGS)
        assert fired.machine.phase is not Phase.FIRING
        assert not fired.outputs.magnet_on
    fired = hop_machine.step(machine, good, (GroundCommand(100.0, "fire", authenticated=True),), SETTINGS)
    assert fired.machine.phase is Phase.FIRING
    assert fired.outputs.magnet_on


def test_fire_outside_the_window_after_arm_is_refused() -> None:
    s = compression_for_energy_m(15.0, SETTINGS.rig)
    for since_s in (99.9, 100.0 - SETTINGS.timeouts.arm_window_s - 0.1):
        machine = Machine(
            phase=Phase.ARMED,
            since_s=since_s,
            target=Target(15.0, s),
            compression_m=s,
            stable_ticks=100,
            position_m=0.001 + s * RATIO,
            last_s=99.995,
        )
        step = hop_machine.step(
            machine, standing(s), (GroundCommand(100.0, "fire", authenticated=True),), SETTINGS
        )
        assert step.machine.phase is not Phase.FIRING
        assert [event.name for event in step.events].count("command_refused") == 1
