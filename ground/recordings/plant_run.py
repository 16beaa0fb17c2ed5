"""From a recording to what drives its simulation."""

from __future__ import annotations

from ground.recordings.model import Recording, RecordingError
from sim_hal.plant.simulate import Plant, Run

FIRST_SAMPLES = 20
"""Samples that an initial value given by a channel is smoothed from."""


def to_run(recording: Recording, plant: Plant) -> Run:
    """Inputs, events, conditions and known start of a recording; none of its measured outputs but the first samples.

    Raises `RecordingError` when the recording is not of this plant's kind or lacks one of its inputs.
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
    if not set(plant.structure.outputs) & set(recording.channels):
        wanted, known = ", ".join(plant.structure.outputs), ", ".join(recording.channels)
        raise RecordingError(
            f"{where}: no channel that {plant.name!r} predicts ({wanted}); channels here: {known}"
        )
    return Run(
        times_s=recording.times_s,
        inputs=inputs,
        events={event.name: event.time_s for event in reversed(recording.events)},
        known=recording.state,
        conditions=recording.conditions,
        first_samples={name: values[:FIRST_SAMPLES] for name, values in recording.channels.items()},
    )
