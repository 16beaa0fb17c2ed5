"""What a person must see to believe a diagnosis: the traces behind the figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ground.diagnose.ripple import Ripple

Float = NDArray[np.float64]


@dataclass(frozen=True)
class Trace:
    """One channel of one held-out recording: measured, and predicted by the three fits; all (samples,)."""

    run: str
    channel: str
    unit: str
    times_s: Float
    measured: Float
    nominal: Float
    refit: Float
    extended: Float


@dataclass(frozen=True)
class LocatedForce:
    """The force that one balance equation lacks, smoothed from a recording.

    `before` is what the refitted plant lacks, `after` what the extended one still does; `law` is the force of the
    effects found, all (samples,), in `unit`. `causes` are the quantities it may depend on, by name with unit.
    `began_s` is when the whole recording began; None: with the force. `ripple`: what repeats along the position.
    """

    equation: str
    run: str
    unit: str
    times_s: Float
    before: Float
    before_std: Float
    after: Float | None
    causes: Mapping[str, Float]
    explained: Mapping[str, float]
    log_likelihood_gain: float
    began_s: float | None = None
    ripple: Ripple | None = None

    @property
    def law(self) -> Float | None:
        """The force that the effects found supply: what was lacking before, less what is lacking after."""
        return None if self.after is None else self.before - self.after


@dataclass(frozen=True)
class Evidence:
    """All traces of a diagnosis."""

    traces: tuple[Trace, ...]
    forces: tuple[LocatedForce, ...]
