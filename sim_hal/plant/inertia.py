"""Added inertia: what it does to a plant's rates, also where it resists a motion of two parts against each other.

An inertia m that resists the rate a of a velocity w·x (x the states) is a force −m a in its balance. With per_force g
the rates are r = r₀ − m g (w·r), hence r = r₀ − g m (w·r₀)/(1 + m w·g): Sherman and Morrison, Ann. Math. Stat. 21
(1950) 124. Several inertias follow one another, each on the plant that the ones before have made heavier.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from sim_hal.plant.expressions import ExpressionError, Name, Node, Num, Op, add, linear_in, multiply, rename
from sim_hal.plant.structure import Balance, PlantError, Structure

Vector = Mapping[str, Node]
Correction = Callable[[Vector], dict[str, Node]]
"""Rates, or what a force adds to them, by state → the same with the added inertia."""


def heavier(
    inertias: Sequence[tuple[Balance, Node]], definitions: Mapping[str, Node], structure: Structure
) -> Correction:
    """The correction by inertias in balances; nothing at all where they are 0. Raises `PlantError`."""
    steps: list[Correction] = []

    def corrected(vector: Vector) -> dict[str, Node]:
        found = dict(vector)
        for step in steps:
            found = step(found)
        return found

    for balance, inertia in inertias:
        steps.append(_step(corrected(balance.per_force), _velocity(balance, definitions, structure), inertia))
    return corrected


def _step(per_force: Vector, velocity: Vector, inertia: Node) -> Correction:
    """One inertia; where it moves with a single state, what is left is a division."""
    if per_force.keys() == velocity.keys() and list(velocity.values()) == [Num(1.0)]:
        state, own = next(iter(per_force.items()))
        divisor = add(Num(1.0), multiply(inertia, own))
        return lambda vector: {
            name: Op("/", (node, divisor)) if name == state else node for name, node in vector.items()
        }
    share = Op("/", (inertia, add(Num(1.0), multiply(inertia, _dot(velocity, per_force)))))

    def step(vector: Vector) -> dict[str, Node]:
        force = multiply(share, _dot(velocity, vector))
        states = dict.fromkeys((*vector, *per_force))
        taken = {name: multiply(node, force) for name, node in per_force.items()}
        return {
            name: Op("-", (vector.get(name, Num(0.0)), taken[name])) if name in taken else vector[name]
            for name in states
        }

    return step


def _dot(velocity: Vector, vector: Vector) -> Node:
    parts = [multiply(node, vector[name]) for name, node in velocity.items() if name in vector]
    return add(*parts)


def _velocity(balance: Balance, definitions: Mapping[str, Node], structure: Structure) -> dict[str, Node]:
    """Coefficients of a balance's velocity, by state."""

    def open_up(name: str) -> Node:
        found = definitions.get(name)
        return Name(name) if found is None else rename(found, open_up)

    if balance.velocity is None:
        raise PlantError(f"balance {balance.name}: added inertia needs a velocity")
    try:
        return linear_in(rename(balance.velocity, open_up), frozenset(structure.states))[0]
    except ExpressionError as error:
        raise PlantError(f"balance {balance.name}: velocity: {error}") from None
