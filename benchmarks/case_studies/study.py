"""What a case study is made of: a YAML file in `config/case_studies`, and the recordings that it names."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from ground.importing import import_recordings
from ground.recordings.model import Recording, RecordingError
from hal.config import Limits, config_path, load_settings
from sim_hal.plant.simulate import Plant, load_plant


@dataclass(frozen=True)
class Source:
    """Files of the data set (a pattern in its folder) and the mapping that imports them."""

    files: str
    map: str


@dataclass(frozen=True)
class Published:
    """A published figure to set beside what was found; the name is a flat parameter name of the extended plant."""

    value: float
    unit: str
    source: str


@dataclass(frozen=True)
class Group:
    """Recordings that belong together (their run's name begins with `runs`), and the plant's numbers for them."""

    runs: str
    values: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Study:
    """A case study as its file states it; `window_samples` is how far predictions are judged without a new anchor."""

    format: Annotated[int, Limits(1, 1)]
    title: str
    about: str
    plant: str
    recordings: tuple[Source, ...]
    window_samples: Annotated[int, Limits(20)]
    unseen: tuple[Source, ...] = ()
    published: str | None = None
    beside: dict[str, Published] = field(default_factory=dict)
    groups: dict[str, Group] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()


def load_study(name: str) -> Study:
    """The study of `config/case_studies/NAME.yaml`."""
    return load_settings(config_path("case_studies", f"{name}.yaml"), Study)


def read(sources: tuple[Source, ...], folder: Path) -> tuple[Recording, ...]:
    """All recordings of a data set's folder. Raises `RecordingError` when a pattern finds nothing."""
    found: list[Recording] = []
    for source in sources:
        files = sorted(folder.glob(source.files), key=lambda path: (len(path.name), path.name))
        if not files:
            raise RecordingError(f"{folder}: holds no {source.files}")
        for file in files:
            found += import_recordings(file, config_path("imports", f"{source.map}.yaml"))
    return tuple(found)


def plant_of(study: Study, group: Group | None) -> Plant:
    """The plant as its first author would write it, with the numbers of a group."""
    plant = load_plant(config_path("plant", f"{study.plant}.yaml"))
    return plant.with_values(group.values) if group else plant
