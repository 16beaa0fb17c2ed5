"""The hop state machine: a pure function from (machine, snapshot, commands) to (machine, outputs, events).

It holds no clock, no device and no randomness. The magnet is on in FIRING and nowhere else; FIRING is entered
only from ARMED by a `fire` command that every interlock lets pass; any fault leads to SAFE with its name, as the
fault table says: by way of DE_TENSION or SAFE_HOLD when the spring is loaded and the drive can be trusted.
"""

from __future__ import annotations

from collections.abc import Sequence

from flight import tensioning
from flight.commands import obey
from flight.machine_tick import Tick
from flight.monitors import find_fault, watch
from flight.phases import ACTIONS
from flight.settings import DriveSettings, FlightSettings
from flight.states import Machine, Outputs, Phase, Sameness, Snapshot, Step, changed, with_observed
from hal.readings import GroundCommand


def step(
    machine: Machine, snap: Snapshot, commands: Sequence[GroundCommand], settings: FlightSettings
) -> Step:
    """One tick: observe, look for faults, obey commands, act by phase. Pure."""
    return decide(*observe(machine, snap, settings), snap, commands, settings)


def observe(machine: Machine, snap: Snapshot, settings: FlightSettings) -> tuple[Machine, tuple[str, ...]]:
    """First half of a tick: the machine with what the readings tell, and the names of dead monitors."""
    return watch(_observe(machine, snap, settings), snap, settings)


def decide(
    observed: Machine,
    dead: tuple[str, ...],
    snap: Snapshot,
    commands: Sequence[GroundCommand],
    settings: FlightSettings,
) -> Step:
    """Second half of a tick: answer faults, obey commands, act by phase."""
    tick = Tick(observed, snap, settings, dead)
    fault = None if observed.phase is Phase.SAFE else find_fault(observed, dead, settings)
    if fault is not None:
        tick.fail(fault)
    for command in commands:
        obey(tick, command)
    outputs = ACTIONS[tick.machine.phase](tick)
    # An action may have changed the phase: what the new phase forbids must not last until the next tick.
    if outputs.magnet_on and tick.machine.phase is not Phase.FIRING:
        outputs = outputs._replace(magnet_on=False)
    if tick.machine.phase is Phase.SAFE:
        outputs = Outputs()
    after = tick.machine
    if outputs.voltage_v != after.voltage_v:
        after = changed(after, voltage_v=outputs.voltage_v)
    return Step(after, outputs, tuple(tick.events), monitors_alive=not dead)


def _observe(machine: Machine, snap: Snapshot, settings: FlightSettings) -> Machine:
    """Update what is estimated from the readings: speed, compression, load, and the monitors' counters."""
    safety, first = settings.safety, machine.last_s is None
    elapsed_s = settings.tick.period_s if machine.last_s is None else snap.time_s - machine.last_s
    travel_m = 0.0 if machine.position_m is None else snap.nut_position_m - machine.position_m
    speed_m_s = travel_m / elapsed_s if elapsed_s > 0.0 else 0.0
    followed = abs(speed_m_s) >= safety.stall_speed_m_s
    steady = abs(speed_m_s) < safety.stable_speed_m_s
    drawn_a = max(snap.motor_current_a, 0.0)
    smoothing = settings.drive.current_smoothing
    values = (  # in the order of `OBSERVED`
        *_load(machine, snap, travel_m, settings),
        *_sameness(machine, snap, running=followed),
        snap.nut_position_m,
        snap.time_s,
        speed_m_s,
        snap.time_s if followed or first else machine.moved_s,
        machine.stable_ticks + 1 if steady else 0,
        None if first else elapsed_s,
        machine.failed_reads * (1.0 - 1.0 / safety.error_memory_ticks) + snap.failed_reads,
        _winding_rise_k(machine, snap, elapsed_s, settings.drive),
        snap.time_s if snap.ground_heard else machine.heard_s,
        machine.mean_current_a + smoothing * (drawn_a - machine.mean_current_a),
    )
    return with_observed(machine, values)


_NOT_SAME = Sameness()


def _sameness(machine: Machine, snap: Snapshot, running: bool) -> tuple[Sameness, Sameness]:
    """Whether readings that cannot stay the same do: the current of a running motor, a noisy accelerometer."""
    current = force = _NOT_SAME
    sampled_s = snap.sampled_s
    if running and "motor_current" in sampled_s:
        current = machine.same_current.after(snap.motor_current_a, sampled_s["motor_current"])
    if snap.specific_force_low_m_s2 == snap.specific_force_high_m_s2 and "accelerometer" in sampled_s:
        force = machine.same_force.after(snap.specific_force_m_s2, sampled_s["accelerometer"])
    return current, force


def _winding_rise_k(machine: Machine, snap: Snapshot, elapsed_s: float, drive: DriveSettings) -> float:
    """Winding above its surroundings: one thermal mass, heated by R i², cooled through one resistance."""
    heat_k = drive.winding_resistance_k_w * drive.resistance_ohm * snap.motor_current_a**2
    share = min(1.0, max(0.0, elapsed_s) / drive.winding_time_constant_s)
    return machine.winding_rise_k + share * (heat_k - machine.winding_rise_k)


def _load(
    machine: Machine, snap: Snapshot, travel_m: float, settings: FlightSettings
) -> tuple[float, int, bool]:
    """Compression of the spring, ticks for which it was seen to hold nothing, and whether it counts as loaded.

    It does until, with the nut at home, the spring sensor has shown for some ticks that nothing is stored.
    """
    safety = settings.safety
    fresh = snap.age_s("spring") <= safety.sensor_age_s
    taut = machine.compression_m > safety.unloaded_compression_m
    if machine.last_s is None:
        compression_m = snap.compression_m
    else:
        compression_m = tensioning.fused_compression_m(
            machine.compression_m, snap.compression_m if fresh else None, travel_m, taut, settings
        )
    relaxed = fresh and snap.at_home and abs(snap.compression_m) < safety.unloaded_compression_m
    unloaded_ticks = machine.unloaded_ticks + 1 if relaxed else 0
    above = compression_m > safety.unloaded_compression_m and snap.latch_closed
    return compression_m, unloaded_ticks, above or (machine.loaded and unloaded_ticks < safety.stable_ticks)
