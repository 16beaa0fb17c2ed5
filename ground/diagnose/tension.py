"""Tension: how far from what the plant file states its own parameters must lie for what was named to fit.

The right law leaves a rig's own parameters within their tolerances. One that fits only where several of them lie at
the edge stands in for something else, which the catalogue may not hold.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy import stats

from ground.diagnose.fit import Fit, inverse

TOLD = 0.5
"""A parameter speaks where the recordings tell it to this share of its tolerance; the others stay where they were."""
LISTED_ODDS = 10.0
"""Prior odds that the law at work is one of the catalogue's."""
STRAINED = 0.01
"""Below this probability a reader is told."""


def departures(fit: Fit) -> dict[str, float]:
    """Departure of each told parameter from its stated value, in its tolerances.

    Told, were the model right: where it is wrong, robust sigmas grow, and that is just when this must speak.
    """
    sigma = np.sqrt(np.diag(inverse(fit.jacobian.T @ fit.jacobian + np.diag(fit.prior))))
    return {
        one.name: float(z)
        for one, z, own in zip(fit.free, fit.z, sigma, strict=True)
        if one.prior and one.segment is None and own < TOLD
    }


def chance(fit: Fit) -> float:
    """Probability that right parameters lie this far from what is stated, all together (chi-square)."""
    away = departures(fit)
    return float(stats.chi2.sf(sum(z * z for z in away.values()), len(away))) if away else 1.0


def listed(fit: Fit) -> float:
    """Probability that the law is one of the catalogue's at all.

    By the largest odds that so small a chance leaves it (-e p ln p; Sellke, Bayarri and Berger 2001).
    """
    p = chance(fit)
    most = -math.e * p * math.log(max(p, 1e-300)) if p < 1.0 / math.e else 1.0
    return LISTED_ODDS * most / (LISTED_ODDS * most + 1.0 - most)


def strained(fit: Fit) -> Sequence[str]:
    """What a reader must know, where what was named fits only with parameters far from what is stated."""
    p = chance(fit)
    if p >= STRAINED:
        return ()
    worst = sorted(departures(fit).items(), key=lambda item: -abs(item[1]))[:4]
    where = ", ".join(f"{name} {z:+.1f}" for name, z in worst if abs(z) > 1.0)
    return (
        f"It fits only with parameters this many sigmas from what the plant file states: {where} (chance {p:.1g}). "
        "Either they are not known that well, or the law at work is none of the catalogue's.",
    )
