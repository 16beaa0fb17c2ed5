"""Trials of explanations: screened by score test, tried by one simulation, the most promising fitted in full."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ground.diagnose.accept import likelihood_here
from ground.diagnose.candidates import Candidate, EffectCandidate, Scales, effect_candidates, label_of
from ground.diagnose.chosen import Twins
from ground.diagnose.crossval import HeldOut, cross_validate, in_sample
from ground.diagnose.fit import Fit
from ground.diagnose.outlook import Outlook
from ground.diagnose.released import released_parameters
from ground.diagnose.scoring import effective_share
from ground.diagnose.screen import SEEN, Promise, promises_job, trial_job
from ground.diagnose.segments import Segment
from ground.diagnose.workers import FitTask, Workers, fit_job
from sim_hal.plant.simulate import Plant

Float = NDArray[np.float64]
Fitted = list[tuple[Candidate, Fit]]

TRIED = 16
"""Starts whose promise is put to the test by one simulation."""
SCREENED = 6
"""Candidates that get a full fit in each round."""
STARTS = 2
"""Starts of each candidate that are fitted at the most."""
RIVALS = 3
"""Rivals of the best candidate that are compared with it, and that may replace it later."""
HOPELESS = 30.0
"""A candidate this many units of log density behind the best is no rival."""
SAME = 0.9999
"""Two candidates whose effects on the residuals correlate this closely cannot be told apart by these recordings."""


class Trials:
    """What a search tries on given segments; remembers which candidates act alike there."""

    def __init__(
        self,
        workers: Workers,
        outlook: Outlook,
        given: Plant,
        scales: Scales,
        unseen: Sequence[Segment] = (),
    ) -> None:
        """`unseen`: windows of what no fit saw, for the last word between rivals."""
        self.workers = workers
        self.outlook = outlook
        self.given = given
        self.scales = scales
        self.unseen = unseen
        self._twins: dict[str, Twins] = {}
        self._screened: list[Promise] = []

    def fitted(self, tasks: Sequence[FitTask]) -> list[Fit]:
        """Fits in the order of the tasks."""
        return list(self.outlook.counted(self.workers.map(fit_job, tasks), tasks))

    def fit_best(self, current: Fit) -> Fitted:
        """The candidates that the residuals ask for most, each fitted with the plant as it stands, best first."""
        self.outlook.begin("screen", "screening all effects")
        leaders = self.leaders(current)
        names = dict.fromkeys(label_of(promise.candidate) for promise in leaders)
        if not leaders:
            return []
        self.outlook.begin("fit", f"fitting {', '.join(names)}")
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
            *effect_candidates(current.plant, self.scales),
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
        """Of candidates that act alike the likeliest one; the others are remembered as its twins.

        Beside what was found since, what acted alike in an earlier round may not any more.
        """
        here = {promise.candidate.key for promise in ranked}
        for key in here & self._twins.keys():
            self._twins[key] = tuple(twin for twin in self._twins[key] if twin[0].key not in here)
        kept: list[Promise] = []
        for promise in sorted(ranked, key=self.odds, reverse=True):
            like = next((p for p in kept if abs(p.direction @ promise.direction) > SAME), None)
            if like is None or like.candidate.key == promise.candidate.key:
                kept.append(promise)
                continue
            twins = self._twins.get(like.candidate.key, ())
            if all(promise.candidate.key != twin.key for twin, _ in twins):
                beside = self.odds(promise) / self.odds(like)
                self._twins[like.candidate.key] = (*twins, (promise.candidate, beside))
        return sorted(kept, key=lambda p: -p.gain)

    def odds(self, promise: Promise) -> float:
        """Prior odds of what a promise says: where such a law usually occurs, and how large it usually is."""
        candidate = promise.candidate
        usual = likelihood_here(candidate, self.given)
        if not isinstance(candidate, EffectCandidate):
            return usual
        start = candidate.uses[promise.start].parameters
        steps = dict(zip(candidate.own_strengths, promise.step, strict=True))
        sizes = {f"{candidate.key}.{n}": float(steps.get(n, 1.0)) * p.value for n, p in start.items()}
        return float(usual * 10.0 ** -candidate.rarity(self.given, sizes, self.scales))

    def held_out(self, fit: Fit) -> HeldOut:
        """How a fit predicts segments left out of it."""
        return cross_validate(fit, self.workers.context.segments, self.workers.context.sigmas)

    def share(self, fit: Fit) -> Float:
        """Effective samples per sample, by output, as the residuals of the best fit tell them."""
        return effective_share(fit.residuals.reshape(-1, self.workers.context.segments[0].observed.shape[1]))

    def total(self, fit: Fit, best: Fit, share: Float) -> float:
        """Log density of a fit's residuals at the scale of the best fit's."""
        segments = self.workers.context.segments
        scale = in_sample(best, segments).scale
        return float(np.sum(in_sample(fit, segments).scores(share, scale)))
