"""How fast something grows over an hour, and how well that is known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FLOATS = NDArray[np.float64]

GROWTH_PARTS = 8


def growth_per_hour(times_s: FLOATS, values: FLOATS) -> tuple[float, float]:
    """Slope of memory over time, and its standard error from the steps between parts of the time.

    A step of the allocator anywhere would make a regression's own standard error far too small.
    """
    slope = float(np.polyfit(times_s, values, 1)[0] * 3600.0)
    means = np.array([float(np.mean(part)) for part in np.array_split(values, GROWTH_PARTS)])
    step_s = float(times_s[-1] - times_s[0]) / GROWTH_PARTS
    steps = np.diff(means) / step_s * 3600.0
    return slope, float(np.std(steps, ddof=1) / np.sqrt(steps.size))
