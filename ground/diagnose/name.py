"""Name what is missing: every explanation competes on equal terms, and what wins must win where it was not fitted.

Forward from the refitted plant: each round screens all candidates by score test, fits the best few in full, and
compares them, with the plant as it stands, on recordings left out in turn. The best joins when it predicts better,
with probability `ACCEPT`. Two effects can stand in for each other until a third is known, so after each round every
effect that joined earlier may be replaced by a rival. At the end each is set against its rivals once more, with all
the others in place: that contest gives the probabilities.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ground.diagnose.accept import identified, likelihood_here, worthwhile
from ground.diagnose.candidates import Candidate, effect_candidates, label_of
from ground.diagnose.chosen import Chosen, Named
from ground.diagnose.crossval import HeldOut, cross_validate, in_sample
from ground.diagnose.fit import Fit
from ground.diagnose.released import released_parameters
from ground.diagnose.scoring import OCCAM, effective_share, model_weights, probability_better
from ground.diagnose.screen import SEEN, Promise, promises_job, trial_job
from ground.diagnose.workers import FitTask, Workers, fit_job
from sim_hal.plant.simulate import Plant

Float = NDArray[np.float64]
Progress = Callable[[str], None]
Fitted = list[tuple[Candidate, Fit]]

ACCEPT = 0.95
TRIED = 16
"""Starts whose promise is put to the test by one simulation."""
SCREENED = 6
"""Candidates that get a full fit in each round."""
STARTS = 2
"""Starts of each candidate that are fitted at the most."""
RIVALS = 3
"""Rivals of the best candidate that are compared with it, and that may replace it later."""
MOST_EFFECTS = 6
NEEDLESS = 0.5
"""An effect leaves when the plant without it, fitted anew, is this likely to predict as well."""
CLEARLY = 0.9
"""A rival replaces an effect when its chi-square is below this share of the present one's."""
HOPELESS = 30.0
"""A candidate this many units of log density behind the best is no rival."""
SAME = 0.9999
"""Two candidates whose effects on the residuals correlate this closely cannot be told apart by these recordings."""


class Search:
    """Forward selection of effects on given segments, with replacement."""

    def __init__(self, workers: Workers, progress: Progress, given: Plant) -> None:
        self.workers = workers
        self.progress = progress
        self.given = given
        self._twins: dict[str, tuple[Candidate, ...]] = {}
        self._screened: list[Promise] = []

    def run(self, refit: Fit) -> Named:
        """Add effects one by one until none predicts better."""
        current = refit
        chosen: list[Chosen] = []
        while True:
            fits = self.fit_best(current) if len(chosen) < MOST_EFFECTS else []
            best, refused = self.best_of(current, fits)
            if best is None:
                break
            found = next(fit for candidate, fit in fits if candidate is best.candidate)
            share = 1.0 - found.chi2 / current.chi2
            self.progress(f"found {label_of(best.candidate)}: {share:.1%} of what was left")
            current = found
            chosen.append(best)
            current, chosen = self.replace_earlier(current, chosen)
        current, final = self.settled(current, chosen)
        return Named(current, final, refused, tuple(self._screened))

    def settled(
        self, current: Fit, chosen: Sequence[Chosen], left: frozenset[str] = frozenset()
    ) -> tuple[Fit, tuple[Chosen, ...]]:
        """The extended plant fitted to the bottom, and each effect set against its rivals.

        The needless leave, and one whose rival turns out more probable gives way to it; `left` are the keys of those
        that have.
        """
        if not chosen:
            return current, ()
        self.progress("settling the extended plant")
        (current,) = self.fitted([FitTask(current.plant, current, current.values, "final")])
        final = tuple(self.contest(current, one) for one in chosen)
        least = min(final, key=lambda one: one.probability_better)
        if len(final) > 1 and least.probability_better < NEEDLESS:
            self.progress(f"leaving out {label_of(least.candidate)}")
            return self.settled(
                self.without(current, least), [one for one in final if one is not least], left
            )
        for one in final:
            if (better := one.outdone_by(left)) is not None:
                rival, fit = better
                self.progress(f"replacing {label_of(one.candidate)} by {label_of(rival)}")
                changed = [self.given_way(each, rival) if each is one else each for each in final]
                return self.settled(fit, changed, left | {one.candidate.key})
        return current, final

    def again_without(self, named: Named, one: Chosen) -> Named:
        """The end of the search once more, without one of the effects that it had chosen."""
        assert one.absent is not None
        fit, chosen = self.settled(one.absent, [other for other in named.chosen if other is not one])
        return replace(named, fit=fit, chosen=chosen)

    def given_way(self, one: Chosen, rival: Candidate) -> Chosen:
        """An effect's place taken by one of its rivals."""
        others = tuple(c for c in (one.candidate, *one.rivals) if c is not rival)
        return replace(one, candidate=rival, rivals=others, twins=self._twins.get(rival.key, ()))

    def fitted(self, tasks: Sequence[FitTask]) -> list[Fit]:
        """Fits in the order of the tasks."""
        return list(self.workers.map(fit_job, tasks))

    def fit_best(self, current: Fit) -> Fitted:
        """The candidates that the residuals ask for most, each fitted with the plant as it stands, best first."""
        self.progress("screening all effects")
        leaders = self.leaders(current)
        names = dict.fromkeys(label_of(promise.candidate) for promise in leaders)
        if not leaders:
            return []
        self.progress(f"fitting {', '.join(names)}")
        tasks = [FitTask(p.candidate.joined(current.plant, p.start), current, p.values) for p in leaders]
        best: dict[str, tuple[Candidate, Fit]] = {}
        for promise, fit in zip(leaders, self.fitted(tasks), strict=True):
            key = promise.candidate.key
            if key not in best or fit.cost < best[key][1].cost:
                best[key] = (promise.candidate, fit)
        return self.polished(sorted(best.values(), key=lambda pair: pair[1].chi2))

    def polished(self, fits: Fitted) -> Fitted:
        """The best fit and its rivals with sensitivities of their own, best first; the hopeless as they are."""
        if not fits:
            return []
        share = self.share(fits[0][1])
        least = self.total(fits[0][1], fits[0][1], share)
        close = [pair for pair in fits if self.total(pair[1], fits[0][1], share) > least - HOPELESS]
        close = close[: RIVALS + 1]
        tasks = [FitTask(fit.plant, fit, fit.values, "polish") for _, fit in close]
        done = [(candidate, fit) for (candidate, _), fit in zip(close, self.fitted(tasks), strict=True)]
        rest = [pair for pair in fits if all(pair[0] is not candidate for candidate, _ in close)]
        return sorted(done, key=lambda pair: pair[1].chi2) + rest

    def leaders(self, current: Fit) -> list[Promise]:
        """The most promising starts of the most promising candidates; twins are set aside with their likes."""
        offered: list[Candidate] = [
            *effect_candidates(current.plant, self.workers.context.scales),
            *released_parameters(current.plant, self.given),
        ]
        self._screened = self.promises(current, offered)
        kept: dict[str, list[Promise]] = {}
        for promise in self.without_twins(self.tested(current, self._screened)):
            own = kept.setdefault(promise.candidate.key, [])
            if len(own) < STARTS:
                own.append(promise)
        return [promise for own in list(kept.values())[:SCREENED] for promise in own]

    def promises(self, current: Fit, offered: Sequence[Candidate]) -> list[Promise]:
        """What every start of each candidate promises."""
        parts = 2 * self.workers.count
        chunks: list[tuple[Fit, Sequence[Candidate]]] = [(current, offered[i::parts]) for i in range(parts)]
        return [promise for some in self.workers.map(promises_job, chunks) for promise in some]

    def tested(self, current: Fit, promises: Sequence[Promise]) -> list[Promise]:
        """The best promises after one simulation each, best first."""
        seen = sorted((p for p in promises if p.gain > SEEN), key=lambda p: -p.gain)[:TRIED]
        tried = self.workers.map(trial_job, [(current, promise) for promise in seen])
        return sorted(tried, key=lambda p: -p.gain)

    def without_twins(self, ranked: Sequence[Promise]) -> list[Promise]:
        """Of candidates that act alike the likeliest one; the others are remembered as its twins."""
        kept: list[Promise] = []
        for promise in sorted(ranked, key=lambda p: -likelihood_here(p.candidate, self.given)):
            like = next((p for p in kept if abs(p.direction @ promise.direction) > SAME), None)
            if like is None or like.candidate.key == promise.candidate.key:
                kept.append(promise)
                continue
            twins = self._twins.get(like.candidate.key, ())
            if all(promise.candidate.key != twin.key for twin in twins):
                self._twins[like.candidate.key] = (*twins, promise.candidate)
        return sorted(kept, key=lambda p: -p.gain)

    def best_of(
        self, current: Fit, fits: Fitted
    ) -> tuple[Chosen | None, tuple[tuple[Candidate, float], ...]]:
        """The candidate that joins, or None; and each candidate's probability of predicting better."""
        if not fits:
            return None, ()
        share = self.share(fits[0][1])
        before = self.held_out(current)
        tried: list[tuple[Candidate, float]] = []
        able: list[tuple[Candidate, Float]] = []
        for candidate, fit in fits[: RIVALS + 1]:
            held = self.held_out(fit)
            scores = held.scores(share)
            better = probability_better(scores, before.scores(share))
            tried.append((candidate, better))
            nats = float(np.sum(scores - before.scores(share)))
            useful = better >= ACCEPT and worthwhile(before, held, nats)
            if useful and identified(candidate, fit, self.workers.context.segments):
                able.append((candidate, scores))
        if not able:
            return None, tuple(tried)
        weights = model_weights(np.vstack([scores for _, scores in able]), [self.unusual(c) for c, _ in able])
        winner = able[int(np.argmax(weights))][0]
        rivals = tuple(candidate for candidate, _ in fits if candidate is not winner)[:RIVALS]
        better = next(p for candidate, p in tried if candidate is winner)
        return Chosen(winner, better, rivals, self._twins.get(winner.key, ()), (), current.chi2), tuple(tried)

    def unusual(self, candidate: Candidate) -> float:
        """How unlikely a candidate is beforehand, in free parameters."""
        return -math.log(likelihood_here(candidate, self.given)) / math.log(OCCAM)

    def held_out(self, fit: Fit) -> HeldOut:
        """How a fit predicts segments left out of it."""
        return cross_validate(fit, self.workers.context.segments)

    def share(self, fit: Fit) -> Float:
        """Effective samples per sample, by output, as the residuals of the best fit tell them."""
        return effective_share(fit.residuals.reshape(-1, self.workers.context.segments[0].observed.shape[1]))

    def total(self, fit: Fit, best: Fit, share: Float) -> float:
        """Log density of a fit's residuals at the scale of the best fit's."""
        segments = self.workers.context.segments
        scale = in_sample(best, segments).scale
        return float(np.sum(in_sample(fit, segments).scores(share, scale)))

    def replace_earlier(self, current: Fit, chosen: list[Chosen]) -> tuple[Fit, list[Chosen]]:
        """Let a rival take the place of an effect that joined earlier, where the plant then fits clearly better."""
        for number, one in enumerate(chosen[:-1]):
            swapped = self.swapped(self.without(current, one), one)
            if not swapped or swapped[0][1].chi2 >= CLEARLY * current.chi2:
                continue
            rival = swapped[0][0]
            ((_, current),) = self.polished(swapped[:1])
            self.progress(f"replacing {label_of(one.candidate)} by {label_of(rival)}")
            chosen[number] = self.given_way(one, rival)
        return current, chosen

    def without(self, current: Fit, one: Chosen) -> Fit:
        """The plant fitted without one of its effects."""
        (absent,) = self.fitted([FitTask(one.candidate.removed(current.plant), current, {})])
        return absent

    def swapped(self, absent: Fit, one: Chosen) -> Fitted:
        """Fits with each rival in an effect's place, from its most promising start, best first."""
        present = {absent.plant.prefix(use) for use in absent.plant.effects}
        rivals = [c for c in one.rivals if c.key not in present]
        starts: dict[str, Promise] = {}
        for promise in self.tested(absent, self.promises(absent, rivals)):
            starts.setdefault(promise.candidate.key, promise)
        if starts:
            names = ", ".join(label_of(promise.candidate) for promise in starts.values())
            self.progress(f"trying {names} for {label_of(one.candidate)}")
        tasks = [
            FitTask(p.candidate.joined(absent.plant, p.start), absent, p.values) for p in starts.values()
        ]
        fits = [(p.candidate, fit) for p, fit in zip(starts.values(), self.fitted(tasks), strict=True)]
        return sorted(fits, key=lambda pair: pair[1].chi2)

    def contest(self, final: Fit, one: Chosen) -> Chosen:
        """Weights of one effect and its rivals, with all other effects in place."""
        absent = self.without(final, one)
        others = self.swapped(absent, one)
        share = self.share(final)
        least = self.total(final, final, share) - HOPELESS
        close = self.polished(
            [(c, fit) for c, fit in others if self.total(fit, final, share) > least] or others[:1]
        )
        scores = np.vstack(
            [self.held_out(final).scores(share), *(self.held_out(f).scores(share) for _, f in close)]
        )
        names = [one.candidate, *(candidate for candidate, _ in close)]
        weights = zip(names, map(float, model_weights(scores, list(map(self.unusual, names)))), strict=True)
        # The plant without the effect is scored on the very data it was fitted to, which can only flatter it.
        lacking = in_sample(absent, self.workers.context.segments).scores(share)
        return replace(
            one,
            weights=tuple(sorted(weights, key=lambda item: -item[1])),
            probability_better=probability_better(scores[0], lacking),
            chi2_without=absent.chi2,
            absent=absent,
            rival_fit=close[0] if close else None,
        )
