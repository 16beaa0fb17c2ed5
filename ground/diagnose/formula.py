"""A formula for a force that no name fits: few terms in speed, position, load and time, by sparse regression.

The best few of a library of monomials on the smoothed force, each value weighed by its sigma, by how they predict
stretches of the recording that they were not fitted to. Every coefficient carries the unit that makes its term a
force.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ground.diagnose.candidates import EffectCandidate
from ground.diagnose.evidence import LocatedForce
from sim_hal.plant.compose import place_units
from sim_hal.plant.effects.unlisted import PHYSICS_ID
from sim_hal.plant.plant import check_use, effect_of
from sim_hal.plant.simulate import EffectUse, Parameter, Plant

Float = NDArray[np.float64]

Term = Callable[[Mapping[str, Float]], Float]
LIBRARY: Mapping[str, tuple[str, Term]] = {
    "1": ("force", lambda q: np.ones_like(q["elapsed"])),
    "v": ("force/velocity", lambda q: q["v"]),
    "v * abs(v)": ("force/velocity**2", lambda q: q["v"] * np.abs(q["v"])),
    "v ** 3": ("force/velocity**3", lambda q: q["v"] ** 3),
    "x": ("force/position", lambda q: q["x"]),
    "x ** 2": ("force/position**2", lambda q: q["x"] ** 2),
    "x ** 3": ("force/position**3", lambda q: q["x"] ** 3),
    "x * v": ("force/position/velocity", lambda q: q["x"] * q["v"]),
    "x ** 2 * v": ("force/position**2/velocity", lambda q: q["x"] ** 2 * q["v"]),
    "elapsed": ("force/s", lambda q: q["elapsed"]),
    "elapsed * v": ("force/s/velocity", lambda q: q["elapsed"] * q["v"]),
}
"""Terms that are tried, as plant files write them, with the unit of their coefficient."""
MOST_TERMS = 3
ENOUGH = 0.5
"""Share of the force's variance that the formula must predict where it was not fitted."""
GAINS = 0.03
"""Further share that a further term must bring."""


@dataclass(frozen=True)
class Law:
    """Terms with their coefficients in SI units; `explained` is their share where they were not fitted."""

    terms: tuple[str, ...]
    coefficients: Float
    explained: float

    def without(self, number: int) -> Law:
        """The formula without one of its terms."""
        kept = [place for place in range(len(self.terms)) if place != number]
        return replace(self, terms=tuple(self.terms[k] for k in kept), coefficients=self.coefficients[kept])


def sparse_law(force: LocatedForce) -> Law | None:
    """The formula with the fewest terms that predicts the force; None when none predicts half of it.

    All combinations are tried: two terms may describe together what neither does alone, one of them what the plant's
    own parameters have taken too much of.
    """
    columns = library(force)
    chosen: tuple[str, ...] = ()
    share = 0.0
    for count in range(1, MOST_TERMS + 1):
        tried = {terms: predicted_share(force, columns, terms) for terms in combinations(columns, count)}
        best = max(tried, key=lambda terms: tried[terms], default=())
        if best and tried[best] >= share + GAINS:
            chosen, share = best, tried[best]
    if share < ENOUGH:
        return None
    return Law(chosen, fitted(force, columns, chosen, np.ones(force.before.size, dtype=bool)), share)


def library(force: LocatedForce) -> dict[str, Float]:
    """The terms that this place has the quantities for, along the recording."""
    have = {"elapsed": force.times_s - (force.times_s[0] if force.began_s is None else force.began_s)}
    for symbol, cause in (("v", "velocity"), ("x", "position")):
        if cause in force.causes:
            have[symbol] = force.causes[cause]
    found = {}
    for text, (_, term) in LIBRARY.items():
        if ("v" in text and "v" not in have) or ("x" in text and "x" not in have):
            continue
        found[text] = term(have)
    return found


def fitted(
    force: LocatedForce, columns: Mapping[str, Float], terms: tuple[str, ...], use: NDArray[np.bool_]
) -> Float:
    """Weighted least-squares coefficients of the terms on the samples in use."""
    weight = 1.0 / force.before_std[use]
    matrix = np.column_stack([columns[term][use] for term in terms]) * weight[:, None]
    return np.asarray(np.linalg.lstsq(matrix, force.before[use] * weight, rcond=None)[0])


def predicted_share(force: LocatedForce, columns: Mapping[str, Float], terms: tuple[str, ...]) -> float:
    """Share of the force's weighted power that the terms predict on the stretches (alternate fifths) left out."""
    fold = np.arange(force.before.size) * 5 // force.before.size
    left = 0.0
    for held in range(5):
        coefficients = fitted(force, columns, terms, fold != held)
        test = fold == held
        guess = np.column_stack([columns[term][test] for term in terms]) @ coefficients
        left += float(np.sum(((force.before[test] - guess) / force.before_std[test]) ** 2))
    total = float(np.sum((force.before / force.before_std) ** 2))
    return 1.0 - left / total if total > 0.0 and math.isfinite(left) else 0.0


def formula_candidate(plant: Plant, equation: str, law: Law) -> EffectCandidate:
    """A formula in one of the plant's equations, as an explanation that competes like any other."""
    names = [f"a_{number}" for number in range(1, len(law.terms) + 1)]
    text = " + ".join(
        name if term == "1" else f"{name} * {term}" for name, term in zip(names, law.terms, strict=True)
    )
    raw = {
        name: Parameter(float(value), math.inf, LIBRARY[term][0])
        for name, value, term in zip(names, law.coefficients, law.terms, strict=True)
    }
    draft = EffectUse(PHYSICS_ID, equation, None, raw, text)
    units = place_units(plant, draft, check_use(plant, draft))
    parameters = {name: Parameter(p.value, p.std, units[name]) for name, p in raw.items()}
    use = EffectUse(PHYSICS_ID, equation, None, parameters, text)
    return EffectCandidate(effect_of(plant, use), plant.prefix(use), (use,), tuple(names), two_sided=True)
