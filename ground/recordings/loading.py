"""Recordings from whatever holds them: files of any container, patterns, folders."""

from __future__ import annotations

import glob
from collections.abc import Iterable, Iterator
from pathlib import Path

from ground.recordings.csv_pair import CSV_SUFFIXES, main_table_of, read_csv_pair, sidecar_of, write_csv_pair
from ground.recordings.mcap_file import is_flight_log, read_mcap_recording, write_mcap
from ground.recordings.model import Recording, RecordingError

SUFFIXES = (*CSV_SUFFIXES, ".mcap")


def load_recording(path: Path | str, recover: bool = False) -> Recording:
    """Read one recording; the suffix says the container (.csv, .csv.gz, their .yaml, or .mcap).

    `recover` takes the whole part of an MCAP file that was cut. Raises `RecordingError`.
    """
    path = Path(path)
    if path.name.endswith(".mcap"):
        return read_mcap_recording(path, recover)
    if path.name.endswith((*CSV_SUFFIXES, ".yaml")):
        return read_csv_pair(path)
    raise RecordingError(f"{path}: a recording ends in {', '.join(SUFFIXES)}")


def save_recording(recording: Recording, path: Path | str) -> Path:
    """Write one recording, whole or not at all; the suffix says the container. Returns the path."""
    path = Path(path)
    if path.name.endswith(".mcap"):
        return write_mcap(recording, path)
    if path.name.endswith(CSV_SUFFIXES):
        return write_csv_pair(recording, path)
    raise RecordingError(f"{path}: a recording is written to {', '.join(SUFFIXES)}")


def load_recordings(paths: Iterable[Path | str]) -> tuple[Recording, ...]:
    """Read all recordings that files, patterns (`runs/*.csv`) and folders name.

    A folder's flight logs are passed over: they hold a mission, not a recording. A run must come only once: the
    same `run` from two files raises `RecordingError`, as does a file named twice. A CSV and its own sidecar are one
    recording.
    """
    found: dict[Path, Path] = {}
    for given in _without_repeats(Path(path) for path in paths):
        for path in _expand(given):
            main = _main_file(path)
            found.setdefault(main.resolve(), main)
    if not found:
        raise RecordingError("no recording was named")
    recordings = tuple(load_recording(path) for path in found.values())
    runs: dict[str, Recording] = {}
    for recording in recordings:
        first = runs.setdefault(recording.run, recording)
        if first is not recording:
            raise RecordingError(f"{recording.source}: run {recording.run!r} is in {first.source} already")
    return recordings


def _without_repeats(paths: Iterable[Path]) -> Iterator[Path]:
    seen: set[Path] = set()
    for path in paths:
        if path in seen:
            raise RecordingError(f"{path}: is named twice")
        seen.add(path)
        yield path


def _expand(path: Path) -> list[Path]:
    """The files of a folder, of a pattern, or the file itself."""
    if path.is_dir():
        files = sorted(file for file in path.iterdir() if file.name.endswith(SUFFIXES) and file.is_file())
        files = [file for file in files if file.suffix != ".mcap" or not is_flight_log(file)]
        what = "the folder holds no recording"
    elif glob.has_magic(str(path)) and not path.exists():
        names = glob.glob(str(path), recursive=True)  # noqa: PTH207 - Path.glob takes no absolute pattern
        files = sorted(Path(name) for name in names)
        what = "no file fits the pattern"
    else:
        return [path]
    if not files:
        raise RecordingError(f"{path}: {what}")
    return files


def _main_file(path: Path) -> Path:
    """The file that stands for the recording: tables that share a sidecar are one recording."""
    if path.name.endswith(".yaml"):
        return main_table_of(path)
    if not path.name.endswith(CSV_SUFFIXES):
        return path
    sidecar = sidecar_of(path)
    return main_table_of(sidecar) if path.is_file() and sidecar.is_file() else path
