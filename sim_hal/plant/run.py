"""What drives a simulated run, and the schedule that the engine follows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from sim_hal.plant.between import CUBIC, HOLD, cubic, subdivided
from sim_hal.plant.engine import Schedule
from sim_hal.plant.program import Floats
from sim_hal.plant.structure import Structure


class SimulationError(RuntimeError):
    """A simulation could not be carried out; the message says when and why."""


@dataclass(frozen=True, eq=False)
class Run:
    """What drives one simulated run; never measured outputs, except through `initial: channel`.

    Arrays must not be changed once the run has been used: what follows from them is kept.

    times_s: (n,), increasing. inputs: each (n,), NaN where a sample is missing. events: seconds on the same clock.
    known: the sidecar's `state:`. first_samples: (k,) channels whose smoothed start is an initial value.
    origin_s: when the recording began that the run is a part of; None where the run is all of it.
    """

    times_s: Floats
    inputs: Mapping[str, Floats] = field(default_factory=dict)
    events: Mapping[str, float] = field(default_factory=dict)
    known: Mapping[str, float] = field(default_factory=dict)
    conditions: Mapping[str, float | str] = field(default_factory=dict)
    first_samples: Mapping[str, Floats] = field(default_factory=dict)
    origin_s: float | None = None

    @property
    def began_s(self) -> float:
        """What `elapsed` counts from: the same instant in a whole run and in any part of it."""
        return float(self.times_s[0]) if self.origin_s is None else self.origin_s


@dataclass(frozen=True)
class Lateness:
    """A channel that reads what was `delay_s` ago, and by `skew` more with each second since `origin_s`.

    What is simulated begins at `start_s`.
    """

    start_s: float
    origin_s: float
    delay_s: float
    skew: float

    def seen_s(self, times_s: Floats) -> Floats:
        """(n,) when the plant was as the channel reads at the given times; never before the start."""
        return np.maximum(times_s - self._late_s(times_s), self.start_s)

    def before_s(self, times_s: Floats) -> Floats:
        """(n,) by how much a reading should reach back beyond the start."""
        return np.maximum(self._late_s(times_s) - (times_s - self.start_s), 0.0)

    def longest_s(self, time_s: float) -> float:
        """The most by which the channel is late until a time."""
        return max(self.delay_s, float(self._late_s(np.array(time_s))))

    def _late_s(self, times_s: Floats) -> Floats:
        return self.delay_s + self.skew * (times_s - self.origin_s)


def prolonged(run: Run, until_s: float) -> Run:
    """The run made to last until a later time, with its last inputs held: what a clock that runs slow will see."""
    if until_s <= run.times_s[-1]:
        return run
    inputs = {name: np.append(values, np.nan) for name, values in run.inputs.items()}
    return replace(run, times_s=np.append(run.times_s, until_s), inputs=inputs)


def check_times(times: Floats) -> None:
    """Raise `SimulationError` unless the times increase and are finite."""
    if times.ndim != 1 or len(times) == 0:
        raise SimulationError("a run needs at least one sample time")
    if not np.all(np.isfinite(times)) or not np.all(np.diff(times) > 0):
        raise SimulationError("sample times must be finite and increase")


_Segments = tuple[Floats, Floats, Floats, Floats]
_known_segments: WeakKeyDictionary[Run, dict[object, _Segments]] = WeakKeyDictionary()


def schedule(structure: Structure, run: Run, flags: tuple[str, ...], samples: Floats) -> Schedule:
    """Segments between the instants at which inputs or events change the equations."""
    kept = _known_segments.setdefault(run, {})
    key = (tuple((name, spec.interpolation) for name, spec in structure.inputs.items()), flags)
    if key not in kept:
        kept[key] = _segments(structure, run, flags)
    return Schedule(*kept[key], np.ascontiguousarray(samples))


def _segments(structure: Structure, run: Run, flags: tuple[str, ...]) -> _Segments:
    """Breaks (nb,), inputs and their slopes from each break on (nb, nu), and when each flag's event happens."""
    times = run.times_s
    events = np.array([run.events.get(name, np.inf) for name in flags], dtype=float)
    inside = events[(events > times[0]) & (events < times[-1])]
    ends = times if structure.inputs else times[[0, -1]]
    if any(spec.interpolation == CUBIC for spec in structure.inputs.values()):
        ends = subdivided(times)
    every = np.unique(np.concatenate([ends, inside]))
    values = np.zeros((len(every), len(structure.inputs)))
    slopes = np.zeros_like(values)
    for column, (name, spec) in enumerate(structure.inputs.items()):
        present = _present(run, name)
        values[:, column] = _between(spec.interpolation, every, times[present], run.inputs[name][present])
        if spec.interpolation != HOLD:
            slopes[:-1, column] = np.diff(values[:, column]) / np.diff(every)
    keep = _breaks(every, values, slopes, inside)
    return every[keep], values[keep], slopes[keep], events


def _between(interpolation: str, at: Floats, times: Floats, samples: Floats) -> Floats:
    """An input at some times, (k,), from the samples that are there."""
    if interpolation == HOLD:
        return np.asarray(samples[np.maximum(np.searchsorted(times, at, side="right") - 1, 0)])
    return cubic(at, times, samples) if interpolation == CUBIC else np.asarray(np.interp(at, times, samples))


def bridged(structure: Structure, run: Run) -> Run:
    """The run with its inputs' missing samples as the simulation takes them, so that any part of it can be run."""
    if not any(np.isnan(run.inputs[name]).any() for name in structure.inputs):
        return run
    inputs = dict(run.inputs)
    for name, spec in structure.inputs.items():
        seen = _present(run, name)
        inputs[name] = _between(spec.interpolation, run.times_s, run.times_s[seen], inputs[name][seen])
    return replace(run, inputs=inputs)


def _present(run: Run, name: str) -> NDArray[np.bool_]:
    """Which samples of an input are there; raises `SimulationError` when it cannot drive the run."""
    if name not in run.inputs:
        raise SimulationError(f"the run lacks the input {name!r}")
    values = run.inputs[name]
    if values.shape != run.times_s.shape:
        raise SimulationError(f"input {name!r} has {values.size} samples, the run {run.times_s.size} times")
    present = ~np.isnan(values)
    if not present.any() or np.isinf(values).any():
        raise SimulationError(f"input {name!r} has no finite values")
    return present


def _breaks(every: Floats, values: Floats, slopes: Floats, events: Floats) -> NDArray[np.bool_]:
    """Where a segment must begin: an input or its slope changes, an event happens, the run starts or ends."""
    keep = np.isin(every, events)
    keep[0] = keep[-1] = True
    # Inputs go on along their slope; only a change of slope, or for held ones of value, is a break.
    held = (slopes == 0.0) & (np.roll(slopes, 1, axis=0) == 0.0)
    jump = held & (values != np.roll(values, 1, axis=0))
    turn = slopes != np.roll(slopes, 1, axis=0)
    return np.asarray(keep | np.any(jump | turn, axis=1))


def smoothed_start(times: Floats, samples: Floats) -> tuple[float, float]:
    """Value and slope of a channel at its first time, by a low polynomial through its first samples."""
    count = min(len(samples), len(times))
    present = ~np.isnan(samples[:count])
    t, y = times[:count][present] - times[0], samples[:count][present]
    if len(y) == 0:
        raise SimulationError("the first samples of a channel that gives an initial value are all missing")
    degree = 2 if len(y) >= 8 else 1 if len(y) >= 3 else 0
    coefficients, *_ = np.linalg.lstsq(np.vander(t, degree + 1, increasing=True), y, rcond=None)
    return float(coefficients[0]), float(coefficients[1]) if degree else 0.0
