"""The explanation that nothing is missing: a stated parameter is far outside its tolerance."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from ground.diagnose.result import Estimate, FindingKind
from sim_hal.plant.expressions import Name, Node, names
from sim_hal.plant.simulate import Plant
from sim_hal.plant.structure import Structure

RELEASE = 10.0
"""How much wider than stated a released tolerance is."""


@dataclass(frozen=True)
class ReleasedParameter:
    """A parameter whose stated tolerance is set aside: `key` its flat name, `equation` where it acts."""

    key: str
    equation: str
    stated: float
    tolerance: float
    unit: str

    physics_id = "parameter_out_of_tolerance"
    kind: FindingKind = "parameter"
    channel: str | None = None
    two_sided = True
    starts = 1
    parameters = 1

    def place(self, plant: Plant) -> tuple[str | None, str]:
        """The equation that it enters."""
        return None, self.equation

    def joined(self, plant: Plant, start: int = 0) -> Plant:
        """The plant with the tolerance widened."""
        return plant.with_values({}, {self.key: RELEASE * self.tolerance})

    def removed(self, plant: Plant) -> Plant:
        """The plant with the tolerance as stated."""
        return plant.with_values({self.key: self.stated}, {self.key: self.tolerance})

    def strengths(self) -> tuple[str, ...]:
        """The parameter itself: what counts is how far it is from what was stated."""
        return (self.key,)

    def estimates(
        self, plant: Plant, values: Mapping[str, float], std: Mapping[str, float]
    ) -> dict[str, Estimate]:
        """The parameter as the fit found it."""
        value = values.get(self.key, self.stated)
        return {self.key: Estimate(value, std.get(self.key, 0.0), self.unit)}

    def statement(self, estimates: Mapping[str, Estimate]) -> str:
        """How far the parameter is from what was stated."""
        found = estimates[self.key]
        away = (found.value - self.stated) / self.tolerance
        return (
            f"The equations are right, but {self.key} is {found.value:.4g} ± {found.std:.1g} {self.unit}, not "
            f"{self.stated:.4g}: {abs(away):.1f} of its stated tolerances off."
        )

    def formula(self, plant: Plant) -> str:
        """Which parameter."""
        return self.key


def released_parameters(plant: Plant, given: Plant) -> Iterator[ReleasedParameter]:
    """Every parameter of `given` with a tolerance, as long as it still stands in `plant`."""
    stated, now = given.flat(), plant.flat()
    for name, parameter in stated.items():
        if parameter.std > 0.0 and now[name].std == parameter.std:
            yield ReleasedParameter(
                name,
                home_of(name.split(".")[-1], plant.structure),
                parameter.value,
                parameter.std,
                parameter.unit,
            )


def home_of(parameter: str, structure: Structure) -> str:
    """The equation that a parameter enters most directly, through the fewest definitions."""
    depths = [
        (depth_of(parameter, formula, structure), equation) for equation, formula in formulas(structure)
    ]
    reached = [(depth, equation) for depth, equation in depths if depth is not None]
    return min(reached, key=lambda pair: pair[0])[1] if reached else "force_balance"


def formulas(structure: Structure) -> Iterator[tuple[str, Node]]:
    """Formulas that belong to an equation of their own, with its name."""
    for name, balance in structure.balances.items():
        if balance.port is not None:
            yield balance.equation, Name(balance.port)
            continue
        for state in balance.per_force:
            if name in structure.rates or len(balance.per_force) == 1:
                yield balance.equation, structure.rates[state]
    for friction in structure.friction:
        equation = structure.balances[friction.balance].equation
        yield equation, friction.forward
        yield equation, friction.backward
    for condition in structure.flags.values():
        yield "latch", condition


def depth_of(parameter: str, formula: Node, structure: Structure) -> int | None:
    """Through how many definitions a formula reaches a parameter; None if it does not."""
    level, depth = {*names(formula)}, 0
    seen: set[str] = set()
    while level:
        if parameter in level:
            return depth
        seen |= level
        inner = [names(structure.definitions[name].value) for name in level if name in structure.definitions]
        level, depth = {name for found in inner for name in found} - seen, depth + 1
    return None
