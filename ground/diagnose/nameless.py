"""When no name fits what is left: a formula, held to the same proof as every name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ground.diagnose.accept import (
    LEAST_SIGMA,
    LOST_SIGMAS,
    STRENGTH_SIGMAS,
    identified,
    significance,
    worthwhile,
)
from ground.diagnose.candidates import EffectCandidate
from ground.diagnose.chosen import Chosen, Named
from ground.diagnose.confirm import holds
from ground.diagnose.crossval import cross_validate
from ground.diagnose.evidence import LocatedForce
from ground.diagnose.findings import unexplained
from ground.diagnose.fit import Fit
from ground.diagnose.formula import Law, formula_candidate, sparse_law
from ground.diagnose.name import ACCEPT, Search
from ground.diagnose.scoring import effective_share, probability_better
from ground.diagnose.unseen import HeldOutViews
from ground.diagnose.workers import FitTask, Workers, fit_job
from sim_hal.plant.effects.unlisted import PHYSICS_ID as UNLISTED


def with_a_law(
    named: Named,
    refit: Fit,
    missing: Sequence[LocatedForce],
    left: Sequence[LocatedForce],
    search: Search,
    held_out: HeldOutViews,
) -> Named:
    """The search's end with a formula beside what it named, or else in its stead; unchanged where neither is proven.

    `missing` is what the refitted plant lacks, `left` what is still missing beside what was named. A name near to
    what is at work takes some of it and leaves what no short formula describes: then the formula stands alone, if it
    leaves nothing. One that leaves something, too, is no better a description than names.
    """
    segments = search.workers.context.segments
    if left:
        beside = with_formula(named, left[0], search.workers)
        named = beside if holds(beside, search, held_out) else named
    if missing and named.chosen and unexplained(named.fit, segments):
        alone = with_formula(replace(named, fit=refit, chosen=()), missing[0], search.workers)
        better = search.better_of(named, alone)
        if holds(better, search, held_out) and not unexplained(better.fit, segments):
            named = better
    return named


def with_formula(named: Named, force: LocatedForce, workers: Workers) -> Named:
    """The search's end with a formula for `force`, what its fit still lacks; unchanged where that proves nothing.

    The formula's probability is that of predicting better, times the share of what exceeded the noise, where it was
    not fitted, that is gone with it.
    """
    segments = workers.context.segments
    law = sparse_law(force)
    if law is None or any(use.physics_id == UNLISTED for use in named.fit.plant.effects):
        return named
    candidate, fit = told_law(named.fit, force.equation, law, workers)
    share = effective_share(fit.residuals.reshape(-1, segments[0].observed.shape[1]))
    sigmas = workers.context.sigmas
    before, after = (cross_validate(each, segments, sigmas) for each in (named.fit, fit))
    scores = after.scores(share), before.scores(share)
    better = probability_better(*scores)
    useful = worthwhile(before, after, float((scores[0] - scores[1]).sum()))
    if better < ACCEPT or not useful or not identified(candidate, fit, segments, named.fit.chi2):
        return named
    (final,) = workers.map(fit_job, [FitTask(fit.plant, fit, fit.values, "final")])
    gone = (before.mean_square - after.mean_square) / max(before.mean_square - 1.0, LEAST_SIGMA)
    weights = ((candidate, float(np.clip(gone, 0.0, 1.0))),)
    chosen = Chosen(candidate, better, (), {}, weights, named.fit.chi2, absent=named.fit)
    return without_lost(replace(named, fit=final, chosen=(*named.chosen, chosen)), workers)


def told_law(start: Fit, equation: str, law: Law, workers: Workers) -> tuple[EffectCandidate, Fit]:
    """The formula fitted together with the plant, without the terms that the plant's own parameters do as well."""
    while True:
        candidate = formula_candidate(start.plant, equation, law)
        (fit,) = workers.map(fit_job, [FitTask(candidate.joined(start.plant), start, {}, "polish")])
        sizes = np.array([fit.values[name] for name in candidate.strengths()])
        told = np.abs(sizes) / np.array([max(fit.std[name], LEAST_SIGMA) for name in candidate.strengths()])
        if len(law.terms) == 1 or told.min() >= STRENGTH_SIGMAS:
            return candidate, fit
        law = replace(law, coefficients=sizes).without(int(np.argmin(told)))


def without_lost(named: Named, workers: Workers) -> Named:
    """The search's end without effects that stood in for what the formula says, their strength lost beside it."""
    segments, fit = workers.context.segments, named.fit
    earlier = named.chosen[:-1]
    absent = workers.map(fit_job, [FitTask(one.candidate.removed(fit.plant), fit, {}) for one in earlier])
    strengths = [
        significance(one.candidate, fit, segments, other.chi2)
        for one, other in zip(earlier, absent, strict=True)
    ]
    lost = [one for one, sigmas in zip(earlier, strengths, strict=True) if sigmas < LOST_SIGMAS]
    if not lost:
        return named
    plant = fit.plant
    for one in lost:
        plant = one.candidate.removed(plant)
    (fit,) = workers.map(fit_job, [FitTask(plant, fit, fit.values, "final")])
    return replace(named, fit=fit, chosen=tuple(one for one in named.chosen if one not in lost))
