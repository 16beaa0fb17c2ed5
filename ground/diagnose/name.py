"""Name what is missing: every effect competes on equal terms, and what wins must win where it was not fitted.

Forward from the refitted plant: each round screens all effects by score test, fits the best few in full, and compares
them, with the plant as it stands, on segments left out in turn. The best joins when it predicts better with
probability `ACCEPT`. Two effects can stand in for each other until a third is known, so after each round every effect
that joined earlier may be replaced by a rival of its round. At the end each is set against its rivals once more, with
all the others in place: that contest gives the probabilities.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ground.diagnose.candidates import Candidate, candidates
from ground.diagnose.crossval import HeldOut, in_sample
from ground.diagnose.fit import Fit
from ground.diagnose.scoring import effective_share, model_weights, probability_better
from ground.diagnose.screen import screen
from ground.diagnose.workers import FitTask, Workers, fit_job, validate_job
from sim_hal.plant.simulate import Plant

Float = NDArray[np.float64]
Progress = Callable[[str], None]

ACCEPT = 0.95
SCREENED = 5
"""Candidates that get a full fit in each round."""
RIVALS = 3
"""Fitted candidates that go on to cross-validation at the most."""
CLOSE = 2.0
"""Fitted candidates within this factor of the best one's chi-square go on to cross-validation."""
MOST_EFFECTS = 6
STRENGTH_SIGMAS = 3.0
"""An effect whose strength is not this many of its own sigmas from zero is not identified."""
WORTHWHILE = 0.01
"""Least share of the remaining squared residual that an effect must remove where it was not fitted."""
CLEARLY = 0.9
"""A rival replaces an effect when its chi-square is below this share of the present one's."""


@dataclass(frozen=True)
class Chosen:
    """An effect in the extended plant: its rivals with their weights, and what the plant is like without it."""

    candidate: Candidate
    probability_better: float
    rivals: tuple[Candidate, ...]
    weights: tuple[tuple[Candidate, float], ...]
    chi2_without: float


@dataclass(frozen=True)
class Named:
    """The end of the search: the extended fit, what joined, and what was tried in the last round in vain."""

    fit: Fit
    chosen: tuple[Chosen, ...]
    refused: tuple[tuple[Candidate, float], ...]


class Search:
    """Forward selection of effects on given segments, with replacement."""

    def __init__(self, workers: Workers, progress: Progress) -> None:
        self.workers = workers
        self.progress = progress
        self._held_out: dict[tuple[str, ...], HeldOut] = {}

    def run(self, refit: Fit) -> Named:
        """Add effects one by one until none predicts better."""
        current = refit
        chosen: list[Chosen] = []
        while True:
            fits = self.fit_best(current) if len(chosen) < MOST_EFFECTS else []
            best, refused = self.best_of(current, fits)
            if best is None:
                break
            self.progress(f"found {best.candidate.label}")
            current = next(fit for candidate, fit in fits if candidate is best.candidate)
            chosen.append(best)
            current, chosen = self.replace_earlier(current, chosen)
        if chosen:
            self.progress("settling the extended plant")
            task = FitTask(current.plant, current.values, final=True)
            (current,) = self.workers.map(fit_job, [task])
        final = tuple(self.contest(current, one) for one in chosen)
        return Named(current, final, refused)

    def fit_best(self, current: Fit) -> list[tuple[Candidate, Fit]]:
        """The candidates that the residuals ask for most, each fitted in full with the plant as it stands."""
        self.progress("screening all effects")
        context = self.workers.context
        offered = candidates(current.plant, context.scales)
        best = screen(current, offered, context.segments, context.sigmas)[:SCREENED]
        self.progress(f"fitting {', '.join(candidate.label for candidate in best)}")
        tasks = [FitTask(current.plant.with_effect(c.uses[0]), current.values) for c in best]
        fits = zip(best, self.workers.map(fit_job, tasks), strict=True)
        return sorted(fits, key=lambda pair: pair[1].chi2)

    def fit_all(self, plants: Sequence[Plant], near: Fit) -> list[Fit]:
        """Full fits of plants, from the values of a fit nearby."""
        return list(self.workers.map(fit_job, [FitTask(plant, near.values) for plant in plants]))

    def held_out(self, fits: Sequence[Fit], label: str) -> list[HeldOut]:
        """Cross-validated residuals of fits; each set of effects is done once."""
        keys = [tuple(sorted(fit.plant.prefix(use) for use in fit.plant.effects)) for fit in fits]
        new = {key: fit for key, fit in zip(keys, fits, strict=True) if key not in self._held_out}
        if new:
            self.progress(f"cross-validating {label}")
            found = self.workers.map(validate_job, list(new.values()))
            self._held_out.update(zip(new, found, strict=True))
        return [self._held_out[key] for key in keys]

    def best_of(
        self, current: Fit, fits: Sequence[tuple[Candidate, Fit]]
    ) -> tuple[Chosen | None, tuple[tuple[Candidate, float], ...]]:
        """The candidate that joins, or None; and each candidate's probability of predicting better."""
        if not fits:
            return None, ()
        close = [(candidate, fit) for candidate, fit in fits if fit.chi2 <= CLOSE * fits[0][1].chi2][:RIVALS]
        share = self.share(fits[0][1])
        label = f"the plant as it stands, {', '.join(candidate.label for candidate, _ in close)}"
        before, *after = self.held_out([current, *(fit for _, fit in close)], label)
        tried: list[tuple[Candidate, float]] = []
        able: list[tuple[Candidate, Float]] = []
        for (candidate, fit), held in zip(close, after, strict=True):
            better = probability_better(held.scores(share), before.scores(share))
            tried.append((candidate, better))
            worthwhile = held.mean_square < (1.0 - WORTHWHILE) * before.mean_square
            if better >= ACCEPT and worthwhile and identified(candidate, fit):
                able.append((candidate, held.scores(share)))
        if not able:
            return None, tuple(tried)
        weights = model_weights(np.vstack([scores for _, scores in able]), [c.parameters for c, _ in able])
        winner = able[int(np.argmax(weights))][0]
        rivals = tuple(candidate for candidate, _ in close if candidate is not winner)
        better = next(p for candidate, p in tried if candidate is winner)
        return Chosen(winner, better, rivals, (), current.chi2), tuple(tried)

    def share(self, fit: Fit) -> Float:
        """Effective samples per sample, by output, as the residuals of the best fit tell them."""
        return effective_share(fit.residuals.reshape(-1, self.workers.context.segments[0].observed.shape[1]))

    def replace_earlier(self, current: Fit, chosen: list[Chosen]) -> tuple[Fit, list[Chosen]]:
        """Let a rival take the place of an effect that joined earlier, where the plant then fits clearly better."""
        for number, one in enumerate(chosen[:-1]):
            swapped = self.swapped(current, one)
            if not swapped or swapped[0][1].chi2 >= CLEARLY * current.chi2:
                continue
            rival, current = swapped[0]
            self.progress(f"replacing {one.candidate.label} by {rival.label}")
            others = tuple(c for c in (one.candidate, *one.rivals) if c is not rival)
            chosen[number] = replace(one, candidate=rival, rivals=others)
        return current, chosen

    def swapped(self, current: Fit, one: Chosen) -> list[tuple[Candidate, Fit]]:
        """Full fits with each rival in an effect's place, best first; rivals already in the plant are left out."""
        prefixes = {current.plant.prefix(use) for use in current.plant.effects}
        rivals = [c for c in one.rivals if current.plant.prefix(c.uses[0]) not in prefixes]
        if rivals:
            self.progress(f"trying {', '.join(c.label for c in rivals)} for {one.candidate.label}")
        plants = [without(current.plant, one.candidate).with_effect(c.uses[0]) for c in rivals]
        return sorted(zip(rivals, self.fit_all(plants, current), strict=True), key=lambda pair: pair[1].chi2)

    def contest(self, final: Fit, one: Chosen) -> Chosen:
        """Weights of one effect and its rivals, with all other effects in place."""
        absent = self.fit_all([without(final.plant, one.candidate)], final)[0]
        close = [(c, fit) for c, fit in self.swapped(final, one) if fit.chi2 <= CLOSE * final.chi2][:RIVALS]
        names = [one.candidate, *(candidate for candidate, _ in close)]
        held = self.held_out([final, *(fit for _, fit in close)], f"{one.candidate.label} and its rivals")
        share = self.share(final)
        scores = np.vstack([residuals.scores(share) for residuals in held])
        weights = zip(names, map(float, model_weights(scores, [c.parameters for c in names])), strict=True)
        # The plant without the effect is scored on the very data it was fitted to, which can only flatter it.
        context = self.workers.context
        lacking = in_sample(absent, context.segments).scores(share)
        return replace(
            one,
            weights=tuple(sorted(weights, key=lambda item: -item[1])),
            probability_better=probability_better(scores[0], lacking),
            chi2_without=absent.chi2,
        )


def without(plant: Plant, candidate: Candidate) -> Plant:
    """The plant with one effect taken out."""
    prefix = plant.prefix(candidate.uses[0])
    return replace(plant, effects=tuple(use for use in plant.effects if plant.prefix(use) != prefix))


def identified(candidate: Candidate, fit: Fit) -> bool:
    """Whether the effect's strength is told apart from zero by its own fit."""
    names = candidate.strengths(fit.plant)
    return any(abs(fit.values[name]) > STRENGTH_SIGMAS * fit.std[name] for name in names)
