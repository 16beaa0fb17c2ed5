"""Which recordings of a folder belong to a plant, and how much data they are."""

from __future__ import annotations

from collections.abc import Sequence

from ground.recordings.model import Recording, RecordingError
from ground.recordings.plant_run import to_run
from sim_hal.plant.simulate import Plant


def belonging(recordings: Sequence[Recording], plant: Plant) -> tuple[tuple[Recording, ...], tuple[str, ...]]:
    """The recordings that the plant can be simulated for, and of the others why not.

    Raises the first reason as `RecordingError` when none belongs to it.
    """
    kept: list[Recording] = []
    reasons: list[RecordingError] = []
    for recording in recordings:
        try:
            to_run(recording, plant)
            kept.append(recording)
        except RecordingError as error:
            reasons.append(error)
    if recordings and not kept:
        raise reasons[0]
    return tuple(kept), tuple(map(str, reasons))


def amount(recordings: Sequence[Recording], single: bool = False) -> str:
    """How much data there is (parts of a `single` recording, or recordings), and what more of it would bring."""
    samples = sum(recording.times_s.size for recording in recordings)
    seconds = sum(float(recording.times_s[-1] - recording.times_s[0]) for recording in recordings)
    runs = "1 recording" if single or len(recordings) == 1 else f"{len(recordings)} recordings"
    return (
        f"Data: {runs}, {samples} samples over {seconds:.4g} s. Half the sigmas take four times as much of the same "
        "kind; what the runs never excite, no amount tells."
    )
