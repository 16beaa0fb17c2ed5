"""How a recording was sampled, in words: rate, jitter, gaps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

GAP = 1.5
"""A step this many times the usual one is a gap."""
EVEN = 1e-3
"""Jitter below this share of the usual step is not worth a word."""


def sampling(times_s: NDArray[np.float64]) -> str:
    """Rate, jitter and gaps of sample times (n,), for a person."""
    steps = np.diff(times_s)
    if steps.size == 0:
        return "a single sample"
    usual = float(np.median(steps))
    text = f"{1.0 / usual:.6g} samples/s over {times_s[-1] - times_s[0]:.6g} s"
    gaps = steps > GAP * usual
    jitter = float(np.std(steps[~gaps]) / usual) if not gaps.all() else 0.0
    if jitter > EVEN:
        text += f", steps uneven by {jitter:.1%}"
    if gaps.any():
        at = times_s[int(np.argmax(steps))]
        text += f", {int(gaps.sum())} gaps, the longest of {steps.max():.3g} s at {at:.6g} s"
    return text
