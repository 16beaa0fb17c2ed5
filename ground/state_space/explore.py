"""Explores the product of the hop state machine with its interlocks, exhaustively.

A state is what the machine remembers that is no number: phase, load, trust, reason, target, fire time, positions
known, retries, monitors about to trip. Everything else (times, readings, the nut's rest, how good the latch test
was) is chosen anew at each step from representatives of all cases, so that more can be reached here than on a robot.
From each state the real `step` is taken with every combination of these and of commands, and what it answers is held
to rules that are written from the inputs alone (`rules.py`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from flight import hop_machine
from flight.settings import FlightSettings
from flight.states import Machine, Phase
from ground.state_space.choices import Alphabet, Orders, World, concrete
from ground.state_space.rules import broken_rules

PENDING = frozenset({"over_current", "motor_disobeys"})
"""Monitors that count to two here (not yet, and now); the others trip at once. One that is beyond its limit and has
not tripped is one interlock, whichever it is."""


@dataclass
class Exploration:
    """Counts, and what was found unsafe."""

    states: int = 0
    transitions: int = 0
    magnet_on: int = 0  # transitions with the magnet on; none would prove nothing
    phases: set[Phase] = field(default_factory=set)
    unsafe: dict[str, int] = field(default_factory=dict)
    example: str = ""

    def mark(self, rule: str, machine: Machine, world: World, orders: Orders) -> None:
        """Count something unsafe."""
        self.unsafe[rule] = self.unsafe.get(rule, 0) + 1
        self.example = self.example or f"{rule}: from {machine.phase} with {world} and {orders}"


def explore(
    settings: FlightSettings,
    alphabet: Alphabet | None = None,
    *,
    until_unsafe: bool = False,
    show: Callable[[int, int], None] = lambda done, waiting: None,
) -> Exploration:
    """Take every step from every reachable state; with `until_unsafe`, until something unsafe is found.

    `show` is told, state by state, how many are done and how many wait.
    """
    alphabet = alphabet or Alphabet()
    settings, worlds, all_orders = _quick(settings), tuple(alphabet.worlds()), tuple(alphabet.orders())
    found, seen, waiting = Exploration(), {_key(Machine())}, deque([Machine()])
    while waiting and not (until_unsafe and found.unsafe):
        state = waiting.popleft()
        found.states += 1
        show(found.states, len(waiting))
        found.phases.add(state.phase)
        for world in worlds:
            machine, snap = concrete(state, world, settings)
            observed, dead = hop_machine.observe(machine, snap, settings)  # the same whatever is commanded
            for orders in all_orders:
                step = hop_machine.decide(observed, dead, snap, orders.commands, settings)
                found.transitions += 1
                found.magnet_on += step.outputs.magnet_on
                for rule in broken_rules(machine, world, orders, step, settings):
                    found.mark(rule, machine, world, orders)
                if (key := _key(step.machine)) not in seen:
                    seen.add(key)
                    waiting.append(step.machine)
    return found


def _quick(settings: FlightSettings) -> FlightSettings:
    """All persistences as short as can be, so that no state hides behind a long count."""
    monitors = {
        name: replace(rule, for_ticks=2 if name in PENDING else 1) for name, rule in settings.monitors.items()
    }
    return replace(settings, monitors=monitors)


def _key(machine: Machine) -> tuple[object, ...]:
    return (
        machine.phase,
        machine.loaded,
        machine.drive_trusted,
        machine.reason == "",
        machine.reason == "stowed",
        machine.target is not None,
        machine.fire_s is not None,
        machine.home_m is not None,
        machine.taut_m is not None,
        machine.retries,
        PENDING.intersection(machine.beyond_ticks),
    )
