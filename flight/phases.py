"""What each phase of the hop does in one tick."""

from __future__ import annotations

from collections.abc import Callable

from flight import tensioning
from flight.machine_tick import Tick
from flight.monitors import Fault, self_test_failures
from flight.states import LineFit, Outputs, Phase, changed


def _power_up(tick: Tick) -> Outputs:
    tick.go(Phase.SELF_TEST)
    return Outputs()


def _self_test(tick: Tick) -> Outputs:
    failures = self_test_failures(tick.snap, tick.settings)
    if failures:
        if tick.in_phase_s > tick.settings.timeouts.self_test_s:
            tick.fail(Fault("self_test_failed", f"self_test_{failures[0]}"))
    elif tick.machine.compression_m > tick.settings.safety.unloaded_compression_m:
        tick.say("loaded_at_power_up", compression_m=tick.machine.compression_m)
        tick.go(Phase.DE_TENSION)
    else:
        tick.go(Phase.HOMING)
    return Outputs()


def _homing(tick: Tick) -> Outputs:
    if not tick.snap.at_home:
        return Outputs(tick.drive(tick.homeward_m_s()))
    tick.machine = changed(tick.machine, moved_s=tick.snap.time_s)  # at rest on purpose: no stall
    if not tick.machine.loaded:
        tick.go(Phase.LATCH_CHECK, home_m=tick.snap.nut_position_m, taut_m=None, latch_line=LineFit())
    return Outputs(tick.stop())


def _latch_check(tick: Tick) -> Outputs:
    """Drive up a little: the spring must follow the nut, or the lock does not hold the string."""
    machine, snap, safety = tick.machine, tick.snap, tick.settings.safety
    if not snap.latch_closed:  # it snaps in when the nut comes home; give it until the phase's timeout
        tick.machine = changed(machine, moved_s=snap.time_s)
        return Outputs(tick.stop())
    travel_m = snap.nut_position_m - (machine.home_m or 0.0)
    if machine.compression_m < safety.latch_check_start_m:
        if travel_m > safety.max_slack_m:
            tick.fail(Fault("latch_does_not_hold"))
        return Outputs(tick.drive(tick.settings.drive.latch_check_speed_m_s))
    line = machine.latch_line.add(travel_m, snap.compression_m)
    tick.machine = changed(machine, latch_line=line)
    if machine.compression_m < safety.latch_check_compression_m:
        if travel_m > safety.max_slack_m + safety.latch_check_compression_m * 2.0:
            tick.fail(Fault("latch_does_not_hold"))
        return Outputs(tick.drive(tick.settings.drive.latch_check_speed_m_s))
    return _judge_latch(tick, line)


def _judge_latch(tick: Tick, line: LineFit) -> Outputs:
    expected = 1.0 / tick.settings.rig.travel_per_compression
    if abs(line.slope / expected - 1.0) > tick.settings.safety.latch_check_slope_tolerance:
        tick.say("latch_slope", slope=line.slope, expected=expected)
        tick.fail(Fault("latch_does_not_hold"))
        return Outputs()
    taut_m = (tick.machine.home_m or 0.0) + line.crossing(expected)
    tick.say("string_taut_found", position_m=taut_m, slope=line.slope)
    tick.go(Phase.READY, taut_m=taut_m, retries=0)
    return Outputs(tick.hold())


def _ready(tick: Tick) -> Outputs:
    return Outputs(tick.hold())


def _tensioning(tick: Tick) -> Outputs:
    machine, settings = tick.machine, tick.settings
    assert machine.target is not None
    wanted_m = machine.target.compression_m
    remaining_m = (wanted_m - machine.compression_m) * settings.rig.travel_per_compression
    # A tenth of the tolerance is where it stops: energy goes with compression squared at most.
    if remaining_m > 0.1 * settings.tension.tolerance * wanted_m:
        speed_m_s = tensioning.approach_speed_m_s(remaining_m, settings.drive)
        return Outputs(tick.drive(speed_m_s))
    tick.machine = changed(tick.machine, moved_s=tick.snap.time_s)  # at rest on purpose: no stall
    settled = machine.stable_ticks * settings.tick.period_s >= settings.tension.settle_s
    if settled:
        _enter_hold(tick)
    return Outputs(tick.hold())


def _enter_hold(tick: Tick) -> None:
    target = tick.machine.target
    assert target is not None
    stored_j = tensioning.energy_used_j(tick.machine.compression_m, tick.settings.rig)
    if stored_j > target.energy_used_j * (1.0 + tick.settings.tension.tolerance):
        tick.fail(Fault("tension_overshoot"))
        return
    tick.say("tension_reached", energy_used_j=stored_j, compression_m=tick.machine.compression_m)
    tick.go(Phase.HOLD)


def _hold(tick: Tick) -> Outputs:
    return Outputs(tick.hold())


def _armed(tick: Tick) -> Outputs:
    if tick.in_phase_s > tick.settings.timeouts.arm_window_s:
        tick.say("arm_expired")
        tick.go(Phase.HOLD)
    return Outputs(tick.hold(), spring_hop_rate=True)


def _firing(tick: Tick) -> Outputs:
    """Magnet on until the spring has let go, or the time for it is over."""
    machine, snap = tick.machine, tick.snap
    assert machine.target is not None
    if machine.fire_s is None:
        tick.machine = machine._replace(fire_s=snap.time_s)
        return Outputs(tick.hold(), magnet_on=True, spring_hop_rate=True)
    if snap.compression_m < 0.5 * machine.target.compression_m:
        tick.say("released", compression_m=snap.compression_m)
        tick.go(Phase.FLIGHT, loaded=False, quiet_s=None)
        return Outputs(spring_hop_rate=True)
    return Outputs(tick.hold(), magnet_on=True, spring_hop_rate=True)


def _flight(tick: Tick) -> Outputs:
    """Wait until the robot stands still again. When it touched down is for the evaluation to say."""
    snap, settings = tick.snap, tick.settings
    rest_m_s2, allowed = settings.rig.static_reading_m_s2, settings.safety.standing_tolerance_m_s2
    still = (
        abs(snap.specific_force_high_m_s2 - rest_m_s2) < allowed
        and abs(snap.specific_force_low_m_s2 - rest_m_s2) < allowed
        and tick.in_phase_s > settings.timeouts.flight_min_s
    )
    quiet_s = tick.machine.quiet_s if tick.machine.quiet_s is not None else snap.time_s
    tick.machine = changed(tick.machine, quiet_s=quiet_s if still else None)
    if still and snap.time_s - quiet_s > settings.timeouts.landing_quiet_s:
        tick.go(Phase.LANDED)
    return Outputs(spring_hop_rate=True)


def _landed(tick: Tick) -> Outputs:
    if abs(tick.snap.compression_m) > tick.settings.safety.unloaded_compression_m:
        tick.machine = tick.machine._replace(loaded=True)
        tick.fail(Fault("spring_not_relaxed_by_hop"))
        return Outputs()
    tick.go(Phase.EVALUATE)
    return Outputs(evaluate=True)


def _evaluate(tick: Tick) -> Outputs:
    tick.go(Phase.HOMING, hop_index=tick.machine.hop_index + 1, target=None, fire_s=None, taut_m=None)
    return Outputs()


def _de_tension(tick: Tick) -> Outputs:
    """Drive the nut home at a controlled speed; the home switch, not a guess, says when it is done.

    A switch that is closed while the spring shows a load is not believed, unless the encoder agrees with it.
    """
    machine, snap, safety = tick.machine, tick.snap, tick.settings.safety
    loaded_m = 2.0 * safety.unloaded_compression_m
    by_encoder = machine.home_m is not None and snap.nut_position_m - machine.home_m < safety.home_agreement_m
    if not snap.at_home or (snap.compression_m > loaded_m and not by_encoder):
        return Outputs(tick.drive(tick.homeward_m_s()))
    tick.machine = machine = changed(machine, moved_s=snap.time_s)
    spring_known = snap.age_s("spring") <= safety.sensor_age_s
    if not machine.loaded:
        if machine.reason:
            tick.go(Phase.SAFE)
        else:
            fresh = LineFit()
            tick.go(Phase.LATCH_CHECK, home_m=snap.nut_position_m, taut_m=None, target=None, latch_line=fresh)
    elif not spring_known:
        tick.say("spring_state_unknown")
        tick.go(Phase.SAFE, reason=machine.reason_after("spring_state_unknown"))
    elif snap.compression_m > loaded_m:
        tick.go(Phase.SAFE, reason=machine.reason_after("spring_loaded_at_home"))
    return Outputs(tick.stop())


def _safe_hold(tick: Tick) -> Outputs:
    """Keep the nut where it is until the ground says what to do, or the time for it is over."""
    return Outputs(tick.hold())


def _safe(tick: Tick) -> Outputs:
    return Outputs()


ACTIONS: dict[Phase, Callable[[Tick], Outputs]] = {
    Phase.POWER_UP: _power_up,
    Phase.SELF_TEST: _self_test,
    Phase.HOMING: _homing,
    Phase.LATCH_CHECK: _latch_check,
    Phase.READY: _ready,
    Phase.TENSIONING: _tensioning,
    Phase.HOLD: _hold,
    Phase.ARMED: _armed,
    Phase.FIRING: _firing,
    Phase.FLIGHT: _flight,
    Phase.LANDED: _landed,
    Phase.EVALUATE: _evaluate,
    Phase.DE_TENSION: _de_tension,
    Phase.SAFE_HOLD: _safe_hold,
    Phase.SAFE: _safe,
}
