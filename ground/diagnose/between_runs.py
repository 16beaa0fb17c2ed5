"""Whether what was found is the same from run to run: each of its parameters, fitted to each recording by itself.

A parameter that its sigma tells to a percent, and that is fifteen percent less in the next recording, is not known to
a percent: something differs between runs that is not in the plant (wind, warmth, who let go). Sigmas are then widened
by the scatter between runs (R. DerSimonian, N. Laird, Controlled Clinical Trials 7 (1986) 177).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2
from scipy.stats import t as student_t

from ground.diagnose.fit import Fit, fit_plant
from ground.diagnose.segments import Segment
from sim_hal.plant.simulate import Plant, SimulationError

Float = NDArray[np.float64]
Item = TypeVar("Item")

MOST_RUNS, MOST_WINDOWS = 8, 8
"""So many recordings, each by so many of its windows, tell whether runs agree."""
SURELY = 1e-4
"""Runs that agree scatter more than they do less often than this."""

ONE_SIGMA = 0.8413
"""Below one sigma lies this share of a normal distribution."""


@dataclass(frozen=True)
class Scatter:
    """What each run, by itself, makes of a parameter (value and sigma), the rest as found within its sigmas.

    `between`: standard deviation of the runs, in the parameter's unit, beyond what their own sigmas explain; 0 where
    they agree.
    """

    name: str
    unit: str
    by_run: Mapping[str, tuple[float, float]]
    between: float

    @property
    def usual(self) -> float:
        """The middle one of the runs' own sigmas."""
        return float(np.median([std for _, std in self.by_run.values()]))

    @property
    def content(self) -> dict[str, Any]:
        """For `diagnosis.json`."""
        runs = {run: {"value": value, "std": std} for run, (value, std) in self.by_run.items()}
        return {"parameter": self.name, "unit": self.unit, "runs": runs, "between": self.between}

    @property
    def words(self) -> str:
        """For a person: the runs that are farthest apart."""
        runs = sorted(self.by_run, key=lambda run: self.by_run[run][0])
        told = " and ".join(
            f"{self.by_run[run][0]:.3g} ± {self.by_run[run][1]:.1g} in {run}" for run in (runs[0], runs[-1])
        )
        return (
            f"{self.name} differs from run to run: {told} [{self.unit}], the rest as found. What makes it so is not "
            "in the plant; the ± stated covers it."
        )


def scatter_of(fit: Fit, segments: Sequence[Segment], sigmas: Float) -> tuple[Scatter, ...]:
    """For each parameter of an effect that joined, what the runs make of it, unless fewer than two tell it."""
    runs = by_run(segments)
    stated = fit.plant.flat()
    found = []
    for free in fit.free if len(runs) > 1 else ():
        if free.segment is not None or free.prior:
            continue
        alone = only(fit, free.name)
        span = {free.name: (fit.values[free.name], free.low, free.high)}
        told = {run: one for run, some in runs.items() if (one := by_itself(alone, some, sigmas, span))}
        if len(told) > 1:
            between = beyond_chance(list(told.values()))
            found.append(Scatter(free.name, stated[free.name].unit, told, between))
    return tuple(found)


def differing(scatters: Sequence[Scatter]) -> Iterator[str]:
    """In words, which parameter differs from run to run: the one by which the runs are farthest apart."""
    apart = sorted((one for one in scatters if one.between), key=lambda one: -one.between / one.usual)
    if apart:
        others = ", ".join(one.name for one in apart[1:])
        yield apart[0].words + (f" Told in place of it, {others} would differ instead." if others else "")


def by_run(segments: Sequence[Segment]) -> dict[str, list[Segment]]:
    """Windows by recording: of many recordings some, of many windows some, evenly."""
    runs: dict[str, list[Segment]] = {}
    for segment in segments:
        runs.setdefault(segment.run_name, []).append(segment)
    return {run: evenly(runs[run], MOST_WINDOWS) for run in evenly(list(runs), MOST_RUNS)}


def evenly(items: Sequence[Item], most: int) -> list[Item]:
    """At most so many of them, from the first to the last."""
    places = np.unique(np.linspace(0, len(items) - 1, min(most, len(items))).round().astype(int))
    return [items[place] for place in places]


def only(fit: Fit, name: str) -> Plant:
    """The plant as found, one parameter open, the others within their sigmas: their errors are no scatter of it."""
    return fit.plant.with_values(fit.values, {**fit.std, name: 0.0})


def by_itself(
    plant: Plant, segments: Sequence[Segment], sigmas: Float, ranges: Mapping[str, tuple[float, float, float]]
) -> tuple[float, float] | None:
    """What one run makes of a parameter: value and sigma; None where it cannot tell."""
    try:
        alone = fit_plant(plant, segments, sigmas, ranges)
    except SimulationError:
        return None
    (name,) = ranges
    value, sigma = alone.values[name], alone.std[name]
    at = next(place for place, free in enumerate(alone.free) if free.name == name and free.segment is None)
    if alone.held[at] or not np.isfinite(sigma) or sigma <= 0.0:
        return None
    return value, sigma


def beyond_chance(told: Sequence[tuple[float, float]]) -> float:
    """Scatter of the runs' values beyond their sigmas; 0 where chance may have made it."""
    values, sigmas = np.array(told).T
    weights = sigmas**-2.0
    mean = float(weights @ values / weights.sum())
    apart = float(weights @ (values - mean) ** 2)
    degrees = len(told) - 1
    if chi2.sf(apart, degrees) > SURELY:
        return 0.0
    share = float(weights.sum() - (weights**2).sum() / weights.sum())
    return float(np.sqrt(max(0.0, apart - degrees) / share))


def widened(fit: Fit, scatters: Sequence[Scatter], fitted: Collection[str]) -> Fit:
    """The fit of runs by these names with sigmas that cover the scatter between runs.

    It has weighed the runs by what they tell, and so few runs tell of their scatter by Student's t.
    """
    std = dict(fit.std)
    for one in scatters:
        weights = np.array([sigma**-2.0 for run, (_, sigma) in one.by_run.items() if run in fitted])
        if one.between and weights.size:
            share = float((weights**2).sum() / weights.sum() ** 2)
            least = student_t.ppf(ONE_SIGMA, len(one.by_run) - 1)
            std[one.name] = float(np.hypot(std[one.name], least * one.between * np.sqrt(share)))
    return replace(fit, std=std)
