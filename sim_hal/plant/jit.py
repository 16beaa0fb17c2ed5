"""Numba where it is installed, plain Python (same results, some hundred times slower) where it is not.

Machine code is kept on disk, in a folder named for all the sources that it is made of: a compiled caller does not
notice by itself that a function of another file has changed. The folder lies beside the sources where these may be
written, else in the user's cache.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

Function = TypeVar("Function", bound=Callable[..., object])

try:
    import numba as _numba
except ImportError:  # the Raspberry Pi has no need of it
    HAVE_NUMBA = False
else:
    HAVE_NUMBA = True
    numba: Any = _numba

#: IEEE arithmetic; threads run freely; no counting of references, which would cost more than the arithmetic: compiled
#: functions allocate nothing.
_OPTIONS = {"error_model": "numpy", "nogil": True, "_nrt": False}

_HERE = Path(__file__).resolve().parent


def _cache_folder() -> Path:
    """Where machine code is kept."""
    digest = hashlib.sha256()
    for path in sorted(_HERE.rglob("*.py")):
        digest.update(path.read_bytes())
    beside = _HERE / "__pycache__"
    kept = os.access(beside if beside.exists() else _HERE, os.W_OK)
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "hopper"
    return (beside if kept else home) / f"compiled-{digest.hexdigest()[:16]}"


def entry(function: Function) -> Function:
    """Compile a function that Python calls to machine code, kept on disk."""
    if not HAVE_NUMBA:
        return function
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = before or str(_cache_folder())
    try:
        return cast(Function, numba.njit(cache=True, **_OPTIONS)(function))
    finally:
        numba.config.CACHE_DIR = before


def _inner(**options: object) -> Callable[[Function], Function]:
    """For what Python never calls: no wrappers for that."""
    wrappers = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    return cast(Callable[[Function], Function], numba.njit(**_OPTIONS, **wrappers, **options))


def compiled(function: Function) -> Function:
    """Compile a function that only compiled ones call; it becomes part of what is kept of these."""
    if not HAVE_NUMBA:
        return function
    return _inner()(function)


def inlined(function: Function) -> Function:
    """Like `compiled`, for what is called in one place or is short: its code goes into the caller."""
    if not HAVE_NUMBA:
        return function
    return _inner(inline="always")(function)
