"""The missing force of a plant that remembers (a latch, a crater, a gap): knots over time instead of a state.

Such a plant cannot be restarted at each sample, so the force F(t) enters as an input, linear between knots, and the
outputs' sensitivity to each knot is simulated. With a random-walk prior over the knots and the tolerances as priors
of the plant's own parameters this is a linear Gaussian model: force, sigma and marginal likelihood follow in closed
form (a smoother in batch form; Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, ch. 2). What
the parameters can absorb, the force does not claim.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ground.diagnose.fit import Fit
from ground.diagnose.segments import Segment
from sim_hal.plant.expressions import Name, add, multiply
from sim_hal.plant.simulate import Plant, compile_plant, probes
from sim_hal.plant.structure import Input

Float = NDArray[np.float64]

FORCE = "missing_force"
KNOTS = 60
EVENLY = 0.3
"""Share of the knots that is spread evenly; the rest goes where the residuals are."""
NUDGE = 1e-3
"""Force by which the sensitivities are taken, as a share of the typical one."""
UNFELT = 1e-3
"""A typical force that moves the readings by less than this share of their sigmas cannot be located."""
LEAST_PRIOR = 1e-9
WANDER = (1e-2, 1e-1, 1.0, 10.0)
"""Random-walk intensities tried: wander over the run, as multiples of the typical force."""


@dataclass(frozen=True)
class KnotForce:
    """The missing force of one balance on one segment, (knots,) each, with sigma and what it may depend on."""

    times_s: Float
    force: Float
    force_std: Float
    causes: Mapping[str, Float]
    log_likelihood_gain: float


def knot_force(
    fit: Fit, segments: Sequence[Segment], number: int, sigmas: Float, balance: str, typical: float
) -> KnotForce | None:
    """The missing force of `balance` on segment `number`; None where it moves nothing that was measured."""
    segment = segments[number]
    edges = np.cumsum([0, *(s.observed.size for s in segments)])
    rows = slice(int(edges[number]), int(edges[number + 1]))
    times = knot_times(fit.residuals[rows].reshape(segment.observed.shape), segment)
    slopes = knot_slopes(fit, segment, fit.initial[number], sigmas, balance, times, typical)
    if float(np.sqrt(np.mean(slopes**2))) < UNFELT:
        return None
    linear = Linear(fit, slopes, rows)
    walks = [walk_precision(times, share) for share in WANDER]
    gains = [linear.log_likelihood_gain(walk) for walk in walks]
    best = int(np.argmax(gains))
    force, std = linear.force(walks[best])
    causes = causes_at(fit, segment, fit.initial[number], balance, times)
    return KnotForce(times, typical * force, typical * std, causes, gains[best])


class Linear:
    """How the residuals of one segment answer a force there, while the parameters answer all segments."""

    def __init__(self, fit: Fit, slopes: Float, rows: slice) -> None:
        self.count = slopes.shape[1]
        moving = ~fit.held
        jacobian, prior = fit.jacobian[:, moving], np.maximum(fit.prior[moving], LEAST_PRIOR)
        cross = slopes.T @ jacobian[rows]
        self.information = np.block(
            [[slopes.T @ slopes, cross], [cross.T, jacobian.T @ jacobian + np.diag(prior)]]
        )
        own_pull = jacobian.T @ fit.residuals + fit.prior[moving] * fit.z[moving]
        self.pull = -np.concatenate([slopes.T @ fit.residuals[rows], own_pull])

    def precision(self, walk: Float) -> Float:
        """Of force and parameters together."""
        found = self.information.copy()
        found[: self.count, : self.count] += walk
        return found

    def log_likelihood_gain(self, walk: Float) -> float:
        """Marginal log likelihood with the force free, over that without it."""
        whole, own = self.precision(walk), self.information[self.count :, self.count :]
        pull = self.pull[self.count :]
        gained = self.pull @ np.linalg.solve(whole, self.pull) - pull @ np.linalg.solve(own, pull)
        volume = log_determinant(whole) - log_determinant(own) - log_determinant(walk)
        return 0.5 * (float(gained) - volume)

    def force(self, walk: Float) -> tuple[Float, Float]:
        """Mean and sigma of the force at the knots, (knots,) each."""
        covariance = np.linalg.inv(self.precision(walk))
        return (covariance @ self.pull)[: self.count], np.sqrt(np.diag(covariance)[: self.count])


def log_determinant(matrix: Float) -> float:
    """Of a positive matrix."""
    return float(np.linalg.slogdet(matrix)[1])


def walk_precision(times: Float, wander: float) -> Float:
    """Precision of a random walk that starts within the typical force and wanders `wander` of it over the run."""
    steps = np.diff(np.eye(times.size), axis=0)
    variance = wander**2 * np.diff(times) / (times[-1] - times[0])
    start = np.zeros((1, times.size))
    start[0, 0] = 1.0
    return np.asarray(steps.T @ (steps / variance[:, None]) + start.T @ start)


def knot_times(residuals: Float, segment: Segment) -> Float:
    """Times of the knots: partly even, mostly where the residuals are; only where something was measured."""
    seen = np.flatnonzero(np.isfinite(segment.observed).any(axis=1))
    power = np.nan_to_num(residuals[seen] ** 2).sum(axis=1)
    weight = EVENLY / seen.size + (1.0 - EVENLY) * power / max(float(power.sum()), 1e-300)
    share = np.cumsum(weight) / weight.sum()
    wanted = np.searchsorted(share, np.linspace(0.0, 1.0, KNOTS)[1:-1])
    at = np.unique(np.concatenate([[0], wanted, [seen.size - 1]]))
    return np.asarray(segment.run.times_s[seen[np.minimum(at, seen.size - 1)]])


def knot_slopes(
    fit: Fit,
    segment: Segment,
    initial: Mapping[str, float],
    sigmas: Float,
    balance: str,
    times: Float,
    typical: float,
) -> Float:
    """Change of the standardised residuals per typical force at each knot, (rows, knots)."""
    compiled = compile_plant(with_force_input(fit.plant.with_values(fit.values), balance))
    scaled = np.nan_to_num(1.0 * np.isfinite(segment.observed)) / sigmas

    def outputs(force: Float) -> Float:
        run = replace(segment.run, inputs={**segment.run.inputs, FORCE: force})
        return compiled.run(compiled.values, run, initial)

    at = segment.run.times_s
    base = outputs(np.zeros(at.size))
    columns = []
    for knot in np.eye(times.size):
        hat = np.interp(at, times, knot, left=0.0, right=0.0)
        moved = outputs(NUDGE * typical * hat)
        columns.append((-(moved - base) * scaled / NUDGE).ravel())
    return np.column_stack(columns)


def with_force_input(plant: Plant, balance: str) -> Plant:
    """The plant with one more input, a force on one balance."""
    place, structure = plant.structure.balances[balance], plant.structure
    rates = {
        state: add(rate, multiply(place.per_force[state], Name(FORCE))) if state in place.per_force else rate
        for state, rate in structure.rates.items()
    }
    definitions = dict(structure.definitions)
    if place.port is not None:
        own = definitions[place.port]
        definitions[place.port] = replace(own, value=add(own.value, Name(FORCE)))
    inputs = {**structure.inputs, FORCE: Input(place.unit)}
    return replace(plant, structure=replace(structure, rates=rates, definitions=definitions, inputs=inputs))


def causes_at(
    fit: Fit, segment: Segment, initial: Mapping[str, float], balance: str, times: Float
) -> dict[str, Float]:
    """What the force may depend on, at the knots: the balance's speed, position and load, the work done, time."""
    plant = fit.plant.with_values(fit.values)
    compiled = compile_plant(plant, extra=probes(plant, balance))
    series = compiled.run(compiled.values, segment.run, initial)[:, len(plant.structure.outputs) :]
    names = [
        name.removeprefix(f"{balance}.") for name in compiled.output_names[len(plant.structure.outputs) :]
    ]
    at = segment.run.times_s
    found = {
        name: np.interp(times, at, series[:, i]) for i, name in enumerate(names) if np.ptp(series[:, i]) > 0.0
    }
    if "velocity" in names:
        speed = np.abs(series[:, names.index("velocity")])
        found["distance run"] = np.interp(
            times, at, np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(at))])
        )
    return found | {"time": times}
