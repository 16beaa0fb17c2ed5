"""Locate: the force that each balance equation lacks, smoothed from a recording without assuming its form."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ground.diagnose.evidence import LocatedForce
from ground.diagnose.fit import Fit
from ground.diagnose.knots import knot_force
from ground.diagnose.ripple import Ripple, strongest_ripple
from ground.diagnose.segments import Segment, spans
from ground.diagnose.smoothing import Smoothed, StateSpace, filtered, smooth
from ground.diagnose.workers import Context, Workers
from sim_hal.plant.run import bridged, smoothed_start
from sim_hal.plant.simulate import MISSING_FORCE, CompiledPlant, Plant, SimulationError, compile_plant, probes

Float = NDArray[np.float64]
Progress = Callable[[str], None]

RIPPLE_SAMPLES = 2500
"""So many readings, at full rate, tell a ripple's period."""
STEPS = 800
"""Steps that a recording is smoothed in; the inputs still act at every sample."""
SEARCH_STEPS = 200
SHARES = (1e-2, 1e-1, 1.0, 10.0)
"""Intensities tried: the missing force's wander over the recording, as multiples of the typical force."""
FINEST = 1e-5
"""Share of a channel's range that a reading is trusted to at best; keeps the filter's matrices sound."""
BINS = 24


def locate(
    fit: Fit,
    segments: Sequence[Segment],
    whole: Segment,
    sigmas: Float,
    scales: Mapping[str, Mapping[str, float]],
    workers: Workers,
) -> list[LocatedForce]:
    """The missing force of each balance in which one can be told, likeliest first.

    A plant that starts from a known state is looked at from its start, by knots over time; a rig given as equations,
    whose free run drifts away, from sample to sample by a filter, as long as it remembers nothing but its states.
    """
    typical = {
        name: scales[name]["F"] for name in fit.plant.structure.balances if "F" in scales.get(name, {})
    }
    tasks = [
        LocateTask(fit, tuple(segments), whole, sigmas, name, force, ripple=True)
        for name, force in typical.items()
    ]
    found = [force for force in workers.map(locate_job, tasks) if force is not None]
    return sorted(found, key=lambda force: -force.log_likelihood_gain)


@dataclass(frozen=True)
class LocateTask:
    """One balance to look for a missing force in; `typical`: its force's usual size; `ripple`: look for one, too."""

    fit: Fit
    segments: tuple[Segment, ...]
    whole: Segment
    sigmas: Float
    balance: str
    typical: float
    ripple: bool = False


def locate_job(_: Context, task: LocateTask) -> LocatedForce | None:
    """The missing force of one balance by the way that suits the plant."""
    structure = task.fit.plant.structure
    if task.fit.plant.kind == "equations" and not structure.flags and not structure.memories:
        return locate_in(task)
    return locate_by_knots(task)


def locate_by_knots(task: LocateTask) -> LocatedForce | None:
    """The missing force on the segment that fits worst."""
    edges = np.cumsum([0, *(segment.observed.size for segment in task.segments)])
    power = [float(np.sum(task.fit.residuals[a:b] ** 2)) for a, b in pairwise(edges)]
    worst = int(np.argmax(power))
    found = knot_force(task.fit, task.segments, worst, task.sigmas, task.balance, task.typical)
    if found is None:
        return None
    return LocatedForce(
        equation=task.balance,
        run=task.segments[worst].run_name,
        unit=task.fit.plant.structure.balances[task.balance].unit,
        times_s=found.times_s,
        before=found.force,
        before_std=found.force_std,
        after=None,
        causes=found.causes,
        explained={
            name: explained_by(values, found.force, found.force_std) for name, values in found.causes.items()
        },
        log_likelihood_gain=found.log_likelihood_gain,
        began_s=task.segments[worst].run.began_s,
    )


def locate_in(task: LocateTask) -> LocatedForce | None:
    """The missing force of one balance; None where it is not told, or the filter loses the motion."""
    try:
        return smoothed_in(task)
    except SimulationError:  # a state that is corrected from sample to sample may leave what the rig can bear
        return None


def smoothed_in(task: LocateTask) -> LocatedForce | None:
    """The missing force of one balance; None where it does not act on what was measured."""
    balance, typical = task.balance, task.typical
    plant = task.fit.plant.with_values(task.fit.values)
    segment = without_start(task.whole, plant)
    segment = replace(segment, run=bridged(plant.structure, segment.run))
    sizes = state_sizes(plant, task.segments, task.fit.initial) | {MISSING_FORCE: typical}
    space = state_space(plant, balance, thinned(segment, STEPS), task.sigmas, sizes)
    coarse = state_space(plant, balance, thinned(segment, SEARCH_STEPS), task.sigmas, sizes)
    duration = segment.run.times_s[-1] - segment.run.times_s[0]
    intensities = [(share * typical) ** 2 / duration for share in SHARES]
    likelihoods = [smooth(coarse, q).log_likelihood for q in intensities]
    still = smooth(coarse, 1e-6 * intensities[0]).log_likelihood
    best = int(np.argmax(likelihoods))
    smoothed = smooth(space, intensities[best])
    if not np.isfinite(smoothed.force).all() or smoothed.force_std.min() > typical:
        return None
    series = cause_series(plant, balance, segment, space, smoothed)
    return LocatedForce(
        equation=balance,
        run=segment.run_name,
        unit=plant.structure.balances[balance].unit,
        times_s=space.times_s,
        before=smoothed.force,
        before_std=smoothed.force_std,
        after=None,
        causes=series,
        explained={
            name: explained_by(values, smoothed.force, smoothed.force_std) for name, values in series.items()
        },
        log_likelihood_gain=likelihoods[best] - still,
        began_s=segment.run.began_s,
        ripple=ripple_in(plant, balance, segment, task.sigmas, sizes, intensities[best])
        if task.ripple
        else None,
    )


def ripple_in(
    plant: Plant, balance: str, segment: Segment, sigmas: Float, sizes: Mapping[str, float], intensity: float
) -> Ripple | None:
    """The ripple that a balance's missing force has, by the first readings at full rate."""
    if plant.structure.balances[balance].position is None:
        return None
    at = np.arange(min(RIPPLE_SAMPLES, segment.samples))
    space = state_space(plant, balance, (segment, at), sigmas, sizes)
    passed = filtered(space, intensity)
    if not np.isfinite(passed.mean).all():
        return None
    way = Smoothed(passed.mean[:, -1], np.zeros(at.size), passed.mean[:, :-1], passed.log_likelihood)
    position = cause_series(plant, balance, segment, space, way).get("position")
    return None if position is None else strongest_ripple(passed, position)


def still_missing(force: LocatedForce, task: LocateTask, context: Context) -> LocatedForce:
    """The same with what the extended plant still lacks."""
    after = locate_job(context, task)
    if after is None or after.run != force.run:
        return force
    return replace(force, after=np.interp(force.times_s, after.times_s, after.before))


def without_start(segment: Segment, plant: Plant) -> Segment:
    """The segment with its start smoothed once: at every later sample the smoother says where to start."""
    start = {}
    for name in plant.structure.known:
        channel = name.removeprefix("first(").removesuffix(")")
        if channel != name and channel in segment.run.first_samples:
            start[name] = smoothed_start(segment.run.times_s, segment.run.first_samples[channel])[0]
    return replace(segment, run=replace(segment.run, known={**segment.run.known, **start}))


def thinned(segment: Segment, steps: int) -> tuple[Segment, NDArray[np.int64]]:
    """The segment and the sample numbers at which it is smoothed."""
    count = min(steps, segment.samples)
    return segment, np.unique(np.linspace(0, segment.samples - 1, count).round().astype(np.int64))


def state_space(
    plant: Plant,
    balance: str,
    thin: tuple[Segment, NDArray[np.int64]],
    sigmas: Float,
    sizes: Mapping[str, float],
) -> StateSpace:
    """The plant with its missing force as last state, from chosen sample to chosen sample."""
    segment, at = thin
    compiled = compile_plant(plant, missing_force=balance)
    names = compiled.state_names
    order = [names.index(name) for name in names if name != MISSING_FORCE] + [names.index(MISSING_FORCE)]
    start = compiled.initial_values(compiled.values, segment.run)
    size = np.array([sizes[names[i]] for i in order])
    spread = spans(segment.observed)

    def transition(k: int, states: Float) -> Float:
        part = cut_run(segment, int(at[k]), int(at[k + 1]) + 1)
        return np.vstack([follow(compiled, part, names, order, row)[0][-1] for row in states])

    def measurement(k: int, states: Float) -> Float:
        part = cut_run(segment, int(at[k]), int(at[k]) + 1)
        return np.vstack([follow(compiled, part, names, order, row)[1][0] for row in states])

    return StateSpace(
        transition=transition,
        measurement=measurement,
        times_s=segment.run.times_s[at],
        observed=segment.observed[at],
        noise_std=np.maximum(FINEST * spread, np.minimum(sigmas, 0.1 * spread)),
        start=np.array([start[names[i]] for i in order]),
        start_std=np.append(0.1 * size[:-1], size[-1]),
        perturbation=1e-4 * size,
    )


def follow(
    compiled: CompiledPlant, part: Segment, names: tuple[str, ...], order: list[int], state: Float
) -> tuple[Float, Float]:
    """States (samples, n) in the smoother's order, and outputs (samples, m), from a given state on."""
    initial = {names[i]: float(value) for i, value in zip(order, state, strict=True)}
    outputs, states = compiled.run_with_states(compiled.values, part.run, initial)
    return states[:, order], outputs


def state_sizes(
    plant: Plant, segments: Sequence[Segment], initial: Sequence[Mapping[str, float]]
) -> dict[str, float]:
    """Typical magnitude of each state along all segments, from its fitted start; 1 for one that stands still."""
    compiled = compile_plant(plant)
    states = np.vstack(
        [
            compiled.run_with_states(compiled.values, segment.run, start)[1]
            for segment, start in zip(segments, initial, strict=True)
        ]
    )
    size = np.percentile(np.abs(states), 95.0, axis=0)
    return {
        name: float(one) if one > 0.0 else 1.0 for name, one in zip(compiled.state_names, size, strict=True)
    }


def cut_run(segment: Segment, start: int, stop: int) -> Segment:
    """The samples `start:stop` of a segment."""
    run = replace(
        segment.run,
        times_s=segment.run.times_s[start:stop],
        inputs={name: values[start:stop] for name, values in segment.run.inputs.items()},
        origin_s=segment.run.began_s,
    )
    return replace(segment, run=run, observed=segment.observed[start:stop])


def cause_series(
    plant: Plant, balance: str, segment: Segment, space: StateSpace, smoothed: Smoothed
) -> dict[str, Float]:
    """What the missing force may depend on, along the smoothed motion: velocity, position, load as known, time."""
    compiled = compile_plant(plant, missing_force=balance, extra=probes(plant, balance))
    names = compiled.state_names
    order = [names.index(name) for name in names if name != MISSING_FORCE] + [names.index(MISSING_FORCE)]
    outputs = len(plant.structure.outputs)
    at = np.searchsorted(segment.run.times_s, space.times_s)
    rows = np.empty((at.size, len(compiled.output_names) - outputs))
    for k, sample in enumerate(at):
        state = np.append(smoothed.states[k], 0.0)
        part = cut_run(segment, int(sample), int(sample) + 1)
        rows[k] = follow(compiled, part, names, order, state)[1][0][outputs:]
    labels = [name.removeprefix(f"{balance}.") for name in compiled.output_names[outputs:]]
    series = {label: rows[:, i] for i, label in enumerate(labels) if np.ptp(rows[:, i]) > 0.0}
    return series | {"time": space.times_s}


def explained_by(cause: Float, force: Float, std: Float) -> float:
    """Share of the force's variance that a free function of the cause explains where it was not fitted.

    Bin means from one half of the recording (alternate tenths) are tried on the other half, so that a cause with
    many values gains nothing by chance; never below 0. Each value counts by its sigma: where nothing is known of
    the force, nothing needs to be explained.
    """
    weight = 1.0 / std**2
    fold = (np.arange(force.size) * 10 // force.size) % 2
    count = min(BINS, max(2, force.size // 6))
    bins = np.digitize(cause, np.quantile(cause, np.linspace(0.0, 1.0, count + 1)[1:-1]))
    left = 0.0
    for half in (0, 1):
        train, test = fold != half, fold == half
        counts = np.bincount(bins[train], weights=weight[train], minlength=count)
        sums = np.bincount(bins[train], weights=(weight * force)[train], minlength=count)
        overall = float(np.average(force[train], weights=weight[train]))
        means = np.where(counts > 0.0, sums / np.maximum(counts, 1e-300), overall)
        left += float(np.sum(weight[test] * (force[test] - means[bins[test]]) ** 2))
    total = float(np.sum(weight * (force - np.average(force, weights=weight)) ** 2))
    return 0.0 if total == 0.0 else max(0.0, 1.0 - left / total) if math.isfinite(left) else 0.0
