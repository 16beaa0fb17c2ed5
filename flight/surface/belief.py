"""The belief in few figures, for the report of a hop, the log and the page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from flight.surface.compaction import LAWS
from flight.surface.forecast import forecast_loss
from flight.surface.known import UNKNOWN
from flight.surface.priors import c3_of
from flight.surface.tracker import Tracker

UNDECIDED = "undecided"
NINETY_FIVE = (0.025, 0.975)


@dataclass(frozen=True)
class GroundBelief:
    """What is believed of the ground underfoot after a hop.

    `c3_mean`, `c3_std`: the ground's own C3 as this hop met it. `next_c3_low`, `next_c3_high`: 95 % interval of what
    a hop of the same energy would measure next. `said`: a surface's name, none of the known, or undecided.
    `changed`: probability that the ground changed before this hop or the one before; `change` in which way.
    `hops`: on this spot. `laws`: probability of each law of compaction.
    """

    c3_mean: float
    c3_std: float
    next_c3_low: float
    next_c3_high: float
    probabilities: Mapping[str, float]
    said: str
    changed: float
    change: str
    hops: int
    laws: Mapping[str, float]

    @property
    def most_probable(self) -> str:
        """The surface with the highest probability, or none of the known."""
        return max(self.probabilities, key=lambda name: self.probabilities[name])

    def as_payload(self) -> dict[str, Any]:
        """As JSON-able data."""
        return {
            "c3_mean": self.c3_mean,
            "c3_std": self.c3_std,
            "next_c3_low": self.next_c3_low,
            "next_c3_high": self.next_c3_high,
            "hops": self.hops,
            "surfaces": dict(self.probabilities),
            "said": self.said,
            "changed": self.changed,
            "change": self.change,
            "laws": dict(self.laws),
        }


def belief_of(tracker: Tracker, energy_j: float) -> GroundBelief:
    """The belief after a hop of `energy_j` that the tracker has seen."""
    seen = -tracker.dose_of(energy_j) if tracker.hops else 0.0
    now = forecast_loss(tracker, energy_j, seen, with_common=False)
    low, high = forecast_loss(tracker, energy_j).quantiles(NINETY_FIVE)
    run = max(tracker.runs, key=lambda each: each.log_weight)
    by_law = run.mixture.by(run.mixture.laws, len(LAWS))
    laws = dict.fromkeys(dict.fromkeys(law.name for law in LAWS), 0.0)
    for law, share in zip(LAWS, by_law, strict=True):
        laws[law.name] += float(share)
    chances = probabilities(tracker)
    return GroundBelief(
        c3_mean=c3_of(now.mean),
        c3_std=now.std * (1.0 - c3_of(now.mean)),
        next_c3_low=c3_of(float(low)),
        next_c3_high=c3_of(float(high)),
        probabilities=chances,
        said=said_of(tracker, chances),
        changed=tracker.changed_within(2),
        change=tracker.kind_of_change(),
        hops=tracker.hops - run.start,
        laws=laws,
    )


def probabilities(tracker: Tracker) -> dict[str, float]:
    """Probability of each surface, and of none of the known."""
    return dict(zip(tracker.ground.names, map(float, tracker.probabilities_array()), strict=True))


def said_of(tracker: Tracker, chances: Mapping[str, float]) -> str:
    """The name that the probabilities allow; undecided where they allow none."""
    decision = tracker.ground.settings.decision
    if chances[UNKNOWN] >= decision.novel:
        return UNKNOWN
    name = tracker.ground.names[int(np.argmax(tracker.probabilities_array()[:-1]))]
    return name if chances[name] >= decision.named else UNDECIDED
