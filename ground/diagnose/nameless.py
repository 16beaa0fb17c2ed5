"""When no name fits what is left: a formula, held to the same proof as every name."""

from __future__ import annotations

from dataclasses import replace

from ground.diagnose.accept import LOST_SIGMAS, identified, significance, worthwhile
from ground.diagnose.chosen import Chosen, Named
from ground.diagnose.crossval import cross_validate
from ground.diagnose.evidence import LocatedForce
from ground.diagnose.formula import formula_candidate, sparse_law
from ground.diagnose.name import ACCEPT
from ground.diagnose.scoring import effective_share, probability_better
from ground.diagnose.workers import FitTask, Workers, fit_job


def with_formula(named: Named, force: LocatedForce, workers: Workers) -> Named:
    """The search's end with a formula for `force`, what its fit still lacks; unchanged where that proves nothing.

    The formula's probability is that of predicting better, times the share of the force that it predicts.
    """
    segments = workers.context.segments
    candidate, law = formula_candidate(named.fit.plant, force), sparse_law(force)
    if candidate is None or law is None:
        return named
    start = FitTask(candidate.joined(named.fit.plant), named.fit, {}, "polish")
    (fit,) = workers.map(fit_job, [start])
    share = effective_share(fit.residuals.reshape(-1, segments[0].observed.shape[1]))
    sigmas = workers.context.sigmas
    before, after = (cross_validate(each, segments, sigmas) for each in (named.fit, fit))
    scores = after.scores(share), before.scores(share)
    better = probability_better(*scores)
    useful = worthwhile(before, after, float((scores[0] - scores[1]).sum()))
    if better < ACCEPT or not useful or not identified(candidate, fit, segments, named.fit.chi2):
        return named
    (final,) = workers.map(fit_job, [FitTask(fit.plant, fit, fit.values, "final")])
    weights = ((candidate, law.explained),)
    chosen = Chosen(candidate, better, (), {}, weights, named.fit.chi2, absent=named.fit)
    return without_lost(replace(named, fit=final, chosen=(*named.chosen, chosen)), workers)


def without_lost(named: Named, workers: Workers) -> Named:
    """The search's end without effects that stood in for what the formula says, their strength lost beside it."""
    segments = workers.context.segments
    lost = [
        one
        for one in named.chosen[:-1]
        if significance(one.candidate, named.fit, segments, one.chi2_without) < LOST_SIGMAS
    ]
    if not lost:
        return named
    plant = named.fit.plant
    for one in lost:
        plant = one.candidate.removed(plant)
    (fit,) = workers.map(fit_job, [FitTask(plant, named.fit, named.fit.values, "final")])
    return replace(named, fit=fit, chosen=tuple(one for one in named.chosen if one not in lost))
