"""Public recordings by name: address, checksum and licence stand in `config/data_sets.yaml`."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from ground.progress import Show, nobody
from hal.config import Limits, config_path, load_settings
from hal.errors import ConfigError


class FetchError(ConfigError):
    """A file could not be had, or is not what its checksum says."""


@dataclass(frozen=True)
class RemoteFile:
    """A file's address and the SHA-256 of its content, in hexadecimal."""

    url: str
    sha256: str


@dataclass(frozen=True)
class DataSet:
    """A public data set: title, licence, files by name, and the mapping (config/imports) that reads them."""

    title: str
    licence: str
    files: dict[str, RemoteFile]
    import_with: str | None = None


@dataclass(frozen=True)
class DataSets:
    """The table of all data sets."""

    format: Annotated[int, Limits(1, 1)]
    data_sets: dict[str, DataSet]


def known_sets(table: Path | None = None) -> dict[str, DataSet]:
    """The data sets of a table (default: config/data_sets.yaml). Raises `ConfigError` for a faulty one."""
    path = table or config_path("data_sets.yaml")
    found = load_settings(path, DataSets).data_sets
    for name, one in found.items():
        for file, remote in one.files.items():
            if not re.fullmatch(r"[0-9a-f]{64}", remote.sha256):
                raise ConfigError(
                    f"{path}: data_sets.{name}.files.{file}.sha256 is no SHA-256 in hexadecimal"
                )
            if Path(file).name != file:
                raise ConfigError(f"{path}: data_sets.{name}.files.{file}: a plain file name is needed")
    return found


def fetch(name: str, folder: Path, table: Path | None = None, show: Show = nobody) -> list[Path]:
    """Fetch a data set's files into a folder; those that are there already with the right checksum stay.

    Raises `ConfigError` for an unknown name, `FetchError` when a file cannot be had or is another one.
    """
    import pooch  # a third of a second, and only this command needs it

    sets = known_sets(table)
    if name not in sets:
        raise ConfigError(f"data set {name!r} is not known; known: {', '.join(sets)}")
    pooch.get_logger().setLevel("ERROR")
    paths = []
    for file, remote in sets[name].files.items():
        try:
            load = pooch.HTTPDownloader(progressbar=_Loaded(show, f"fetching {remote.url}"))
            found = pooch.retrieve(remote.url, f"sha256:{remote.sha256}", file, folder, downloader=load)
            paths.append(Path(found))
        except ValueError as error:
            raise FetchError(f"{remote.url}: is not the file that the table knows ({error})") from error
        except OSError as error:  # of requests and of the file system
            raise FetchError(f"{remote.url}: cannot be fetched ({error})") from error
    return paths


class _Loaded:
    """What pooch tells of a download, as a share of its bytes; `total` is set by pooch."""

    total = 0

    def __init__(self, show: Show, text: str) -> None:
        self._show, self._text, self._done = show, text, 0

    def update(self, more: int) -> None:
        """So many bytes more."""
        self._done += more
        self._show(self._text, self._done / self.total if self.total else None)

    def reset(self) -> None:
        """From the start again."""
        self._done = 0

    def close(self) -> None:
        """All is there."""
