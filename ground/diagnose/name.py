"""Name what is missing: every explanation competes on equal terms, and what wins must win where it was not fitted.

Forward from the refitted plant: each round screens all candidates by score test, fits the best few in full, and
compares them, with the plant as it stands, on recordings left out in turn. The best joins when it predicts better,
with probability `ACCEPT`. Two effects can stand in for each other until a third is known, so after each round every
effect that joined earlier may be replaced by a rival. At the end each is set against its rivals once more, with all
the others in place: that contest gives the probabilities.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ground.diagnose.accept import (
    LOST_SIGMAS,
    degenerate,
    identified,
    likelihood_here,
    significance,
    worthwhile,
)
from ground.diagnose.between import interpolation_of, otherwise_driven
from ground.diagnose.candidates import Candidate, EffectCandidate, label_of
from ground.diagnose.chosen import Chosen, Named
from ground.diagnose.crossval import in_sample
from ground.diagnose.fit import Fit
from ground.diagnose.scoring import OCCAM, model_weights, probability_better
from ground.diagnose.screen import Promise
from ground.diagnose.trials import HOPELESS, RIVALS, Fitted, Trials
from ground.diagnose.unseen import pooled, weights_on
from ground.diagnose.workers import FitTask

Float = NDArray[np.float64]
Branch = tuple[Fit, list[Chosen]]

ACCEPT = 0.95
MOST_EFFECTS = 6
NEEDLESS = 0.5
"""An effect leaves when the plant without it, fitted anew, is this likely to predict as well."""
CLEARLY = 0.9
"""A rival replaces an effect when its chi-square is below this share of the present one's."""
FAR_BETTER = 0.8
"""A candidate that does not predict best is followed as well when its chi-square is below this share of the
best one's."""


class Search(Trials):
    """Forward selection of effects on given segments, with replacement."""

    def follow(self, current: Fit, chosen: list[Chosen]) -> tuple[Named, Branch | None]:
        """Add effects one by one until none predicts better; and the first branch that was not taken."""
        passed_over: Branch | None = None
        while True:
            fits = self.fit_best(current) if len(chosen) < MOST_EFFECTS else []
            best, refused = self.best_of(current, fits)
            if (driven := self.otherwise_driven(current, best, fits)) is not None:
                current = driven
                continue
            passed_over = passed_over or self.other_branch(current, chosen, fits, best, refused)
            if best is None:
                break
            found = next(fit for candidate, fit in fits if candidate is best.candidate)
            share = 1.0 - found.chi2 / current.chi2
            self.outlook.say(f"found {label_of(best.candidate)}: {share:.1%} of what was left")
            current = found
            chosen.append(best)
            current, chosen = self.replace_earlier(current, chosen)
        current, final = self.settled(current, chosen)
        return Named(current, final, refused, tuple(self._screened)), passed_over

    def otherwise_driven(self, current: Fit, best: Chosen | None, fits: Fitted) -> Fit | None:
        """The plant with its inputs read otherwise between samples, where no effect or a sensor's explains more."""
        if best is not None and best.candidate.equation != "sensor":
            return None
        rival = None
        if best is not None:
            fit = next(fit for candidate, fit in fits if candidate is best.candidate)
            rival = (best.candidate, fit, self.unusual(best.candidate, fit))
        driven = otherwise_driven(self, current, rival, ACCEPT)
        if driven is not None:
            self.outlook.say(f"inputs run between samples as by `{interpolation_of(driven.plant)}`")
        return driven

    def other_branch(
        self,
        current: Fit,
        chosen: Sequence[Chosen],
        fits: Fitted,
        best: Chosen | None,
        tried: Sequence[tuple[Candidate, float]],
    ) -> Branch | None:
        """The plant with the candidate that fits far better than what was taken, though it does not predict so.

        An effect alone may predict badly what a second one, not known yet, has shaped as well.
        """
        if not fits or (best is not None and best.candidate is fits[0][0]):
            return None
        taken = current if best is None else next(fit for c, fit in fits if c is best.candidate)
        candidate, fit = fits[0]
        if fit.chi2 > FAR_BETTER * taken.chi2:
            return None
        if not identified(candidate, fit, self.workers.context.segments, current.chi2):
            return None
        rivals = tuple(c for c, _ in fits[1 : RIVALS + 1])
        return fit, [
            *chosen,
            Chosen(
                candidate,
                next(better for c, better in tried if c is candidate),
                rivals,
                dict(self._twins),
                (),
                current.chi2,
            ),
        ]

    def better_of(self, one: Named, other: Named) -> Named:
        """The other one only where it is sure to predict better."""
        share = self.share(min(one.fit, other.fit, key=lambda fit: fit.chi2))
        first, second = (self.held_out(named.fit).scores(share) for named in (one, other))
        return other if other.chosen and probability_better(second, first) >= ACCEPT else one

    def settled(
        self, current: Fit, chosen: Sequence[Chosen], left: frozenset[str] = frozenset()
    ) -> tuple[Fit, tuple[Chosen, ...]]:
        """The extended plant fitted to the bottom, and each effect set against its rivals.

        The needless leave, and one whose rival turns out more probable gives way to it; `left` are the keys of those
        that have.
        """
        if not chosen:
            return current, ()
        self.outlook.begin("settle", "settling the extended plant")
        (current,) = self.fitted([FitTask(current.plant, current, current.values, "final")])
        final = tuple(self.contest(current, one) for one in chosen)
        needless = self.needless(current, final)
        for one in final if needless is None else (needless,):  # in another's stead it may have been needless
            if (better := one.outdone_by(left)) is not None:
                rival, fit = better
                self.outlook.say(f"replacing {label_of(one.candidate)} by {label_of(rival)}")
                changed = [self.given_way(each, rival) if each is one else each for each in final]
                return self.settled(fit, changed, left | {one.candidate.key})
        if needless is not None:
            self.outlook.say(f"leaving out {label_of(needless.candidate)}")
            others = [one for one in final if one is not needless]
            return self.settled(self.without(current, needless), others, left)
        return current, final

    def needless(self, current: Fit, final: Sequence[Chosen]) -> Chosen | None:
        """The effect beside others whose strength is lost, or else without which the plant predicts as well."""
        if len(final) < 2:
            return None
        segments = self.workers.context.segments
        strengths = [significance(one.candidate, current, segments, one.chi2_without) for one in final]
        if min(strengths) < LOST_SIGMAS:
            return final[int(np.argmin(strengths))]
        least = min(final, key=lambda one: one.probability_better)
        return least if least.probability_better < NEEDLESS else None

    def again_without(self, named: Named, one: Chosen) -> Named:
        """The end of the search once more, without one of the effects that it had chosen."""
        assert one.absent is not None
        fit, chosen = self.settled(one.absent, [other for other in named.chosen if other is not one])
        return replace(named, fit=fit, chosen=chosen)

    def given_way(self, one: Chosen, rival: Candidate) -> Chosen:
        """An effect's place taken by one of its rivals."""
        others = tuple(c for c in (one.candidate, *one.rivals) if c.key != rival.key)
        return replace(one, candidate=rival, rivals=others)

    def best_of(
        self, current: Fit, fits: Fitted
    ) -> tuple[Chosen | None, tuple[tuple[Candidate, float], ...]]:
        """The candidate that joins, or None; and each candidate's probability of predicting better."""
        if not fits:
            return None, ()
        share = self.share(fits[0][1])
        before = self.held_out(current)
        tried: list[tuple[Candidate, float]] = []
        able: list[tuple[Candidate, Float, float]] = []
        for candidate, fit in fits[: RIVALS + 1]:
            held = self.held_out(fit)
            scores = held.scores(share)
            better = probability_better(scores, before.scores(share))
            tried.append((candidate, better))
            nats = float(np.sum(scores - before.scores(share)))
            useful = better >= ACCEPT and worthwhile(before, held, nats)
            if useful and identified(candidate, fit, self.workers.context.segments, current.chi2):
                able.append((candidate, scores, self.unusual(candidate, fit)))
        if not able:
            return None, tuple(tried)
        weights = model_weights(np.vstack([scores for _, scores, _ in able]), [odd for _, _, odd in able])
        winner = able[int(np.argmax(weights))][0]
        rivals = tuple(candidate for candidate, _ in fits if candidate is not winner)[:RIVALS]
        better = next(p for candidate, p in tried if candidate is winner)
        return Chosen(winner, better, rivals, dict(self._twins), (), current.chi2), tuple(tried)

    def unusual(self, candidate: Candidate, fit: Fit) -> float:
        """How unlikely a candidate is but for the residuals, in free parameters.

        Beforehand; as fitted, where it may be at the edge of another law, or larger than such a thing ever is; and by
        how far the rig's own parameters must then lie from what is stated.
        """
        usual = math.log(likelihood_here(candidate, self.given)) / math.log(OCCAM)
        rare = 0.0
        if isinstance(candidate, EffectCandidate):
            rare = candidate.rarity(fit.plant, fit.values, self.scales) * math.log(10.0) / math.log(OCCAM)
        return degenerate(candidate, fit) + rare + fit.departure / (2.0 * math.log(OCCAM)) - usual

    def replace_earlier(self, current: Fit, chosen: list[Chosen]) -> tuple[Fit, list[Chosen]]:
        """Let a rival take the place of an effect that joined earlier, where the plant then fits clearly better.

        Of rivals that fit about as well the likeliest beforehand: what is simple leaves least to be mistaken later.
        """
        for number, one in enumerate(chosen[:-1]):
            swapped = self.swapped(self.without(current, one), one)
            if not swapped or swapped[0][1].chi2 >= CLEARLY * current.chi2:
                continue
            near = [pair for pair in swapped if CLEARLY * pair[1].chi2 < swapped[0][1].chi2]
            rival, fit = min(near, key=lambda pair: self.unusual(*pair))
            ((_, current),) = self.polished([(rival, fit)])
            self.outlook.say(f"replacing {label_of(one.candidate)} by {label_of(rival)}")
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
            self.outlook.begin("replace", f"trying {names} for {label_of(one.candidate)}")
        tasks = [
            FitTask(p.candidate.joined(absent.plant, p.start), absent, p.values) for p in starts.values()
        ]
        fits = [(p.candidate, fit) for p, fit in zip(starts.values(), self.fitted(tasks), strict=True)]
        return sorted(fits, key=lambda pair: pair[1].chi2)

    def contest(self, final: Fit, one: Chosen) -> Chosen:
        """Weights of one effect and its rivals, with all other effects in place."""
        segments = self.workers.context.segments
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
        rivals = [(one.candidate, final), *close]
        shares = model_weights(scores, [self.unusual(candidate, fit) for candidate, fit in rivals])
        if self.unseen and close:
            fits = [fit for _, fit in rivals]
            shares = pooled(shares, weights_on(self.unseen, fits, self.workers.context.sigmas))
        weights = [(candidate, float(w)) for (candidate, _), w in zip(rivals, shares, strict=True)]
        probable = {candidate.key: weight for candidate, weight in weights}
        able = [pair for pair in close if identified(*pair, segments, absent.chi2)]
        # The plant without the effect is scored on the very data it was fitted to, which can only flatter it.
        lacking = in_sample(absent, segments).scores(share)
        return replace(
            one,
            weights=tuple(sorted(weights, key=lambda item: -item[1])),
            probability_better=probability_better(scores[0], lacking),
            chi2_without=absent.chi2,
            absent=absent,
            rival_fit=max(able, key=lambda pair: probable[pair[0].key], default=None),
        )
