"""How an input runs between its samples.

Held: a command that a computer sets. Linear: the least that can be assumed. Cubic: a smooth force that was measured;
straight lines damp what lies near half the sample rate (by sinc squared), a spline through the samples hardly does.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

HOLD, LINEAR, CUBIC = "hold", "linear", "cubic"
INTERPOLATIONS = (HOLD, LINEAR, CUBIC)
PARTS = 4
"""Straight pieces by which a cubic is followed from sample to sample: each errs 1/16 as much as one line would."""
SWEEPS = 40
"""The spline's slopes depend on their neighbours by less than a half: what is left of that after this many sweeps."""


def subdivided(times: Floats) -> Floats:
    """The sample times (n,) with the ends of the pieces of each interval between them, ((n - 1) PARTS + 1,)."""
    parts = times[:-1, None] + np.diff(times)[:, None] * (np.arange(PARTS) / PARTS)
    return np.append(parts.ravel(), times[-1])


def cubic(at: Floats, times: Floats, samples: Floats) -> Floats:
    """Values (k,) of the natural cubic spline through samples (n,) at increasing times (n,); held outside them."""
    if len(times) < 3:
        return np.asarray(np.interp(at, times, samples))
    width = np.diff(times)
    slope = _slopes(width, np.diff(samples) / width)
    inside = np.clip(at, times[0], times[-1])
    i = np.clip(np.searchsorted(times, inside, side="right") - 1, 0, len(times) - 2)
    h, u = width[i], (inside - times[i]) / width[i]
    rising = u * u * (3.0 - 2.0 * u)
    bend = u * (1.0 - u) * ((1.0 - u) * slope[i] - u * slope[i + 1]) * h
    return np.asarray((1.0 - rising) * samples[i] + rising * samples[i + 1] + bend)


def _slopes(width: Floats, secant: Floats) -> Floats:
    """Slopes (n,) at the samples of the C2 cubic without curvature at both ends (de Boor 1978, ch. IV)."""
    stiff = 1.0 / width
    left, right = np.append(0.0, stiff), np.append(stiff, 0.0)
    pull = 3.0 * (np.append(0.0, stiff * secant) + np.append(stiff * secant, 0.0))
    slope = np.append(secant, secant[-1])
    for _ in range(SWEEPS):  # Jacobi: the diagonal is twice the rest of its row
        slope = (pull - left * np.append(0.0, slope[:-1]) - right * np.append(slope[1:], 0.0)) / (
            2.0 * (left + right)
        )
    return np.asarray(slope)
