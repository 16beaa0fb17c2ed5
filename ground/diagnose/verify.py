"""Verify: the three fits on recordings that none of them saw."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ground.diagnose.evidence import Trace
from ground.diagnose.problem import FitProblem, head_of
from ground.diagnose.result import ChannelFit, Whiteness
from ground.diagnose.scoring import whiteness_p
from ground.diagnose.segments import Segment
from sim_hal.plant.simulate import Plant, compile_plant
from sim_hal.plant.units import channel_unit

Float = NDArray[np.float64]

NAMES = ("nominal", "refit", "extended")


@dataclass(frozen=True)
class Verified:
    """Held-out figures by channel, and the traces behind them."""

    fit: dict[str, ChannelFit]
    whiteness: dict[str, Whiteness]
    traces: tuple[Trace, ...]


def predict(plant: Plant, segment: Segment, sigmas: Float) -> Float:
    """Predicted outputs (samples, outputs) of a run by a plant as it is.

    Open initial states are read from the first samples alone; nothing else of what was measured is used.
    """
    problem = FitProblem(plant, (head_of(segment),), sigmas, {}, frozen={})
    initial = problem.initial(problem.settle_initial_states(), 0)
    compiled = compile_plant(
        plant
    )  # at a simulation's accuracy, with no limit made for the few first samples
    return compiled.run(compiled.values, segment.run, initial)


def verify(
    plants: Mapping[str, Plant],
    free_run: Sequence[Segment],
    sigmas: Float,
    noise: Mapping[str, float],
) -> Verified:
    """Compare the plants `nominal`, `refit` and `extended` on held-out segments.

    The figures are of free runs over whole held-out recordings; whiteness is tested on the same residuals.
    """
    outputs = tuple(plants["refit"].structure.outputs)
    predictions = {name: [predict(plants[name], segment, sigmas) for segment in free_run] for name in NAMES}
    fit: dict[str, ChannelFit] = {}
    whiteness: dict[str, Whiteness] = {}
    traces: list[Trace] = []
    units = channel_units(plants["refit"])
    for column, channel in enumerate(outputs):
        if channel not in noise:
            continue
        errors = {
            name: [
                s.judged[:, column] - p[:, column] for s, p in zip(free_run, predictions[name], strict=True)
            ]
            for name in NAMES
        }
        nominal, refit, extended = (rms(np.concatenate(errors[name])) for name in NAMES)
        fit[channel] = ChannelFit(nominal, refit, extended, noise[channel], units[channel])
        before, after = (min(map(whiteness_p, errors[name])) for name in ("refit", "extended"))
        whiteness[channel] = Whiteness(before, after)
        for number, segment in enumerate(free_run):
            columns = [predictions[name][number][:, column] for name in NAMES]
            measured = segment.judged[:, column]
            traces.append(
                Trace(segment.run_name, channel, units[channel], segment.run.times_s, measured, *columns)
            )
    return Verified(fit, whiteness, tuple(traces))


def windowed_rms(plant: Plant, windows: Sequence[Segment], sigmas: Float) -> dict[str, Float]:
    """Error of each channel by window, each window anchored at its own first samples: what drift cannot fake."""
    outputs = tuple(plant.structure.outputs)
    errors = [segment.judged - predict(plant, segment, sigmas) for segment in windows]
    return {name: np.array([rms(error[:, i]) for error in errors]) for i, name in enumerate(outputs)}


def channel_units(plant: Plant) -> dict[str, str]:
    """Unit of each output by its name's suffix."""
    return {name: channel_unit(name) for name in plant.structure.outputs}


def rms(values: Float) -> float:
    """Root mean square of what is there; NaN when nothing is."""
    seen = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(seen**2))) if seen.size else float("nan")
