"""Writing files so that a reader never meets half of one."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from hal.config import config_path, config_root
from hal.errors import ConfigError


def write_atomic(path: Path, content: str | bytes) -> Path:
    """Write `content` (text as UTF-8) to `path`, whole or not at all; folders are made as needed.

    The content goes to a hidden neighbour first, which then takes the name in one step. Returns `path`.
    Raises `OSError` when the place cannot be written; the neighbour is then removed and `path` is untouched.
    """
    data = content.encode("utf-8") if isinstance(content, str) else content
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, "is a folder; name a file", str(path))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    except OSError as error:
        raise OSError(error.errno, _why_not(path, error), str(path)) from error
    part = Path(name)
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
        part.chmod(0o644)  # mkstemp keeps files private; a result is meant to be read
        part.replace(path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
    return path


def _why_not(path: Path, error: OSError) -> str:
    """Why a file or folder cannot be made at a path, without the name of the neighbour that was to become it."""
    files = [str(parent) for parent in path.parents if parent.is_file()]
    return (
        f"cannot be written ({files[0]} is no folder)" if files else f"cannot be written ({error.strerror})"
    )


def check_place(folder: Path, marker: str, results: Iterable[str]) -> None:
    """Refuse, before long work is begun, a folder that cannot take the files `results` at its end.

    Raises `ConfigError` when it is a file, cannot be written, or holds one of them that is no earlier result's:
    beside an earlier one stands the file `marker`.
    """
    if folder.exists() and not folder.is_dir():
        raise ConfigError(f"{folder}: is a file; name a folder for the results")
    foreign = [name for name in results if (folder / name).exists()]
    if foreign and not (folder / marker).is_file():
        raise ConfigError(f"{folder}: holds a {foreign[0]} that is no earlier result; choose another folder")
    there = next(parent for parent in (folder, *folder.absolute().parents) if parent.exists())
    try:
        tempfile.TemporaryDirectory(dir=there, prefix=f".{folder.name}.").cleanup()
    except OSError as error:
        raise ConfigError(f"{folder}: {_why_not(folder, error)}") from error


@contextmanager
def whole_folder(path: Path, marker: str) -> Iterator[Path]:
    """A new folder to fill, which takes the name `path` only when the block ends without an error.

    A folder that stands there already is replaced if it is empty or holds the file `marker`, so an earlier
    result of the same kind. Raises `ConfigError` when it holds anything else, or the place cannot be written.
    Folders above it that were made for it go again when the block fails.
    """
    if path.exists() and not (path.is_dir() and (not any(path.iterdir()) or (path / marker).is_file())):
        raise ConfigError(f"{path}: holds something else than an earlier result; choose another folder")
    absent = [folder for folder in path.parents if not folder.exists()]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        work = Path(tempfile.mkdtemp(dir=path.parent, prefix=f".{path.name}."))
    except OSError as error:
        _remove_empty(absent)
        raise ConfigError(f"{path}: {_why_not(path, error)}") from error
    try:
        yield work
        work.chmod(0o755)  # mkdtemp keeps folders private; a result is meant to be read
        _take_name(work, path)
    except BaseException:
        shutil.rmtree(work, ignore_errors=True)
        _remove_empty(absent)
        raise


def _remove_empty(folders: Iterable[Path]) -> None:
    """Remove those of the folders, the deepest first, that are there and hold nothing."""
    for folder in folders:
        with suppress(OSError):
            folder.rmdir()


def _take_name(work: Path, path: Path) -> None:
    """Rename `work` to `path`; what stood there is put aside first and removed last."""
    if not path.exists():
        work.rename(path)
        return
    old = Path(tempfile.mkdtemp(dir=path.parent, prefix=f".{path.name}.old."))
    path.replace(old)
    work.rename(path)
    shutil.rmtree(old)


def configured(kind: str, name: str) -> Path:
    """A file by path, or by its name in a folder of the configuration."""
    path = Path(name)
    if path.suffix in (".yaml", ".yml") or path.exists():
        return path
    try:
        return config_path(kind, f"{name}.yaml")
    except ConfigError as error:
        known = ", ".join(sorted(found.stem for found in (config_root() / kind).glob("*.yaml")))
        raise ConfigError(
            f"{name}: no such file, and no name in config/{kind}; names there: {known}"
        ) from error
