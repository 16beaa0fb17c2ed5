"""Periods: how far the motion goes between repeats of a missing force, read from the force itself.

A search for a ripple that starts at a wrong period ends at a wrong one: the fit has a dip at every near miss.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ground.diagnose.evidence import LocatedForce
from ground.diagnose.ripple import CYCLE_STEP, LEAST_CYCLES

Float = NDArray[np.float64]

MOST_SIZE = 0.2
"""Of the typical force: what asks for more is no ripple beside it, but a start or a stop of the motion."""
LEAST_PART = 0.1
"""Of a ripple's amplitude; a fit begins with no smaller part."""
SAMPLES_PER_CYCLE = 6.0
"""Fewer do not show a cycle."""


def with_periods(
    scales: Mapping[str, Mapping[str, float]], forces: Sequence[LocatedForce]
) -> dict[str, dict[str, float]]:
    """The scales with what each balance's missing force shows of a ripple: period P, parts A_sin and A_cos."""
    found = {name: dict(own) for name, own in scales.items()}
    for force in forces:
        own = found.get(force.equation, {})
        if "P" in own and (ripple := force.ripple) is not None and ripple.size <= MOST_SIZE * own["F"]:
            least = LEAST_PART * ripple.size
            own |= {
                "P": ripple.period,
                "A_sin": at_least(ripple.sine, least),
                "A_cos": at_least(ripple.cosine, least),
            }
        elif "P" in own and (period := strongest_period(force)) is not None:
            own["P"] = min(period, own["X"] / LEAST_CYCLES)
    return found


def at_least(part: float, least: float) -> float:
    """A part of a ripple, not so small that a fit beginning there could not change it."""
    return float(np.copysign(max(abs(part), least), part))


def strongest_period(force: LocatedForce) -> float | None:
    """The period in position [m, or the position's own unit] of the strongest sine in a missing force.

    Weighted least-squares spectrum (Lomb 1976, Vanicek 1971) beside a constant, a slope along the travel and
    one against the speed. None where the motion is too short to tell.
    """
    position = force.causes.get("position")
    if position is None or np.ptp(position) == 0.0:
        return None
    most = force.times_s.size / SAMPLES_PER_CYCLE
    cycles = np.arange(LEAST_CYCLES, most, CYCLE_STEP)
    if cycles.size == 0:
        return None
    return float(np.ptp(position) / cycles[int(np.argmax(spectrum(force, position, cycles)))])


def spectrum(force: LocatedForce, position: Float, cycles: Float) -> Float:
    """Weighted drop in squares, (cycles,), by a sine of so many cycles over the travel."""
    weight = 1.0 / force.before_std
    phase = 2.0 * np.pi * (position - position.min()) / np.ptp(position)
    speed = force.causes.get("velocity", np.zeros_like(position))
    smooth = weight[:, None] * np.column_stack([np.ones_like(position), phase, speed])
    basis = np.linalg.qr(smooth)[0]
    left = weight * force.before
    left = left - basis @ (basis.T @ left)
    gains = np.empty(cycles.size)
    for number, count in enumerate(cycles):
        waves = weight[:, None] * np.column_stack([np.sin(count * phase), np.cos(count * phase)])
        waves -= basis @ (basis.T @ waves)
        gains[number] = float(left @ waves @ np.linalg.lstsq(waves, left, rcond=None)[0])
    return gains
