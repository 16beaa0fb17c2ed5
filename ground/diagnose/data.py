"""What is diagnosed: recordings of a rig, split into what is fitted and what is held out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ground.diagnose.segments import (
    Segment,
    channel_sigmas,
    last_part,
    segment_of,
    sensor_sigma,
    sigma_vector,
    split_last_part,
    starts_anywhere,
)
from ground.diagnose.windows import runs_away, segments_to_fit
from ground.recordings.model import Recording
from sim_hal.plant.simulate import Plant, compile_plant

Float = NDArray[np.float64]

HELD_OUT_SHARE = 0.25
"""Last part of a single recording that the fit never sees."""
LEAST_SAMPLES = 30


class DiagnosisError(ValueError):
    """The recordings cannot be diagnosed with this plant; the message says why and what to do."""


@dataclass(frozen=True)
class Data:
    """Recordings split into what is fitted and what is held out, as segments of the plant."""

    fitted: tuple[Recording, ...]
    held_out: tuple[Recording, ...]
    windows: tuple[Segment, ...]
    whole: tuple[Segment, ...]
    held_out_whole: tuple[Segment, ...]
    held_out_windows: tuple[Segment, ...]
    sigmas: Float
    noise: Mapping[str, float]
    single: bool
    by_windows: bool  # the plant runs away when run free: what is held out is judged in windows alone

    def finer(self, names: Sequence[str]) -> Float:
        """How many times finer each sensor is than the plant is judged, (outputs,), outputs named in order."""
        noise = np.array([self.noise.get(name, math.nan) for name in names])
        return np.where(noise > 0.0, self.sigmas / np.where(noise > 0.0, noise, 1.0), 1.0)


def prepare(recordings: Sequence[Recording], plant: Plant) -> Data:
    """Split whole recordings into fitted and held out; one recording alone gives its last part away."""
    for recording in recordings:
        if recording.times_s.size < LEAST_SAMPLES:
            raise DiagnosisError(
                f"{recording.source or recording.run}: {recording.times_s.size} samples; a diagnosis needs at least "
                f"{LEAST_SAMPLES} in each recording"
            )
    if not recordings:
        raise DiagnosisError("no recordings were given")
    if len(recordings) == 1:
        first, last = split_last_part(recordings[0], HELD_OUT_SHARE)
        fitted: tuple[Recording, ...] = (first,)
        held_out: tuple[Recording, ...] = (last,)
    else:
        fitted, held_out = split_whole(recordings)
    compiled = compile_plant(plant)
    names = compiled.output_names
    sigmas = channel_sigmas(fitted, plant, names)
    still = [name for name, sigma in sigmas.items() if not sigma > 0.0]
    if still:
        raise DiagnosisError(
            f"channel {still[0]!r} reads the same in every recording that is fitted, and nothing says how finely: "
            "state noise_std or resolution under sensors, or leave the channel out"
        )
    windows = segments_to_fit(held_out, plant, compiled)
    whole = tuple(segment_of(recording, plant, compiled) for recording in held_out)
    by_windows = runs_away(held_out, plant, compiled)
    if by_windows:
        whole = windows
    if len(recordings) == 1 and not starts_anywhere(compiled):
        windows = whole = (last_part(recordings[0], plant, compiled, HELD_OUT_SHARE),)
    return Data(
        fitted=fitted,
        held_out=held_out,
        windows=segments_to_fit(fitted, plant, compiled),
        whole=tuple(segment_of(r, plant, compiled) for r in fitted),
        held_out_whole=whole,
        held_out_windows=windows,
        sigmas=sigma_vector(sigmas, names),
        noise={name: sensor_sigma(fitted, plant, name) for name in sigmas},
        single=len(recordings) == 1,
        by_windows=by_windows,
    )


def split_whole(
    recordings: Sequence[Recording],
) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    """A quarter of the recordings, at least one, held out: the last whose surface the others have met as well."""
    wanted = max(1, len(recordings) // 4)
    surfaces = [str(recording.conditions.get("surface", "")) for recording in recordings]
    held: list[int] = []
    for number in reversed(range(len(recordings))):
        rest = [s for i, s in enumerate(surfaces) if i != number and i not in held]
        if len(held) < wanted and surfaces[number] in rest:
            held.append(number)
    held = held or [len(recordings) - 1]
    fitted = tuple(r for i, r in enumerate(recordings) if i not in held)
    return fitted, tuple(recordings[i] for i in sorted(held))
