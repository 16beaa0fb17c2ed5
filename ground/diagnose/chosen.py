"""What the search for names ends with: the effects that joined, their rivals, and what was tried in vain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ground.diagnose.candidates import Candidate
from ground.diagnose.fit import Fit
from ground.diagnose.screen import Promise

Twins = tuple[tuple[Candidate, float], ...]


@dataclass(frozen=True)
class Chosen:
    """An effect in the extended plant, its rivals with their weights, and what the plant is like without it.

    `twins`, by the key of the effect or a rival, act like it on these recordings: nothing but where they usually
    occur, and how large, speaks for one of them; each comes with its odds beside its like's own. `rival_fit` is the
    plant with its most probable rival in its place, `absent` that with nothing there.
    """

    candidate: Candidate
    probability_better: float
    rivals: tuple[Candidate, ...]
    twins: Mapping[str, Twins]
    weights: tuple[tuple[Candidate, float], ...] = ()
    chi2_without: float = 0.0
    rival_fit: tuple[Candidate, Fit] | None = None
    absent: Fit | None = None

    def outdone_by(self, left: frozenset[str]) -> tuple[Candidate, Fit] | None:
        """The most probable rival with its plant, where it outdoes the effect; none of those that have `left`."""
        if self.rival_fit is None or self.rival_fit[0].key in left:
            return None
        weights = {candidate.key: weight for candidate, weight in self.weights}
        own, its = weights.get(self.candidate.key, 0.0), weights.get(self.rival_fit[0].key, 0.0)
        return self.rival_fit if its > own else None


@dataclass(frozen=True)
class Named:
    """The end of the search: the extended fit, what joined, and what was tried in the last round in vain.

    `screened` is what every other candidate promised in the last round, and how little of it would have been seen.
    """

    fit: Fit
    chosen: tuple[Chosen, ...]
    refused: tuple[tuple[Candidate, float], ...]
    screened: tuple[Promise, ...]
