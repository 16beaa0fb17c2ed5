"""Numba where it is installed, plain Python (same results, some hundred times slower) where it is not."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

Function = TypeVar("Function", bound=Callable[..., object])

try:
    import numba
except ImportError:  # the Raspberry Pi has no need of it
    HAVE_NUMBA = False
else:
    HAVE_NUMBA = True


def compiled(function: Function) -> Function:
    """Compile `function` to machine code, kept on disk between runs; IEEE arithmetic, threads run freely."""
    if not HAVE_NUMBA:
        return function
    return cast(Function, numba.njit(cache=True, error_model="numpy", nogil=True)(function))


def inlined(function: Function) -> Function:
    """Like `compiled`, for what runs in the innermost loop: its body goes into each caller."""
    if not HAVE_NUMBA:
        return function
    return cast(Function, numba.njit(error_model="numpy", inline="always")(function))
