"""Which combinations of an effect's parameters the recordings tell, where they do not tell each by itself.

A winding that warms slowly shows alpha / C_th, the rise at first, whatever the two are; stiction that is sharp shows
its height times its width. Products and ratios of two are looked for: in the logarithms that is a sum or difference,
whose sigma follows from the fit's covariance (Bard, Nonlinear Parameter Estimation, 1974, ch. 7).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import combinations

from ground.diagnose.fit import Fit
from ground.diagnose.result import Estimate
from ground.diagnose.segments import Segment
from sim_hal.plant.structure import unit_text
from sim_hal.plant.units import INVERSE, dimension, times

UNTOLD = 0.3
"""A parameter whose sigma is more than this share of it is not told by itself."""
TOLD = 0.3
"""A combination counts as told when its relative sigma is below this share of each partner's ..."""
AT_MOST = 0.2
"""... and below this."""


def untold(estimate: Estimate) -> bool:
    """Whether a fitted parameter is hardly known."""
    return estimate.std > UNTOLD * abs(estimate.value)


def told_combinations(
    key: str, parameters: Mapping[str, Estimate], fit: Fit, segments: Sequence[Segment]
) -> list[str]:
    """Sentences on products and ratios of an effect's untold parameters that are told, the best known first."""
    names = [name for name, e in parameters.items() if untold(e) and e.std > 0.0 and e.value != 0.0]
    if len(names) < 2:
        return []
    covariance = fit.covariance_of([f"{key}.{name}" for name in names], segments)
    found = []
    for (i, one), (j, other) in combinations(enumerate(names), 2):
        a, b = parameters[one], parameters[other]
        share = covariance[i, j] / (a.value * b.value)
        squares = covariance[i, i] / a.value**2, covariance[j, j] / b.value**2
        sigma = math.sqrt(max(0.0, sum(squares) - 2.0 * abs(share)))
        if sigma > min(AT_MOST, TOLD * math.sqrt(min(squares))):
            continue
        sign, value = ("/", a.value / b.value) if share > 0.0 else ("*", a.value * b.value)
        power = INVERSE if share > 0.0 else -INVERSE
        unit = unit_text(times(dimension(a.unit), dimension(b.unit), power))
        found.append((sigma, f"{one} {sign} {other} = {value:.3g} ± {sigma * abs(value):.1g} {unit}"))
    return [text for _, text in sorted(found)]
