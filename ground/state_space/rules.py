"""The rules that each step is held to, written from world and commands alone."""

from __future__ import annotations

from collections.abc import Iterator

from flight.settings import FlightSettings
from flight.states import Machine, Outputs, Phase, Step
from flight.tensioning import compression_for_energy_m, hold_voltage_v
from ground.state_space.choices import WANTED_J, Orders, World


def broken_rules(
    before: Machine, world: World, orders: Orders, step: Step, settings: FlightSettings
) -> Iterator[str]:
    """The names of the rules that a step breaks."""
    yield from _broken_by_magnet(before, world, orders, step)
    yield from _broken_by_drive(before, world, orders, step, settings)


def _broken_by_magnet(before: Machine, world: World, orders: Orders, step: Step) -> Iterator[str]:
    after, outputs = step.machine, step.outputs
    may_fire = (
        before.phase is Phase.ARMED
        and orders.signed
        and "fire" in orders.names  # whatever else is ordered in that tick: the arming came before it
        and world.age_s == 1.0
        and world.settled
        and world.latched
        and world.compression == 1.0
        and world.still
        and world.disturbance == "none"
        and before.target is not None
        and before.reason == ""
        and before.drive_trusted
    )
    if outputs.magnet_on and not (may_fire or before.phase is Phase.FIRING):
        yield "magnet_on_without_leave"
    if outputs.magnet_on and after.phase is not Phase.FIRING:
        yield "magnet_on_outside_firing"
    if after.phase is Phase.FIRING and not (may_fire or before.phase is Phase.FIRING):
        yield "firing_without_leave"
    may_arm = before.phase is Phase.HOLD and orders.signed and "arm" in orders.names
    if after.phase is Phase.ARMED and not (may_arm or before.phase is Phase.ARMED):
        yield "armed_without_command"


def _broken_by_drive(
    before: Machine, world: World, orders: Orders, step: Step, settings: FlightSettings
) -> Iterator[str]:
    after, outputs = step.machine, step.outputs
    if after.phase is Phase.SAFE and outputs != Outputs():
        yield "output_in_safe"
    if before.phase is Phase.SAFE and after.phase is not Phase.SAFE:
        allowed = "reset" in orders.names and orders.signed and before.drive_trusted and world.settled
        if not (allowed and world.disturbance in ("none", "old") and after.loaded):
            yield "left_safe_without_leave"
    if not before.drive_trusted and (after.drive_trusted or outputs.voltage_v != 0.0):
        yield "untrusted_drive_used"
    stored_m = world.compression * compression_for_energy_m(WANTED_J, settings.rig)
    # A motor that was running is slowed down over some ticks; nothing may pull more than that leaves of its voltage.
    falling_v = before.voltage_v - settings.drive.voltage_slew_v_s * settings.tick.period_s
    pulls = outputs.voltage_v > max(hold_voltage_v(stored_m, settings), falling_v) + 1e-6
    if pulls and after.phase not in (Phase.TENSIONING, Phase.LATCH_CHECK):
        yield "tensioned_unasked"
    may_tension = before.phase is Phase.READY and "tension" in orders.names and orders.signed
    if after.phase is Phase.TENSIONING and not (may_tension or before.phase is Phase.TENSIONING):
        yield "tensioning_without_command"
