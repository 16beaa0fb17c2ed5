"""Recordings: one run of a rig, whatever container holds it."""

from ground.recordings.loading import load_recording, load_recordings, save_recording
from ground.recordings.model import Event, Recording, RecordingError, SensorSpec, Table

__all__ = [
    "Event",
    "Recording",
    "RecordingError",
    "SensorSpec",
    "Table",
    "load_recording",
    "load_recordings",
    "save_recording",
]
