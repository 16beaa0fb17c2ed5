"""What a campaign is of: cases drawn by index and seed, flown or diagnosed somewhere, told as rows."""

from __future__ import annotations

import hashlib
import json
import threading
import time
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Protocol

from hal.errors import ConfigError

Row = dict[str, Any]
INDEX, FAILED = "index", "failed"
SHOWN_OF_ERROR = 500

_ROOT = Path(__file__).resolve().parents[2]
_CODE = ("flight", "hal", "sim_hal", "ground")
_one_at_a_time = threading.Lock()


class Study(Protocol):
    """Cases of one kind and one seed. Must be picklable: workers get it as it is.

    `run` gives the same row for an index in any process of any computer; the case's own random numbers come from
    `(seed, index)` alone. Rows hold what JSON and Parquet hold, under the names of `schema`.
    """

    @property
    def name(self) -> str:
        """Which study."""

    @property
    def seed(self) -> int:
        """Of all its cases."""

    def settings(self) -> object:
        """All that cases are drawn and flown with; its `repr` tells settings apart."""

    def schema(self) -> Any:
        """Columns of a row, a `pyarrow.Schema`, without `index` and `failed`."""

    def run(self, index: int) -> Row:
        """Draw the case of an index and do it. What it raises is kept as the case's failure."""

    def counts(self, row: Row) -> float:
        """How much of what is wanted a row is, also one that failed."""

    def most_cases(self, wanted: float) -> int | None:
        """How many cases are needed at most; None when only their rows can tell."""

    def suspicious(self, row: Row) -> bool:
        """Whether a row that did not fail is one to replay."""


@dataclass(frozen=True)
class Answer:
    """What a worker gives back: the row, and the time [s] that it took there."""

    row: Row
    seconds: float


class OtherWorkerError(Exception):
    """A worker whose settings or code are not those of the campaign."""


def stamp_of(study: Study) -> dict[str, Any]:
    """What all cases of one campaign share: study, seed, and digests of settings and code."""
    settings = hashlib.sha256(repr(study.settings()).encode()).hexdigest()[:16]
    return {"study": study.name, "seed": study.seed, "settings": settings, "code": code_digest()}


@cache
def code_digest() -> str:
    """Version and digest of all code that a case runs through."""
    digest = hashlib.sha256()
    for package in _CODE:
        for path in sorted((_ROOT / package).rglob("*.py")):
            digest.update(path.relative_to(_ROOT).as_posix().encode() + b"\0" + path.read_bytes())
    try:
        number = version("hopper-flight")
    except PackageNotFoundError:
        number = "0"
    return f"{number}-{digest.hexdigest()[:16]}"


def answer(study: Study, index: int, stamp: dict[str, Any]) -> Answer:
    """A case, in the worker. A case that fails is a row, too. Raises `OtherWorkerError`.

    One case at a time in each process, also where a cluster's worker has several threads: flown software and
    compiled plants are made for one.
    """
    with _one_at_a_time:
        here = _stamp_here(study)
        for key, value in stamp.items():
            if here[key] != value:
                raise OtherWorkerError(f"a worker has other {key} ({here[key]}) than the campaign ({value})")
        start = time.perf_counter()
        try:
            row = row_of(study, index)
        except Exception as error:  # whatever goes wrong in a case is a result of the campaign
            row = failed_row(index, f"{type(error).__name__}: {error}")
        return Answer(row, time.perf_counter() - start)


_stamps: dict[str, dict[str, Any]] = {}


def _stamp_here(study: Study) -> dict[str, Any]:
    key = repr(study)
    if key not in _stamps:
        _stamps[key] = stamp_of(study)
    return _stamps[key]


def row_of(study: Study, index: int) -> Row:
    """The row of a case as it is kept: plain lists and mappings, as they will be read again."""
    row: Row = json.loads(json.dumps({INDEX: index, FAILED: None, **study.run(index)}))
    return row


def failed_row(index: int, why: str) -> Row:
    """The row of a case that came to no result."""
    return {INDEX: index, FAILED: why[:SHOWN_OF_ERROR]}


def require_same(kept: dict[str, Any], wanted: dict[str, Any], where: Path) -> None:
    """Raises `ConfigError` when results kept in a folder are not of this campaign."""
    for key, value in wanted.items():
        if kept.get(key) != value:
            raise ConfigError(
                f"{where}: is of other {key} ({kept.get(key)}) than {value}; choose another folder"
            )
