"""Windows that a rig given as equations is looked at in, each anchored anew at its first samples.

They are long enough to carry the slow parts of the motion, and short enough for the plant to follow: one that falls
over when run free (a magnet's gap, an upright pendulum) leaves what was recorded whatever its model.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ground.diagnose.segments import Segment, cut_recording, is_open, segment_of, spans, starts_anywhere
from ground.recordings.model import Recording
from ground.recordings.plant_run import to_run, unread_starts
from sim_hal.plant.simulate import CompiledPlant, Plant, SimulationError

Float = NDArray[np.float64]

WINDOWS_WANTED = 16
"""Windows over all recordings: enough to bootstrap over, long enough to carry the slow parts of the motion."""
MIN_WINDOW_SAMPLES = 100
LEAST_WINDOW_SAMPLES = 16
FAR_AWAY = 3.0
"""Times the range of what was read that a simulation from a window's start may stray in it, and ..."""
NUDGE = 1e-3
RUNS_AWAY = 17.0
"""... a window is shortened, too, where a nudge of its start moves the readings this much more by a time than by half
of it."""
MOST_WINDOWS = 48
"""Windows kept of those that had to be shortened, spread over the recordings: each has a start to fit."""
MOST_SAMPLES = 20_000
"""More samples than this teach a fit of few parameters nothing that is worth the wait: windows are then shortened
(spread over the recordings as before), or thinned out where no input acts between samples."""


def segments_to_fit(
    recordings: Sequence[Recording], plant: Plant, compiled: CompiledPlant
) -> tuple[Segment, ...]:
    """The stretches that a fit uses: windows of an equation rig that can start at any sample, else whole runs.

    A window at whose beginning nothing was measured that tells where it starts is left out.
    """
    if plant.kind != "equations" or not starts_anywhere(compiled):
        return tuple(segment_of(recording, plant, compiled) for recording in recordings)
    windows = followed_windows(recordings, plant, compiled)
    parts = [part for part in windows if not unread_starts(part.channels, plant)] or windows[:1]
    samples = sum(part.times_s.size for part in parts)
    if samples > MOST_SAMPLES:
        share = MOST_SAMPLES / samples
        parts = [
            shortened(part, share) if plant.structure.inputs else thinned_out(part, share) for part in parts
        ]
    return tuple(segment_of(part, plant, compiled) for part in parts)


def runs_away(recordings: Sequence[Recording], plant: Plant, compiled: CompiledPlant) -> bool:
    """Whether the plant, run free, soon leaves what was recorded whatever its model: only short windows tell."""
    if plant.kind != "equations" or not starts_anywhere(compiled):
        return False
    windows = windows_of(recordings)
    return followed_windows(recordings, plant, compiled)[0].times_s.size < windows[0].times_s.size


def followed_windows(
    recordings: Sequence[Recording], plant: Plant, compiled: CompiledPlant
) -> list[Recording]:
    """Windows that the plant can follow: halved, as often as needed, where it runs away from its start."""
    finer = 1
    windows = windows_of(recordings)
    reach = FAR_AWAY * reaches(recordings, compiled.output_names)
    while finer == 1 or min(part.times_s.size for part in windows) >= 2 * LEAST_WINDOW_SAMPLES:
        if all(is_followed(part, plant, compiled, reach) for part in windows):
            break
        finer *= 2
        windows = windows_of(recordings, finer)
    return windows if finer == 1 else spread(windows, MOST_WINDOWS)


def spread(windows: Sequence[Recording], most: int) -> list[Recording]:
    """At most that many of the windows, evenly spread."""
    chosen = np.unique(np.linspace(0, len(windows) - 1, min(most, len(windows))).round().astype(int))
    return [windows[i] for i in chosen]


def reaches(recordings: Sequence[Recording], names: Sequence[str]) -> Float:
    """Largest less smallest reading of each output over all recordings, (outputs,); infinite where none was read."""
    read = [[r.channels[name] for r in recordings if name in r.channels] for name in names]
    found = [spans(np.concatenate(one)[:, None])[0] if one else 0.0 for one in read]
    return np.array([span if span > 0.0 else math.inf for span in found])


def is_followed(window: Recording, plant: Plant, compiled: CompiledPlant, reach: Float) -> bool:
    """Whether the plant gets through a window without running away in it from where it starts.

    It has if an output gets further than `reach` (outputs,) from its start, or a start that is a little off
    runs away: what grows as a power of time, up to the fourth, does not.
    """
    if unread_starts(window.channels, plant):
        return True
    run = to_run(window, plant)
    halves = [run.times_s.size >> k for k in range(5) if run.times_s.size >> k >= LEAST_WINDOW_SAMPLES // 2]
    try:
        start = compiled.initial_values(compiled.values, run)
        here = compiled.run(compiled.values, run, start)
        if (np.abs(here - here[0]).max(axis=0) > reach).any():
            return False
        for name in filter(lambda name: is_open(plant.structure.states[name]), plant.structure.states):
            off = {**start, name: start[name] + NUDGE * (abs(start[name]) or 1.0)}
            moved = np.abs(compiled.run(compiled.values, run, off) - here)
            reached = [moved[:count].max(axis=0) for count in halves]
            if any(((late > RUNS_AWAY * early) & (early > 0.0)).all() for late, early in pairwise(reached)):
                return False
    except SimulationError:
        return False
    return True


def windows_of(recordings: Sequence[Recording], finer: int = 1) -> list[Recording]:
    """Recordings cut into windows of equal length, each anchored anew; into `finer` times as many, if so wanted."""
    parts = []
    per_recording = math.ceil(WINDOWS_WANTED / len(recordings))
    for recording in recordings:
        count = finer * max(1, min(per_recording, recording.times_s.size // MIN_WINDOW_SAMPLES))
        edges = np.linspace(0, recording.times_s.size, count + 1).round().astype(int)
        parts += [cut_recording(recording, int(a), int(b)) for a, b in pairwise(edges)]
    return parts


def shortened(recording: Recording, share: float) -> Recording:
    """The first `share` of a window: an input acts between samples, so none may be left out in between."""
    return cut_recording(recording, 0, max(MIN_WINDOW_SAMPLES, int(share * recording.times_s.size)))


def thinned_out(recording: Recording, share: float) -> Recording:
    """Every n-th sample of a run without inputs, about `share` of them."""
    every = slice(0, None, math.ceil(1.0 / share))
    channels = {name: values[every] for name, values in recording.channels.items()}
    return replace(recording, times_s=recording.times_s[every], channels=channels)
