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

from ground.diagnose.candidates import Candidate, Scales, candidates, ranges_of
from ground.diagnose.crossval import HeldOut, cross_validate
from ground.diagnose.fit import Fit, fit_plant
from ground.diagnose.scoring import effective_share, model_weights, probability_better
from ground.diagnose.screen import screen
from ground.diagnose.segments import Segment
from sim_hal.plant.simulate import Plant

Float = NDArray[np.float64]
Progress = Callable[[str], None]

ACCEPT = 0.95
SCREENED = 5
"""Candidates that get a full fit in each round."""
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

    def __init__(
        self, segments: Sequence[Segment], sigmas: Float, scales: Scales, progress: Progress
    ) -> None:
        self.segments = tuple(segments)
        self.sigmas = sigmas
        self.scales = scales
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
        final = tuple(self.contest(current, one, chosen) for one in chosen)
        return Named(current, final, refused)

    def fit_best(self, current: Fit) -> list[tuple[Candidate, Fit]]:
        """The candidates that the residuals ask for most, each fitted in full with the plant as it stands."""
        self.progress("screening all effects")
        offered = candidates(current.plant, self.scales)
        fits = []
        for candidate in screen(current, offered, self.segments, self.sigmas)[:SCREENED]:
            self.progress(f"fitting {candidate.label}")
            fits.append((candidate, self.fit(current.plant.with_effect(candidate.uses[0]), current)))
        return fits

    def fit(self, plant: Plant, near: Fit) -> Fit:
        """Full fit of a plant, from the values of a fit nearby."""
        return fit_plant(plant, self.segments, self.sigmas, ranges_of(plant, self.scales), near.values)

    def held_out(self, fit: Fit, label: str) -> HeldOut:
        """Cross-validated residuals of a fit; each set of effects is done once."""
        key = tuple(sorted(fit.plant.prefix(use) for use in fit.plant.effects))
        if key not in self._held_out:
            self.progress(f"cross-validating {label}")
            ranges = ranges_of(fit.plant, self.scales)
            self._held_out[key] = cross_validate(fit, self.segments, self.sigmas, ranges)
        return self._held_out[key]

    def best_of(
        self, current: Fit, fits: Sequence[tuple[Candidate, Fit]]
    ) -> tuple[Chosen | None, tuple[tuple[Candidate, float], ...]]:
        """The candidate that joins, or None; and each candidate's probability of predicting better."""
        if not fits:
            return None, ()
        least = min(fit.chi2 for _, fit in fits)
        close = [(candidate, fit) for candidate, fit in fits if fit.chi2 <= CLOSE * least]
        share = self.share(min((fit for _, fit in close), key=lambda fit: fit.chi2))
        before = self.held_out(current, "the plant as it stands")
        tried: list[tuple[Candidate, float]] = []
        able: list[tuple[Candidate, Float]] = []
        for candidate, fit in close:
            after = self.held_out(fit, candidate.label)
            better = probability_better(after.scores(share), before.scores(share))
            tried.append((candidate, better))
            worthwhile = after.mean_square < (1.0 - WORTHWHILE) * before.mean_square
            if better >= ACCEPT and worthwhile and identified(candidate, fit):
                able.append((candidate, after.scores(share)))
        if not able:
            return None, tuple(tried)
        weights = model_weights(np.vstack([scores for _, scores in able]))
        winner = able[int(np.argmax(weights))][0]
        rivals = tuple(candidate for candidate, _ in close if candidate is not winner)
        better = next(p for candidate, p in tried if candidate is winner)
        return Chosen(winner, better, rivals, (), current.chi2), tuple(tried)

    def share(self, fit: Fit) -> Float:
        """Effective samples per sample, by output, as the residuals of the best fit tell them."""
        return effective_share(fit.residuals.reshape(-1, self.segments[0].observed.shape[1]))

    def replace_earlier(self, current: Fit, chosen: list[Chosen]) -> tuple[Fit, list[Chosen]]:
        """Let a rival take the place of an effect that joined earlier, where the plant then fits clearly better."""
        for number, one in enumerate(chosen[:-1]):
            for rival in one.rivals:
                swapped = self.swapped(current, one.candidate, rival)
                if swapped is None or swapped.chi2 >= CLEARLY * current.chi2:
                    continue
                self.progress(f"replacing {one.candidate.label} by {rival.label}")
                others = tuple(c for c in (one.candidate, *one.rivals) if c is not rival)
                chosen[number] = replace(one, candidate=rival, rivals=others)
                current = swapped
                break
        return current, chosen

    def swapped(self, current: Fit, out: Candidate, into: Candidate) -> Fit | None:
        """Full fit with one effect in another's place; None where that one is in the plant already."""
        use = into.uses[0]
        prefixes = {current.plant.prefix(other) for other in current.plant.effects}
        if current.plant.prefix(use) in prefixes:
            return None
        self.progress(f"trying {into.label} for {out.label}")
        return self.fit(without(current.plant, out).with_effect(use), current)

    def contest(self, final: Fit, one: Chosen, chosen: Sequence[Chosen]) -> Chosen:
        """Weights of one effect and its rivals, with all other effects in place."""
        held = {one.candidate: self.held_out(final, "the extended plant")}
        absent = self.fit(without(final.plant, one.candidate), final)
        for rival in one.rivals:
            fit = self.swapped(final, one.candidate, rival)
            if fit is not None and fit.chi2 <= CLOSE * final.chi2:
                held[rival] = self.held_out(fit, f"{rival.label} for {one.candidate.label}")
        share = self.share(final)
        scores = np.vstack([residuals.scores(share) for residuals in held.values()])
        weights = sorted(zip(held, map(float, model_weights(scores)), strict=True), key=lambda item: -item[1])
        lacking = self.held_out(absent, f"the plant without {one.candidate.label}").scores(share)
        better = probability_better(scores[0], lacking)
        return replace(one, weights=tuple(weights), probability_better=better, chi2_without=absent.chi2)


def without(plant: Plant, candidate: Candidate) -> Plant:
    """The plant with one effect taken out."""
    prefix = plant.prefix(candidate.uses[0])
    return replace(plant, effects=tuple(use for use in plant.effects if plant.prefix(use) != prefix))


def identified(candidate: Candidate, fit: Fit) -> bool:
    """Whether the effect's strength is told apart from zero by its own fit."""
    names = candidate.strengths(fit.plant)
    return any(abs(fit.values[name]) > STRENGTH_SIGMAS * fit.std[name] for name in names)
