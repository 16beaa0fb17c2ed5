"""`hopper simulate`, `import` and `convert`: recordings in and out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from ground import api, console
from ground.files import configured
from ground.importing import import_recordings
from ground.recordings.loading import load_recording, save_recording
from ground.recordings.model import Recording, RecordingError
from ground.sampling import sampling
from sim_hal.plant.simulate import load_plant

recordings_app = typer.Typer()

Json = Annotated[bool, typer.Option("--json", help="Print the answer as JSON, for machines.")]
PlantOption = Annotated[str, typer.Option("--plant", help="Plant file, or a name in config/plant.")]
MapOption = Annotated[
    str | None, typer.Option("--map", help="Mapping file (or name) to import foreign files.")
]


@recordings_app.command()
def simulate(
    plant: PlantOption,
    like: Annotated[Path, typer.Option(help="Recording whose run is simulated.")],
    out: Annotated[Path, typer.Option("--out", help="Predicted channels: CSV, CSV.gz or MCAP.")],
    mapping: MapOption = None,
    as_json: Json = False,
) -> None:
    """Simulate one recording's run: its inputs, conditions and known start, never its measured outputs.

    A start that the plant leaves to be fitted is read from the recording's first samples.
    """
    with console.clear_errors():
        recordings = api.load(like, mapping=mapping)
        if len(recordings) != 1:
            raise RecordingError(f"{like}: holds {len(recordings)} recordings; name the one to simulate")
        if out.resolve() == like.resolve():
            raise RecordingError(f"{out}: is the recording that is simulated; choose another name")
        predicted = api.simulate(load_plant(configured("plant", plant)), recordings[0])
        save_recording(predicted, out)
    say_written(out, predicted, as_json)


@recordings_app.command("import")
def import_command(
    file: Annotated[Path, typer.Argument(help="MAT or CSV file of any lab.")],
    mapping: Annotated[str, typer.Option("--map", help="Mapping file, or a name in config/imports.")],
    out: Annotated[
        Path, typer.Option("--out", help="Recording to write: CSV, CSV.gz or MCAP; or a folder for several.")
    ],
    as_json: Json = False,
) -> None:
    """Turn a foreign file into a recording, or several, and say how evenly it was sampled."""
    with console.clear_errors():
        found = import_recordings(file, configured("imports", mapping))
        several = len(found) > 1 or not out.suffix
        if several:
            out.mkdir(parents=True, exist_ok=True)
        written = {out / f"{each.run}.csv.gz" if several else out: each for each in found}
        for path, recording in written.items():
            save_recording(recording, path)
    if as_json:
        console.print_json([written_content(path, recording) for path, recording in written.items()])
        return
    for path, recording in written.items():
        console.say(f"{written_words(path, recording)}; {sampling(recording.times_s)}")


@recordings_app.command()
def convert(
    recording: Annotated[Path, typer.Argument(help="Recording to read: CSV pair or MCAP.")],
    out: Annotated[Path, typer.Argument(help="Recording to write; its suffix says as what.")],
    as_json: Json = False,
) -> None:
    """Copy a recording from one container to another, without loss."""
    with console.clear_errors():
        found = load_recording(recording)
        if out.resolve() == recording.resolve():
            raise RecordingError(f"{out}: is the recording that is read; choose another name")
        save_recording(found, out)
    say_written(out, found, as_json)


def say_written(path: Path, recording: Recording, as_json: bool) -> None:
    """Say what was written, to a person or a machine."""
    if as_json:
        console.print_json(written_content(path, recording))
    else:
        console.say(written_words(path, recording))


def written_content(path: Path, recording: Recording) -> dict[str, Any]:
    """A file with its channels and samples, as JSON-able data."""
    return {"file": str(path), "channels": list(recording.channels), "samples": recording.times_s.size}


def written_words(path: Path, recording: Recording) -> str:
    """The same in words."""
    return f"{path}: {', '.join(recording.channels)}, {recording.times_s.size} samples"
