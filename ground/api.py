"""For notebooks and scripts: load recordings, simulate, diagnose, fly, plot. Everything here stays as it is named.

    from ground.api import diagnose, fly, load, plant, plot, simulate

Figures are Plotly's and show themselves in a notebook; recordings hold NumPy arrays.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from flight import settings as flight_settings
from ground.diagnose import pipeline
from ground.diagnose.pipeline import Outcome, write_outcome
from ground.diagnose.segments import channel_sigmas, segment_of, sigma_vector
from ground.diagnose.verify import predict
from ground.files import configured
from ground.importing import import_recordings
from ground.mission_run import plan_mission, run_mission
from ground.mission_summary import MissionRun
from ground.progress import steps_of
from ground.recordings import Recording, RecordingError, load_recordings, save_recording
from ground.recordings.open_starts import with_open_starts
from ground.report.page import BLUE, GREEN, ORANGE, RED, VIOLET
from sim_hal.plant.simulate import Plant, compile_plant, load_plant, save_plant

__all__ = [
    "MissionRun",
    "Outcome",
    "Plant",
    "Recording",
    "diagnose",
    "fly",
    "load",
    "plant",
    "plot",
    "save_plant",
    "save_recording",
    "simulate",
]

COLOURS = (BLUE, ORANGE, GREEN, VIOLET, RED)
ROW_HEIGHT = 190


def load(*paths: str | Path, mapping: str | Path | None = None) -> tuple[Recording, ...]:
    """Recordings of files, patterns or folders; foreign files by a mapping (a file, or a name in config/imports).

    Raises `RecordingError` naming file and place.
    """
    if mapping is None:
        return load_recordings(paths)
    plan = configured("imports", str(mapping))
    return tuple(recording for path in paths for recording in import_recordings(Path(path), plan))


def plant(name: str | Path) -> Plant:
    """A plant by its file, or its name in config/plant. Raises `PlantError` or `ConfigError`."""
    return load_plant(configured("plant", str(name)))


def simulate(model: Plant, recording: Recording) -> Recording:
    """What the plant predicts for a recording's run, at its sample times, from inputs, conditions and known start.

    A start that the plant leaves to be fitted is read from the recording's first samples, and nothing else that was
    measured. Raises `RecordingError` for a recording that cannot drive the plant.
    """
    if recording.times_s.size < 2:
        raise RecordingError(f"{recording.source or recording.run}: one sample is no run; two are the least")
    model = with_open_starts(model, [recording])
    compiled = compile_plant(model)
    sigmas = sigma_vector(channel_sigmas([recording], model, compiled.output_names), compiled.output_names)
    segment = segment_of(recording, model, compiled)
    outputs = predict(
        model, segment, np.where(sigmas > 0.0, sigmas, 1.0)
    )  # a channel that stands still has none
    channels = {name: outputs[:, i] for i, name in enumerate(compiled.output_names)}
    return replace(
        recording, channels=channels, sensors={}, extra_tables={}, notes=f"predicted by {model.name}"
    )


def diagnose(
    recordings: Sequence[Recording],
    model: Plant,
    *,
    out: str | Path | None = None,
    compare: Plant | None = None,
    processes: int = 1,
    show: Callable[[str], None] = lambda text: None,
) -> Outcome:
    """What physics the plant lacks, by recordings: `Outcome.diagnosis`, `.plant` (extended), `.evidence`.

    `out` is a folder for page, plant and JSON; `compare` a plant with published values; `show` is told each step.
    Raises `DiagnosisError` when the recordings cannot be diagnosed with this plant.
    """
    outcome = pipeline.diagnose(tuple(recordings), model, steps_of(show), compare, processes=processes)
    if out is not None:
        write_outcome(outcome, Path(out))
    return outcome


def fly(
    surface: str = "quartz_sand",
    hops: int = 1,
    energy_j: float = 18.0,
    *,
    out: str | Path,
    seed: int = 1,
    references: int = 1,
) -> MissionRun:
    """Fly a simulated mission by the flight software; log, recordings and page go to the folder `out`.

    `MissionRun.hops` hold each hop's report, truth and recordings. Raises `ConfigError` for what cannot be flown.
    """
    plan = plan_mission(surface, hops, energy_j, flight_settings.load(), references=references)
    return run_mission(plan, Path(out), seed=seed)


def plot(*recordings: Recording, channels: Sequence[str] | None = None) -> go.Figure:
    """Recordings over each other, a row for each channel: those named, or all of the first recording.

    Raises `RecordingError` for a channel that none of them has.
    """
    names = list(channels or recordings[0].channels)
    figure = make_subplots(rows=len(names), shared_xaxes=True, vertical_spacing=0.04)
    for row, name in enumerate(names, start=1):
        having = [(i, each) for i, each in enumerate(recordings) if name in each.channels]
        if not having:
            known = ", ".join(recordings[0].channels)
            raise RecordingError(f"no recording has the channel {name!r}; known: {known}")
        for index, recording in having:
            values = recording.channels[name]
            there = np.isfinite(values)
            figure.add_scatter(
                x=recording.times_s[there],
                y=values[there],
                name=f"{recording.run} ({recording.notes or 'measured'})",
                legendgroup=str(index),
                showlegend=row == 1,
                line={"color": COLOURS[index % len(COLOURS)], "width": 1.4},
                row=row,
                col=1,
            )
        figure.update_yaxes(title=name, row=row, col=1)
    figure.update_xaxes(title="time [s]", row=len(names), col=1)
    return figure.update_layout(height=120 + ROW_HEIGHT * len(names), template="plotly_white")
