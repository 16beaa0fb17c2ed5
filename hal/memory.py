"""A few lines that outlive the power: kept whole or as they were, never half.

A record goes to a neighbour first, which is forced to the medium and then takes the name in one step; the folder is
forced too, so that after `write` has returned a cut of the power cannot take the record back. A check sum tells
a damaged record from a true one.
"""

from __future__ import annotations

import os
import zlib
from pathlib import Path

from hal.errors import DeviceClosed, DeviceError, ReadFailed


class VolatileMemory:
    """Forgets with the process; for boards that keep nothing."""

    def __init__(self) -> None:
        self._text = ""
        self._closed = False

    def read(self) -> str:
        """The newest record; empty when there is none."""
        _require_open(self._closed)
        return self._text

    def write(self, text: str) -> None:
        """Keep this record instead."""
        _require_open(self._closed)
        self._text = text

    def close(self) -> None:
        """No more reading or writing. May be called again."""
        self._closed = True


class FileMemory:
    """One record in a file."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._closed = False

    def read(self) -> str:
        """The newest record; empty when there never was one. Raises `ReadFailed` when it is damaged."""
        _require_open(self._closed)
        try:
            data = self._path.read_bytes()
        except FileNotFoundError:
            return ""
        except OSError as error:
            raise ReadFailed(f"{self._path}: cannot be read ({error.strerror})") from error
        head, _, body = data.partition(b"\n")
        if head != _check(body):
            raise ReadFailed(f"{self._path}: the record is damaged (its check sum is wrong)")
        return body.decode()

    def write(self, text: str) -> None:
        """Keep this record instead; returns when it is on the medium. Raises `DeviceError` when it cannot."""
        _require_open(self._closed)
        body, part = text.encode(), self._path.with_name(f".{self._path.name}.new")
        try:
            with part.open("wb") as stream:
                stream.write(_check(body) + b"\n" + body)
                stream.flush()
                os.fsync(stream.fileno())
            part.replace(self._path)
            folder = os.open(self._path.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)
        except OSError as error:
            raise DeviceError(f"{self._path}: cannot be written ({error.strerror})") from error

    def close(self) -> None:
        """No more reading or writing. May be called again."""
        self._closed = True


def _require_open(closed: bool) -> None:
    if closed:
        raise DeviceClosed("memory: used after it was closed")


def _check(body: bytes) -> bytes:
    return b"%08x" % zlib.crc32(body)
