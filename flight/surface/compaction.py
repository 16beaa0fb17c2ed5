"""How dissipation falls from hop to hop in one place: three laws, over which the belief averages.

Each law gives h(n), the part of the fall that has happened after a dose of n earlier hops; it is scaled so that
h(3) = 1: the published datum is the fall from the first to the fourth hop. Tapped granular media settle
exponentially in the simplest picture, by a stretched exponential (Philippe and Bideau, Europhys. Lett. 60, 677, 2002)
or with the inverse logarithm (Knight et al., Phys. Rev. E 51, 3957, 1995).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

EXPONENTIAL, STRETCHED, LOGARITHMIC = "exponential", "stretched exponential", "inverse logarithmic"
_DATUM = 3.0


@dataclass(frozen=True)
class Law:
    """One law with its constants: `rate` hops, and the exponent or the strength of the logarithm."""

    name: str
    rate: float
    shape: float = 1.0

    def share(self, dose: float) -> float:
        """h at a dose (hops, not negative); 1 at three."""
        return self._raw(dose) / self._raw(_DATUM)

    def _raw(self, dose: float) -> float:
        if self.name == LOGARITHMIC:
            return 1.0 - 1.0 / (1.0 + self.shape * math.log1p(dose / self.rate))
        return -math.expm1(-((dose / self.rate) ** self.shape))


LAWS = (
    *(Law(EXPONENTIAL, rate) for rate in (1.0, 2.2, 6.0)),
    *(Law(STRETCHED, rate, shape) for rate, shape in ((1.0, 0.5), (3.0, 0.7), (8.0, 0.5))),
    *(Law(LOGARITHMIC, rate, shape) for rate, shape in ((0.1, 0.7), (0.6, 1.5), (2.0, 3.0))),
)
"""The laws on a grid of their constants; each of the three kinds has as many points."""

FEW_LAWS = (1, 4, 7)
"""Indices of one point for each kind, for ground of which little is known."""


def shares(dose: float) -> Array:
    """h of every law of `LAWS` at a dose (laws,)."""
    return np.array([law.share(dose) for law in LAWS])
