"""A plant on recordings as a least-squares problem: residuals and sensitivities in scaled unknowns.

Unknowns are the plant's parameters within their tolerances (the tolerance is a Gaussian prior, cut at
`PRIOR_REACH` sigmas), the parameters of the effects in it, and the initial states that a recording leaves open.
All are scaled to order one.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ground.diagnose.gauss_newton import Columns, minimise
from ground.diagnose.segments import Segment, head_of_run, spans
from sim_hal.plant.plant import check_use
from sim_hal.plant.simulate import CompiledPlant, Plant, SimulationError, compile_plant

Float = NDArray[np.float64]
Ranges = Mapping[str, tuple[float, float, float]]

PRIOR_REACH = 3.0
STEP = 1e-3
"""One-sided difference step in scaled units: above the integrator's error, below where curvature shows."""
SHIFTED_SAMPLES = 2.0
LEFT_BEHIND = 30.0
"""A segment whose mean square residual is this many times the usual one's may have stuck at a false start."""
PRECISE_STEP = 1e-2
PRECISE_TOLERANCE = 1e-9
"""For covariances: central differences. Parameters that only occur as ratios (all masses and stiffnesses scaled
alike move nothing) are known by their tolerances alone, and an error of one part in a thousand in the sensitivities
would pass for knowledge of them."""
WEAK = 1e-3
"""Information in a direction, as a share of the most, below which it may be made of the columns' errors."""
WEAK_ROUNDS = 2
TOLD_ANYWAY = 0.1
"""Information, beside a tolerance's 1, that does not count."""
WEAK_STEP = 0.3
TOLERANCE = 1e-7
"""Relative error per integration step: with `STEP`, sensitivities are right to about one part in a thousand."""
STEPS_PER_SAMPLE = 60
BLOWN_UP = 1e4
"""Standardised residual given to every sample of a simulation that did not get through."""


@dataclass(frozen=True)
class Free:
    """One fitted quantity: value = centre + scale * z, with low <= value <= high.

    `prior` says whether the scale is a prior standard deviation (a tolerance) or only a scale (an effect).
    `segment` is the index of the segment whose initial state it is, or None for a parameter of the plant.
    """

    name: str
    centre: float
    scale: float
    low: float
    high: float
    prior: bool
    segment: int | None = None

    def bounds(self) -> tuple[float, float]:
        return (self.low - self.centre) / self.scale, (self.high - self.centre) / self.scale


class FitProblem:
    """A plant with chosen effects on given segments: residuals and sensitivities in scaled unknowns.

    `ranges` gives the fit start, lower and upper limit of each effect parameter that has no prior of its own, by
    flat name. With `frozen` values nothing is fitted but the open initial states; `unknowns` are those of an earlier
    fit of the same plant. Where a parameter shifts a channel in time, differences look past the next sample: an
    edge between two samples tells nothing beyond them.
    """

    def __init__(
        self,
        plant: Plant,
        segments: Sequence[Segment],
        sigmas: Float,
        ranges: Ranges,
        frozen: Mapping[str, float] | None = None,
        tolerance: float = TOLERANCE,
        unknowns: Sequence[Free] | None = None,
    ) -> None:
        self.plant = plant
        self.compiled = limited(plant, segments, tolerance)
        self.segments = tuple(segments)
        self.sigmas = sigmas
        self._index = {name: i for i, name in enumerate(self.compiled.parameter_names)}
        self._base = self.compiled.values.copy()
        for name, value in (frozen or {}).items():
            self._base[self._index[name]] = value
        parameters = [] if frozen is not None else self._parameters(ranges)
        self.free = parameters + self._initial_states() if unknowns is None else list(unknowns)
        sizes = [segment.observed.size for segment in segments]
        self._edges = np.concatenate([[0], np.cumsum(sizes)])
        shifts = sample_shifts(plant, segments)
        self._shifts = np.array(
            [SHIFTED_SAMPLES * shifts.get(one.name, 0.0) / one.scale for one in self.free]
        )

    def _parameters(self, ranges: Ranges) -> list[Free]:
        """What is fitted: effect parameters within their ranges, nominal ones within their tolerances."""
        used = {str(s.recording.conditions.get("surface", "")) for s in self.segments}
        free: list[Free] = []
        for name, parameter in self.plant.flat().items():
            surface = name.split(".")[0]
            if surface in self.plant.surfaces and surface not in used:
                continue
            if name in ranges:
                start, low, high = ranges[name]
                scale = max(abs(start), 1e-3 * (high - low))
                free.append(Free(name, start, scale, low, high, prior=False))
            elif parameter.std > 0.0:
                reach = PRIOR_REACH * parameter.std
                low, high = parameter.value - reach, parameter.value + reach
                if parameter.value > 0.0:  # no sign change: masses, stiffnesses, resistances
                    low = max(low, 1e-3 * parameter.value)
                free.append(Free(name, parameter.value, parameter.std, low, high, prior=True))
        return free

    def _initial_states(self) -> list[Free]:
        free: list[Free] = []
        for number, segment in enumerate(self.segments):
            if not segment.open_scales:
                continue
            start = self.compiled.initial_values(self._base, segment.run)
            scales = {**segment.open_scales, **self._settled_scales(segment)}
            for state, scale in scales.items():
                free.append(Free(state, start[state], scale, -np.inf, np.inf, prior=False, segment=number))
        return free

    def _settled_scales(self, segment: Segment) -> dict[str, float]:
        """Scales of states that others tell at a start, such as a filter's: that takes steady motion before it."""
        spread = zip(self.compiled.output_names, spans(segment.observed).tolist(), strict=True)
        scales = {**{channel: 1e-2 * span or 1.0 for channel, span in spread}, **segment.open_scales}
        return {name: scales.get(of, 1.0) for name, of in self.compiled.settled_states.items()}

    def values(self, z: Float) -> Float:
        """The flat parameter vector of the compiled plant."""
        values = self._base.copy()
        for free, scaled in zip(self.free, z, strict=True):
            if free.segment is None:
                values[self._index[free.name]] = free.centre + free.scale * scaled
        return values

    def initial(self, z: Float, number: int) -> dict[str, float]:
        """Initial states of one segment that the recording leaves open."""
        return {
            free.name: free.centre + free.scale * scaled
            for free, scaled in zip(self.free, z, strict=True)
            if free.segment == number
        }

    def segment_residuals(self, z: Float, number: int, values: Float) -> Float:
        """Standardised residuals of one segment, (samples * outputs,); missing samples are 0."""
        segment = self.segments[number]
        try:
            predicted = self.compiled.run(values, segment.run, self.initial(z, number))
        except SimulationError:
            return np.full(segment.observed.size, BLOWN_UP)
        scaled = (segment.observed - predicted) / self.sigmas
        return np.clip(np.nan_to_num(scaled, nan=0.0), -BLOWN_UP, BLOWN_UP).ravel()

    def residuals(self, z: Float) -> Float:
        """Standardised residuals of all segments, stacked."""
        values = self.values(z)
        return np.concatenate([self.segment_residuals(z, i, values) for i in range(len(self.segments))])

    def sensitivities(self, z: Float, base: Float, columns: Columns) -> Float:
        """Derivative of the residuals by the unknowns `columns`, (rows, columns), by one-sided differences."""
        jacobian = np.zeros((base.size, columns.size))
        for place, column in enumerate(columns):
            step = max(STEP, float(self._shifts[column]))
            if z[column] + step > self.free[column].bounds()[1]:
                step = -step
            for rows, moved in self._moved(z, int(column), step):
                jacobian[rows, place] = (moved - base[rows]) / step
        return jacobian

    def precise_sensitivities(self, z: Float) -> Float:
        """The same by central differences of a wider step; for problems made with `PRECISE_TOLERANCE`."""
        jacobian = np.zeros((int(self._edges[-1]), len(self.free)))
        for column in range(len(self.free)):
            step = max(PRECISE_STEP, float(self._shifts[column]))
            pairs = zip(self._moved(z, column, step), self._moved(z, column, -step), strict=True)
            for (rows, up), (_, down) in pairs:
                jacobian[rows, column] = (up - down) / (2.0 * step)
        return jacobian

    def sure_of_weak(self, z: Float, jacobian: Float) -> Float:
        """Sensitivities (rows, unknowns) with those directions told anew in which all unknowns together move little.

        Masses, stiffnesses and frictions scaled alike move nothing; of columns that are each right to a thousandth,
        what is left of their sum would still pass for knowledge. A step along the direction itself does not err so.
        """
        low, high = (np.array(limits) for limits in zip(*(one.bounds() for one in self.free), strict=True))
        named = np.array([one.segment is None for one in self.free])
        told = jacobian.copy()
        for _ in range(WEAK_ROUNDS):  # the first finds the direction only as well as the columns have it
            values, vectors = np.linalg.eigh(told.T @ told)
            shared = np.sum(vectors[named] ** 2, axis=0) > 0.5
            weak = np.flatnonzero(shared & (values > TOLD_ANYWAY) & (values < WEAK * values[-1]))
            for along in vectors[:, weak].T:
                up, down = (np.clip(z + way * WEAK_STEP * along, low, high) for way in (1.0, -1.0))
                slope = (self.residuals(up) - self.residuals(down)) / max(
                    float(along @ (up - down)), WEAK_STEP
                )
                told += np.outer(slope - told @ along, along)
        return told

    def _moved(self, z: Float, column: int, step: float) -> Iterator[tuple[slice, Float]]:
        """Residuals, by segment, with one unknown moved; only segments that it acts on."""
        moved = z.copy()
        moved[column] += step
        values = self.values(moved)
        own = self.free[column].segment
        for number in range(len(self.segments)) if own is None else [own]:
            rows = slice(int(self._edges[number]), int(self._edges[number + 1]))
            yield rows, self.segment_residuals(moved, number, values)

    def start(self, known: Mapping[str, float], initial: Sequence[Mapping[str, float]] = ()) -> Float:
        """Scaled start: the values and initial states of an earlier fit where it had them, else the centres."""
        z = np.zeros(len(self.free))
        for i, free in enumerate(self.free):
            if free.segment is None and free.name in known:
                z[i] = (known[free.name] - free.centre) / free.scale
            elif free.segment is not None and initial and free.name in initial[free.segment]:
                z[i] = (initial[free.segment][free.name] - free.centre) / free.scale
            low, high = free.bounds()
            z[i] = min(max(z[i], low + 1e-9), high - 1e-9)
        return z

    def anew(self, z: Float, residuals: Float) -> Float | None:
        """The unknowns with the open initial states as at the start in the segments left behind; None if none is.

        While a law was still far off, a segment may have found a wrong start that fitted better, and stay there.
        """
        pieces = [residuals[a:b] for a, b in itertools.pairwise(self._edges)]
        powers = [float(piece @ piece) / piece.size for piece in pieces]
        usual = max(1.0, sorted(powers)[(len(powers) - 1) // 2])
        behind = {number for number, power in enumerate(powers) if power > LEFT_BEHIND * usual}
        own = np.array([one.segment in behind for one in self.free], dtype=bool)
        return np.where(own, 0.0, z) if own.any() else None

    def settle_initial_states(self) -> Float:
        """Best open initial states with all parameters as they are (used where everything else is frozen)."""
        z = np.zeros(len(self.free))
        if z.size == 0:
            return z
        none = np.full(z.size, np.inf)
        return minimise(self.residuals, self.sensitivities, z, -none, none, tolerance=1e-8, iterations=15).z


def sample_shifts(plant: Plant, segments: Sequence[Segment]) -> dict[str, float]:
    """Change of each parameter that shifts a channel in time (a delay, a clock's rate) that shifts it by one sample.

    A clock's, by the end of the longest recording.
    """
    times = [segment.run.times_s for segment in segments]
    shift_s = max(float(np.median(np.diff(at))) for at in times)
    duration_s = max(float(segment.run.times_s[-1] - segment.run.began_s) for segment in segments)
    found: dict[str, float] = {}
    for use in plant.effects:
        form = check_use(plant, use)
        size = shift_s if form.delay else shift_s / duration_s if form.skew else 0.0
        found |= {f"{plant.prefix(use)}.{p.name}": size for p in form.parameters if p.strength and size}
    return found


def limited(plant: Plant, segments: Sequence[Segment], tolerance: float) -> CompiledPlant:
    """The plant ready for a fit, with a limit on stiff guesses.

    A candidate whose start makes the equations so stiff that they take hundreds of steps a sample would hold up all
    others; such a simulation counts as blown up. Steps are of order 4: finer ones may be as many more.
    """
    compiled = compile_plant(plant, relative_tolerance=tolerance)
    finer = max(1.0, (TOLERANCE / tolerance) ** 0.25)
    most = int(finer * STEPS_PER_SAMPLE) * max(segment.samples for segment in segments) + 10_000
    return replace(compiled, tolerances=compiled.tolerances._replace(steps=most))


def head_of(segment: Segment, share: float = 0.03) -> Segment:
    """The first share of a segment; the default is what an open initial state may be read from."""
    run = head_of_run(segment.run, share)
    return replace(segment, run=run, observed=segment.observed[: run.times_s.size])
