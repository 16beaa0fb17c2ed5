"""Machine code in place of a package's sources, where `hopper compile` has made it of just these sources.

Translated modules do the same to the bit, in less than half the time. A package that has some calls `prefer` as it is
imported. Where a source was changed since, or the environment says HOPPER_COMPILED=0, the sources run.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import os
import sys
from collections.abc import MutableSequence
from functools import cache
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

SWITCH = "HOPPER_COMPILED"
MANIFEST = "manifest.json"
SUFFIX = EXTENSION_SUFFIXES[0]
"""Of extension modules of this Python on this kind of computer."""


def prefer(package: str, path: MutableSequence[str]) -> bool:
    """Let a package find its machine code first, if there is any of its present sources; whether there is.

    `path` is the package's `__path__`. The machine code is all taken or none: its modules call one another directly.
    """
    if os.environ.get(SWITCH) == "0":
        return False
    folder = folder_of(Path(path[0]))
    try:
        if not fits(Path(path[0])):
            return False
        _load(library_of(package), folder / f"{library_of(package)}{SUFFIX}")
    except (OSError, ImportError):  # it is damaged
        return False
    path.insert(0, str(folder))
    return True


def fits(package: Path) -> bool:
    """Whether there is machine code of the present sources of a package."""
    try:
        manifest = (folder_of(package) / MANIFEST).read_text(encoding="utf-8")
        return bool(json.loads(manifest) == made_of(package))
    except (OSError, ValueError):
        return False


def folder_of(package: Path) -> Path:
    """Where the machine code of a package is kept: beside its sources where one may write, else in the cache."""
    beside, kind = package / "__pycache__", f"machine_code{SUFFIX.rpartition('.')[0]}"
    if (beside / kind).exists() or os.access(beside if beside.exists() else package, os.W_OK):
        return beside / kind
    cached = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "hopper"
    return cached / hashlib.sha256(bytes(package)).hexdigest()[:16] / kind


def group_of(package: str) -> str:
    """Name under which mypyc translates the modules of a package together."""
    return f"{package}_machine_code"


def library_of(package: str) -> str:
    """Name of the module that all translated modules of a package share."""
    return f"{group_of(package)}__mypyc"


def made_of(package: Path) -> dict[str, str]:
    """Checksums of the sources that machine code of a package depends on: its own, and those of `hal`."""
    return {"package": _checksum(package), "hal": _checksum(package.parent / "hal")}


@cache
def _checksum(package: Path) -> str:
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        digest.update(f"{path.relative_to(package)} {path.stat().st_size}\n".encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _load(name: str, path: Path) -> None:
    """Import an extension module that lies outside the search path."""
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path} is no extension module")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    sys.modules[name] = module
