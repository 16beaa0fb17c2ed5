"""From a recording to what drives its simulation."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ground.recordings.model import Recording, RecordingError
from sim_hal.plant.simulate import Plant, Run

FIRST_SAMPLES = 20
"""Samples that an initial value given by a channel is smoothed from."""


def to_run(recording: Recording, plant: Plant) -> Run:
    """Inputs, events, conditions and known start of a recording; none of its measured outputs but the first samples.

    Raises `RecordingError` when the recording is not of this plant's kind, lacks one of its inputs, or has no reading
    where a start is read from.
    """
    where = str(recording.source or recording.run)
    if plant.kind != "equations" and recording.kind != plant.kind:
        raise RecordingError(
            f"{where}: kind is {recording.kind!r}, the plant {plant.name!r} is of kind {plant.kind!r}"
        )
    inputs = {}
    for name in plant.structure.inputs:
        if name not in recording.channels:
            known = ", ".join(recording.channels)
            raise RecordingError(
                f"{where}: the plant {plant.name!r} needs the input {name!r}; channels here: {known}"
            )
        inputs[name] = recording.channels[name]
        if np.isnan(inputs[name]).all():
            raise RecordingError(f"{where}: the input {name!r} has no reading at all, every cell is empty")
    if not set(plant.structure.outputs) & set(recording.channels):
        wanted, known = ", ".join(plant.structure.outputs), ", ".join(recording.channels)
        raise RecordingError(
            f"{where}: no channel that {plant.name!r} predicts ({wanted}); channels here: {known}"
        )
    for channel in unread_starts(recording.channels, plant):
        raise RecordingError(
            f"{where}: a start is read from the first {FIRST_SAMPLES} samples of {channel!r} (plant {plant.name!r}), "
            "and these are all missing"
        )
    return Run(
        times_s=recording.times_s,
        inputs=inputs,
        events={event.name: event.time_s for event in reversed(recording.events)},
        known=recording.state,
        conditions=recording.conditions,
        first_samples={name: values[:FIRST_SAMPLES] for name, values in recording.channels.items()},
        origin_s=recording.origin_s,
    )


def unread_starts(channels: Mapping[str, NDArray[np.float64]], plant: Plant) -> list[str]:
    """Channels that give a state's start, and whose first samples are all missing."""
    wanted = {name.removeprefix("first(").removesuffix(")") for name in plant.structure.known if "(" in name}
    return sorted(name for name in wanted & channels.keys() if np.isnan(channels[name][:FIRST_SAMPLES]).all())
