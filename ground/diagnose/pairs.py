"""Pairs: two effects that only together predict better.

Dry friction and a slope, say: with either alone the rest is still so wrong that its gain is lost in what the other
one leaves. Where no single effect is taken although the residuals are no noise, the best few are taken on trial, and
each must then be needed beside the second.
"""

from __future__ import annotations

from ground.diagnose.accept import identified, worthwhile
from ground.diagnose.candidates import Candidate
from ground.diagnose.chosen import Chosen
from ground.diagnose.findings import unexplained
from ground.diagnose.fit import Fit
from ground.diagnose.name import ACCEPT, RIVALS, Fitted, Search
from ground.diagnose.scoring import probability_better

TRIED = 2
"""First members that are taken on trial."""
PROMISING = 0.9
"""A first member must bring the chi-square below this share."""


def pair_of(search: Search, current: Fit, fits: Fitted) -> tuple[Fit, list[Chosen]] | None:
    """A pair that predicts better than the plant as it stands, with its fit; None where there is none."""
    if not unexplained(current, search.workers.context.segments):
        return None
    for candidate, fit in fits[:TRIED]:
        if fit.chi2 > PROMISING * current.chi2:
            break
        found = completed(search, current, (candidate, fit), fits)
        if found is not None:
            return found
    return None


def completed(
    search: Search, current: Fit, first: tuple[Candidate, Fit], fits: Fitted
) -> tuple[Fit, list[Chosen]] | None:
    """The second member for a first one that is taken on trial."""
    candidate, alone = first
    seconds = search.fit_best(alone)
    second, _ = search.best_of(alone, seconds)
    if second is None:
        return None
    both = next(fit for other, fit in seconds if other is second.candidate)
    share = search.share(both)
    before, after = search.held_out(current), search.held_out(both)
    scores = after.scores(share), before.scores(share)
    better = probability_better(*scores)
    segments = search.workers.context.segments
    useful = better >= ACCEPT and worthwhile(before, after, float((scores[0] - scores[1]).sum()))
    if not useful or not identified(candidate, both, segments):
        return None
    rivals = tuple(other for other, _ in fits if other.key not in (candidate.key, second.candidate.key))[
        :RIVALS
    ]
    joined = Chosen(candidate, better, rivals, search.twins_of(candidate), (), current.chi2)
    return both, [joined, second]
