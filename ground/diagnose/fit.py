"""Maximum a posteriori fit of a plant to recordings, by output error: Gauss-Newton on simulated sensitivities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ground.diagnose.gauss_newton import Columns, Least, minimise
from ground.diagnose.problem import PRECISE_TOLERANCE, FitProblem, Free, Ranges, head_of
from ground.diagnose.segments import Segment
from sim_hal.plant.simulate import Plant

Float = NDArray[np.float64]

MUCH_WORSE = 2.0
"""Residuals this many times larger under the finer integration mean that it did not get through."""
AGAIN = 2
WELL_WORTH = 0.9
"""Segments left behind start anew at most so often, and while that takes the sum of squares below this share."""
LEAST_INFORMATION = 1e-12
"""Smallest eigenvalue of a scaled information matrix that counts as known."""


@dataclass(frozen=True)
class Fit:
    """A fitted plant. `free` says what the scaled unknowns `z` are.

    `residuals` (standardised) and `jacobian` are those of all segments, stacked; a rough fit's Jacobian may be that
    of a point nearby.
    """

    plant: Plant
    free: tuple[Free, ...]
    values: dict[str, float]
    std: dict[str, float]
    z: Float
    residuals: Float
    jacobian: Float
    initial: tuple[dict[str, float], ...]

    @property
    def chi2(self) -> float:
        """Sum of squared standardised residuals, without the priors."""
        return float(self.residuals @ self.residuals)

    @property
    def prior(self) -> Float:
        """Weight of each unknown's prior, (unknowns,): 1 with a tolerance, 0 without."""
        return np.array([1.0 if free.prior else 0.0 for free in self.free])

    @property
    def cost(self) -> float:
        """What the fit minimised: chi-square and the squared departures from the tolerances' centres."""
        return self.chi2 + self.departure

    @property
    def departure(self) -> float:
        """Squared departures from the tolerances' centres, in tolerances, summed."""
        return float(self.prior @ self.z**2)

    @property
    def held(self) -> NDArray[np.bool_]:
        """Unknowns that their limits hold, (unknowns,)."""
        low, high = bounds_of(self.free)
        slope = self.jacobian.T @ self.residuals + self.prior * self.z
        return ((self.z <= low) & (slope > 0.0)) | ((self.z >= high) & (slope < 0.0))

    def covariance_of(self, names: Sequence[str], segments: Sequence[Segment]) -> Float:
        """Covariance of named parameters, (names, names)."""
        at = [next(i for i, free in enumerate(self.free) if free.name == name) for name in names]
        scale = np.array([self.free[i].scale for i in at])
        whole = robust_covariance(self.jacobian, self.residuals, self.prior, segments)
        return np.asarray(whole[np.ix_(at, at)] * np.outer(scale, scale))

    def std_given(self, known: Sequence[str], segments: Sequence[Segment]) -> dict[str, float]:
        """Sigma of each other named parameter, were those named in `known` known."""
        left = [i for i, free in enumerate(self.free) if free.name not in known]
        covariance = robust_covariance(self.jacobian[:, left], self.residuals, self.prior[left], segments)
        sigma = np.sqrt(np.diag(covariance))
        return {self.free[i].name: float(self.free[i].scale * s) for i, s in zip(left, sigma, strict=True)}


def bounds_of(free: Sequence[Free]) -> tuple[Float, Float]:
    """Scaled lower and upper limits, (unknowns,) each."""
    low, high = np.array([one.bounds() for one in free]).reshape(-1, 2).T
    return low, high


def fit_plant(
    plant: Plant,
    segments: Sequence[Segment],
    sigmas: Float,
    ranges: Ranges,
    known: Mapping[str, float] | None = None,
    *,
    tolerance: float = 1e-4,
    iterations: int = 25,
    precise: bool = False,
    approach: Sequence[float] = (),
    near: Fit | None = None,
    rough: bool = False,
) -> Fit:
    """Fit `plant` to all segments together; `known` are values to start from.

    `tolerance` is the relative gain in chi-square below which the fit is done. Parameter sigmas are
    cluster-robust (see `robust_covariance`); those of a `precise` fit may be believed also where parameters are
    told apart by their tolerances alone. `approach` gives shares of each segment that are fitted first, each fit
    the start of the next: what comes early is told by few parameters, and what follows is then nearly right, where
    a fit of the whole at once may end in a false minimum. A fit `near` by (on the same segments) lends its unknowns
    and, to a built-in kind with its many unknowns, sensitivities; a `rough` one stops where these no longer bring
    progress. Rigs given as equations have few unknowns and often stick: their own sensitivities cost little, and
    borrowed ones lead astray.
    """
    problem = FitProblem(plant, segments, sigmas, ranges)
    prior = np.array([1.0 if free.prior else 0.0 for free in problem.free])
    rows = sum(segment.observed.size for segment in segments)
    start = dict(known or {})
    for share in approach:
        heads = [head_of(segment, share) for segment in segments]
        start = fit_plant(
            plant, heads, sigmas, ranges, start, tolerance=tolerance, iterations=iterations
        ).values
    z = problem.start((near.values if near else {}) | start, near.initial if near else ())
    borrows = near is not None and plant.kind != "equations"  # few unknowns there, and friction that sticks
    inherited, own = lent(near, problem.free, prior) if near and borrows else (None, None)
    least = least_of(
        problem, z, tolerance=tolerance, iterations=iterations, inherited=inherited, own=own, rough=rough
    )
    z, residuals, jacobian = least.z, least.residuals[:rows], least.jacobian[:rows]
    if precise:
        exact = FitProblem(plant, segments, sigmas, ranges, tolerance=PRECISE_TOLERANCE)
        closer = exact.residuals(z)
        if float(closer @ closer) <= MUCH_WORSE * float(residuals @ residuals) + rows:  # it got through
            residuals, jacobian = closer, exact.sure_of_weak(z, exact.precise_sensitivities(z))
    sigma = np.sqrt(np.diag(robust_covariance(jacobian, residuals, prior, problem.segments)))
    named = [i for i, free in enumerate(problem.free) if free.segment is None]
    return Fit(
        plant=problem.plant,
        free=tuple(problem.free),
        values={
            problem.free[i].name: float(problem.free[i].centre + problem.free[i].scale * z[i]) for i in named
        },
        std={problem.free[i].name: float(problem.free[i].scale * sigma[i]) for i in named},
        z=z,
        residuals=residuals,
        jacobian=jacobian,
        initial=tuple(problem.initial(z, number) for number in range(len(problem.segments))),
    )


def least_of(
    problem: FitProblem,
    z: Float,
    *,
    tolerance: float,
    iterations: int,
    inherited: Float | None = None,
    own: Columns | None = None,
    rough: bool = False,
) -> Least:
    """The least squares of a problem with its priors, from unknowns `z`; segments left behind start once more."""
    prior = np.array([1.0 if free.prior else 0.0 for free in problem.free])
    rows = sum(segment.observed.size for segment in problem.segments)

    def cost(z: Float) -> Float:
        return np.concatenate([problem.residuals(z), prior * z])

    def slope(z: Float, base: Float, columns: Columns) -> Float:
        return np.vstack([problem.sensitivities(z, base[:rows], columns), np.diag(prior)[:, columns]])

    def from_here(z: Float, inherited: Float | None = None, rough: bool = False) -> Least:
        return minimise(
            *(cost, slope, z, *bounds_of(problem.free)),
            tolerance=tolerance,
            iterations=iterations,
            inherited=inherited,
            own=own if inherited is not None else None,
            rough=rough,
        )

    least = from_here(z, inherited, rough)
    for _ in range(AGAIN):
        again = problem.anew(least.z, least.residuals[:rows])
        if again is None:
            break
        other = from_here(again)
        if other.power > WELL_WORTH * least.power:
            break
        least = other
    return least


def lent(near: Fit, free: Sequence[Free], prior: Float) -> tuple[Float, Columns]:
    """A fit's Jacobian, with prior rows, in the unknowns of another one beside it, and the columns it lacks."""
    have = {(one.name, one.segment): (i, one) for i, one in enumerate(near.free)}
    jacobian = np.zeros((near.residuals.size, len(free)))
    own = []
    for column, one in enumerate(free):
        if (one.name, one.segment) in have:
            i, old = have[(one.name, one.segment)]
            jacobian[:, column] = near.jacobian[:, i] * (one.scale / old.scale)
        else:
            own.append(column)
    return np.vstack([jacobian, np.diag(prior)]), np.array(own, dtype=np.intp)


def robust_covariance(jacobian: Float, residuals: Float, prior: Float, segments: Sequence[Segment]) -> Float:
    """Covariance of the scaled unknowns by the clustered sandwich (Liang and Zeger 1986).

    Residuals that a wrong model leaves are correlated over time, so counting samples would claim far too much.
    The scores are summed over blocks and their scatter taken as it is; never less than the inverse information.
    """
    information = jacobian.T @ jacobian + np.diag(prior)
    bread = inverse(information)
    meat = np.diag(prior)
    for rows in blocks(segments):
        score = jacobian[rows].T @ residuals[rows]
        meat = meat + np.outer(score, score)
    sandwich = bread @ meat @ bread
    floor = np.diag(bread)
    grow = np.sqrt(np.maximum(1.0, floor / np.maximum(np.diag(sandwich), 1e-12 * floor)))
    covariance = np.asarray(sandwich * np.outer(grow, grow))
    # Rounding can leave a variance below zero where the information is all but singular.
    np.fill_diagonal(covariance, np.maximum(np.diag(covariance), floor))
    return covariance


def inverse(information: Float) -> Float:
    """Inverse of an information matrix, symmetric and positive; what is not known at all gets a huge variance."""
    size = np.sqrt(np.maximum(np.diag(information), LEAST_INFORMATION * np.trace(information) + 1e-200))
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    scaled = (vectors / np.maximum(values, LEAST_INFORMATION)) @ vectors.T
    return np.asarray(scaled / np.outer(size, size))


def blocks(segments: Sequence[Segment], wanted: int = 24) -> list[slice]:
    """Row ranges of the stacked residuals that count as independent: each segment cut into equal stretches."""
    each = max(1, round(wanted / max(1, len(segments))))
    ranges: list[slice] = []
    offset = 0
    for segment in segments:
        width = segment.observed.shape[1]
        edges = np.linspace(0, segment.samples, each + 1).round().astype(int) * width + offset
        ranges += [slice(int(a), int(b)) for a, b in pairwise(edges) if b > a]
        offset += segment.observed.size
    return ranges
