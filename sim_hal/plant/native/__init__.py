"""Machine code of the plant's engine by LLVM where llvmlite is installed; else plain Python with the same results."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache, wraps
from typing import Any, TypeVar

from sim_hal.plant.native.arrays import Floats1, Floats2, Floats3, Ints1, Ints2

__all__ = ["Floats1", "Floats2", "Floats3", "Ints1", "Ints2", "entry", "have_compiler"]

Function = TypeVar("Function", bound=Callable[..., None])


@cache
def have_compiler() -> bool:
    """Whether machine code can be made; says so once where it cannot."""
    try:
        import llvmlite  # noqa: F401
    except ImportError:
        warnings.warn(
            "llvmlite is not installed: simulations run some hundred times slower; `pip install llvmlite`",
            RuntimeWarning,
            stacklevel=4,
        )
        return False
    return True


def entry(function: Function) -> Function:
    """A function that Python calls and that runs as machine code, together with all that it calls."""
    made: list[Callable[..., None]] = []

    @wraps(function)
    def call(*arguments: Any) -> None:
        if not made:
            made.append(_runner(function))
        made[0](*arguments)

    return call  # type: ignore[return-value]


def _runner(function: Callable[..., None]) -> Callable[..., None]:
    if not have_compiler():
        return function
    from sim_hal.plant.native.build import build

    return build(function)
