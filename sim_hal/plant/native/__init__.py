"""Machine code of the plant's engine by LLVM where llvmlite is installed; else plain Python with the same results."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache, cached_property, partial, wraps
from typing import TYPE_CHECKING, Any

import numpy as np

from sim_hal.plant.native.arrays import Floats1, Floats2, Floats3, Ints1, Ints2

__all__ = ["Entry", "Floats1", "Floats2", "Floats3", "Ints1", "Ints2", "entry", "have_compiler"]

if TYPE_CHECKING:
    from sim_hal.plant.native.build import MachineCode


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


class Entry:
    """A function that Python calls and that runs as machine code, together with all that it calls."""

    def __init__(self, function: Callable[..., None]) -> None:
        self.function = function
        wraps(function)(self)

    def __call__(self, *arguments: Any) -> None:
        self._code(*arguments)

    def bound(self, *arguments: Any) -> Callable[[], None]:
        """The call with arguments that stay; arrays among them may change their content."""
        return self._code.bound(*arguments)

    @cached_property
    def _code(self) -> MachineCode | _Plain:
        if not have_compiler():
            return _Plain(self.function)
        from sim_hal.plant.native.build import MachineCode

        return MachineCode(self.function)


class _Plain:
    """The same without machine code."""

    def __init__(self, function: Callable[..., None]) -> None:
        self._function = function

    def __call__(self, *arguments: Any) -> None:
        with np.errstate(all="ignore"):  # machine code does not warn either
            self._function(*arguments)

    def bound(self, *arguments: Any) -> Callable[[], None]:
        return partial(self, *arguments)


def entry(function: Callable[..., None]) -> Entry:
    """Mark a function that Python calls."""
    return Entry(function)
