"""Recordings cut into the stretches that a fit simulates, and what each channel can be trusted to.

A recording of the built-in kinds is simulated whole, from its known start, as is that of a rig with a state whose
start is given. A long recording of a rig whose equations may start anywhere is cut into windows, each anchored anew
at its first samples (multiple shooting): an unmodelled force then moves a window's end, not the whole rest of the
recording (Bock and Plitt 1984).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ground.diagnose.hop_masks import hop_mask
from ground.recordings.model import Recording
from ground.recordings.plant_run import to_run
from sim_hal.plant.expressions import Name
from sim_hal.plant.simulate import CompiledPlant, Plant, Run, SimulationError
from sim_hal.plant.structure import FIT, State

Float = NDArray[np.float64]

HEAD_SHARE, HEAD_SAMPLES = 0.03, 30
LEAST_HEAD = 8
NUDGES = (1.0, 1e-2, 1e-4)
"""Changes of an open start that are tried, in its unit."""
DIFFERENCES = (2, 3, 4, 6, 8, 12, 16)
"""Orders of the differences that a channel's noise is read from, ..."""
SAMPLES_PER_ORDER = 12
"""... each as long as there are this many times as many samples."""
MODEL_FLOOR = 2.5e-4
"""Share of a channel's range below which a model of the rig is not judged, where the sensor has no noise."""


@dataclass(frozen=True)
class Segment:
    """One stretch of one recording, ready to simulate.

    `observed` is (samples, outputs) in the order of the plant's outputs, NaN where nothing was measured.
    `open_scales` are the initial states that must be fitted (those a plant file leaves open, and those that it reads
    from noisy first samples), with the change of each that moves the outputs by 1 % of their range. Predictions are
    judged from the sample `judged_from` on.
    """

    run_name: str
    run: Run
    observed: Float
    recording: Recording
    open_scales: Mapping[str, float]
    judged_from: int = 0

    @property
    def samples(self) -> int:
        return int(self.run.times_s.size)

    @property
    def judged(self) -> Float:
        """What was measured, (samples, outputs), NaN before `judged_from`: what a fit has seen proves nothing."""
        return np.where(np.arange(self.samples)[:, None] < self.judged_from, math.nan, self.observed)


def split_last_part(recording: Recording, share: float) -> tuple[Recording, Recording]:
    """Cut one recording in two: what is fitted, and the last `share` of its samples, which is held out."""
    cut = round(recording.times_s.size * (1.0 - share))
    at = f"{recording.times_s[cut]:.2f} s"
    first, last = cut_recording(recording, 0, cut), cut_recording(recording, cut, recording.times_s.size)
    return replace(first, run=f"{recording.run} until {at}"), replace(last, run=f"{recording.run} from {at}")


def last_part(recording: Recording, plant: Plant, compiled: CompiledPlant, share: float) -> Segment:
    """The last `share` of a recording of a rig whose start is given: it runs from there, and is judged at the end."""
    cut = round(recording.times_s.size * (1.0 - share))
    return replace(segment_of(recording, plant, compiled), judged_from=cut)


def starts_anywhere(compiled: CompiledPlant) -> bool:
    """Whether the start of every state is fitted or read from a channel."""
    return all(map(is_open, compiled.plant.structure.states.values()))


def cut_recording(recording: Recording, start: int, stop: int) -> Recording:
    """The samples `start:stop` of a recording, as a recording of its own (same clock, origin and metadata)."""
    channels = {name: values[start:stop] for name, values in recording.channels.items()}
    return replace(
        recording,
        times_s=recording.times_s[start:stop],
        channels=channels,
        origin_s=recording.began_s,
    )


def segment_of(recording: Recording, plant: Plant, compiled: CompiledPlant) -> Segment:
    """A whole recording as one segment."""
    missing = np.full(recording.times_s.size, math.nan)
    columns = [recording.channels.get(name, missing) for name in compiled.output_names]
    run, observed = to_run(recording, plant), np.column_stack(columns)
    if plant.kind == "hop":
        observed[~hop_mask(recording, plant, run)] = math.nan
    return Segment(recording.run, run, observed, recording, open_scales(compiled, run, observed))


def open_scales(compiled: CompiledPlant, run: Run, observed: Float) -> dict[str, float]:
    """Open initial states with their scales, from the first samples."""
    head = followed_head(compiled, run)
    start = compiled.initial_values(compiled.values, head)
    count = head.times_s.size
    spread = spans(observed)
    scales = {}
    for name, state in compiled.plant.structure.states.items():
        if not is_open(state):
            continue
        moved = response_to(compiled, head, start, name)[:count] / np.where(spread > 0.0, spread, 1.0)
        strength = float(np.sqrt(np.mean(moved**2)))
        scales[name] = 1e-2 / strength if strength > 0.0 else 1.0
    return scales


def followed_head(compiled: CompiledPlant, run: Run) -> Run:
    """The first samples of a run, as many of them as the plant gets through."""
    part = 1.0
    while (head := head_of_run(run, HEAD_SHARE * part, int(HEAD_SAMPLES * part))).times_s.size > LEAST_HEAD:
        try:
            compiled.run(compiled.values, head, compiled.initial_values(compiled.values, head))
            break
        except SimulationError:
            part *= 0.5
    return head


def spans(observed: Float) -> Float:
    """Largest less smallest reading of each output, (outputs,), of (samples, outputs); 0 where nothing was read."""
    return np.array([np.ptp(c[np.isfinite(c)]) if np.isfinite(c).any() else 0.0 for c in observed.T])


def response_to(compiled: CompiledPlant, run: Run, start: Mapping[str, float], state: str) -> Float:
    """Change of the outputs, (samples, outputs), by one unit of a state at the start.

    A unit may be far more than the rig can bear (a metre of a tank's level): then a part of it is tried.
    """
    here = compiled.run(compiled.values, run, start)
    for part in NUDGES:
        try:
            there = compiled.run(compiled.values, run, {**start, state: start[state] + part})
        except SimulationError:
            continue
        return (there - here) / part
    return np.zeros_like(here)


def is_open(state: State) -> bool:
    """Whether a state's start is fitted or read from a channel, and may so be found anew at any sample."""
    return state.initial == FIT or (isinstance(state.initial, Name) and state.initial.id.startswith("first("))


def head_of_run(run: Run, share: float = HEAD_SHARE, least: int = HEAD_SAMPLES) -> Run:
    """The first samples of a run: what an open start may be read from; of a short run no more than a quarter."""
    least = min(least, max(LEAST_HEAD, run.times_s.size // 4))
    count = min(run.times_s.size, max(least, int(share * run.times_s.size)))
    inputs = {name: values[:count] for name, values in run.inputs.items()}
    return replace(run, times_s=run.times_s[:count], inputs=inputs)


def channel_sigmas(
    recordings: Sequence[Recording], plant: Plant, output_names: Sequence[str]
) -> dict[str, float]:
    """Standard deviation of what each channel reads around the truth.

    From the stated noise and resolution (uniform rounding error, resolution/sqrt(12)); where nothing is stated,
    from the scatter of second differences. Never below `MODEL_FLOOR` of the channel's range, so that a channel
    without noise of its own (an encoder) does not count as infinitely exact.
    """
    sigmas: dict[str, float] = {}
    for name in output_names:
        pieces = [r.channels[name] for r in recordings if name in r.channels]
        if not pieces:
            continue
        values = np.concatenate(pieces)
        sigma = sensor_sigma(recordings, plant, name)
        floor = MODEL_FLOOR * float(spans(values[:, None])[0])
        sigmas[name] = floor if sigma < 0.1 * floor else sigma
    return sigmas


def sensor_sigma(recordings: Sequence[Recording], plant: Plant, channel: str) -> float:
    """The sensor's own noise and rounding on one channel: as stated, else from the readings' scatter."""
    stated = _stated_sigma(recordings[0], plant, channel)
    return (
        _scatter([r.channels[channel] for r in recordings if channel in r.channels])
        if stated is None
        else stated
    )


def _stated_sigma(recording: Recording, plant: Plant, channel: str) -> float | None:
    """Noise and rounding as the recording states them, else as the plant file does; None when neither does."""
    for sensors in (recording.sensors, plant.sensors):
        spec = sensors.get(channel)
        if spec is not None and (spec.noise_std is not None or spec.resolution is not None):
            return math.hypot(spec.noise_std or 0.0, (spec.resolution or 0.0) / math.sqrt(12.0))
    return None


def _scatter(pieces: Sequence[Float]) -> float:
    """White-noise level by differences (von Neumann), robust by the median.

    Differences of order d let white noise of unit variance through with variance (2d over d). A signal that moves
    fast between samples passes those of low order, ever less of it those of high order: the least estimate counts.
    """
    seen = [piece[np.isfinite(piece)] for piece in pieces]
    count = sum(piece.size for piece in seen)
    estimates = []
    for order in DIFFERENCES:
        differences = np.concatenate([np.diff(piece, order) for piece in seen])
        if differences.size and (order == DIFFERENCES[0] or order * SAMPLES_PER_ORDER <= count):
            gain = math.sqrt(math.comb(2 * order, order))
            estimates.append(float(np.median(np.abs(differences))) / 0.6745 / gain)
    return min(estimates, default=0.0)


def sigma_vector(sigmas: Mapping[str, float], output_names: Sequence[str]) -> Float:
    """Sigmas in the order of the outputs; a channel that no recording has gets 1 (its residuals are all missing)."""
    return np.array([sigmas.get(name, 1.0) for name in output_names])
