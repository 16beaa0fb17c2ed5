"""Ask: the next run, out of those the rig may safely make, that best tells the remaining rivals apart.

Safe are runs that stay within what the recordings already hold: inputs no larger, springs pressed no further,
surfaces met before. Each is simulated with the chosen effect and with its closest rival, both as fitted, and what the
rival's own parameters could still absorb of the difference is taken out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ground.diagnose.fit import Fit
from ground.diagnose.problem import limited
from ground.diagnose.segments import Segment
from sim_hal.plant.simulate import CompiledPlant, Run, SimulationError

Float = NDArray[np.float64]

STEP = 1e-2
"""Difference step of the rival's sensitivities, in its scaled unknowns."""
COMPRESSION = "spring_compression_m"


@dataclass(frozen=True)
class Experiment:
    """A run that could be made: in words, as it would be driven, and the segment whose start it has.

    The states that it leaves open are those that each fit found there: a channel that lies tells them otherwise.
    """

    words: str
    run: Run
    start: int


@dataclass(frozen=True)
class Proposal:
    """The most telling run: `separation` is how many sigmas apart (root sum of squares) the rivals predict it."""

    words: str
    separation: float
    as_recorded: float


def propose(chosen: Fit, rival: Fit, segments: Sequence[Segment], sigmas: Float) -> Proposal | None:
    """The experiment that best separates two fits; None when none can be simulated."""
    found: list[tuple[float, str]] = []
    for experiment in experiments(segments):
        try:
            found.append((separation(chosen, rival, experiment, segments, sigmas), experiment.words))
        except SimulationError:
            continue
    if not found:
        return None
    best = max(found)
    return Proposal(best[1], best[0], found[0][0])


def experiments(segments: Sequence[Segment]) -> Iterator[Experiment]:
    """Runs within what was recorded; the first repeats a recording as it was."""
    longest = max(
        range(len(segments)), key=lambda i: segments[i].run.times_s[-1] - segments[i].run.times_s[0]
    )
    model, start = segments[longest].run, longest
    yield Experiment(f"a repeat of {segments[longest].run_name}", model, start)
    for name, values in model.inputs.items():
        for factor in (0.3, 0.6):
            inputs = {**model.inputs, name: factor * values}
            yield Experiment(f"{name} at {factor:.0%} of its size", replace(model, inputs=inputs), start)
        slow = {**model.inputs, name: stretched(values)}
        yield Experiment(f"{name} run through at half the speed", replace(model, inputs=slow), start)
        if values.min() < 0.0 < values.max():
            flipped = {**model.inputs, name: -values}
            yield Experiment(f"{name} with its sign reversed", replace(model, inputs=flipped), start)
    yield from hops(segments, model, start)


def stretched(values: Float) -> Float:
    """The first half of an input, at half the speed."""
    return np.interp(np.arange(values.size) / 2.0, np.arange(values.size), values)


def hops(segments: Sequence[Segment], model: Run, start: int) -> Iterator[Experiment]:
    """Hops from other compressions, on each surface that was met."""
    pressed = [s.run.known[COMPRESSION] for s in segments if COMPRESSION in s.run.known]
    if not pressed or not model.events:
        return
    surfaces = sorted({str(s.run.conditions["surface"]) for s in segments if "surface" in s.run.conditions})
    for surface in surfaces:
        for compression in (0.5 * min(pressed), 0.75 * min(pressed), min(pressed), max(pressed)):
            run = replace(
                model,
                known={**model.known, COMPRESSION: compression},
                conditions={**model.conditions, "surface": surface},
            )
            words = f"a hop on {surface.replace('_', ' ')} from {1e3 * compression:.1f} mm of compression"
            yield Experiment(words, run, start)


def separation(
    chosen: Fit, rival: Fit, experiment: Experiment, segments: Sequence[Segment], sigmas: Float
) -> float:
    """How far apart two fits predict a run, in sigmas, less what the rival's parameters could absorb."""
    one = predict(limited(chosen.plant, segments, 1e-7), chosen, chosen.z, experiment)
    compiled = limited(rival.plant, segments, 1e-7)
    other = predict(compiled, rival, rival.z, experiment)
    columns = []
    for i, free in enumerate(rival.free):
        if free.segment is None:
            moved = rival.z.copy()
            moved[i] += STEP if moved[i] + STEP <= free.bounds()[1] else -STEP
            there = predict(compiled, rival, moved, experiment)
            columns.append(((there - other) / (moved[i] - rival.z[i]) / sigmas).ravel())
    difference = ((one - other) / sigmas).ravel()
    slopes = np.vstack([np.column_stack(columns), posterior_root(rival)])
    padded = np.concatenate([difference, np.zeros(slopes.shape[0] - difference.size)])
    absorbed = np.linalg.lstsq(slopes, padded, rcond=None)[0]
    return float(np.linalg.norm(padded - slopes @ absorbed))


def posterior_root(fit: Fit) -> Float:
    """What the recordings at hand already say of the parameters, as rows of a least-squares problem."""
    named = [i for i, free in enumerate(fit.free) if free.segment is None]
    rows = np.vstack([fit.jacobian, np.diag(fit.prior)])[:, named]
    return np.asarray(np.linalg.qr(rows, mode="r"))


def predict(compiled: CompiledPlant, fit: Fit, z: Float, experiment: Experiment) -> Float:
    """Outputs (samples, outputs) of a run with a fit's parameters at scaled unknowns `z`."""
    values = compiled.values.copy()
    index = {name: i for i, name in enumerate(compiled.parameter_names)}
    for free, scaled in zip(fit.free, z, strict=True):
        if free.segment is None:
            values[index[free.name]] = free.centre + free.scale * scaled
    known = {
        name: value for name, value in fit.initial[experiment.start].items() if name in compiled.state_names
    }
    return compiled.run(values, experiment.run, known)
