"""What an explanation must do to be accepted, beyond predicting better: be told from nothing, be worth its name."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ground.diagnose.candidates import FLIGHT, Candidate, EffectCandidate
from ground.diagnose.crossval import HeldOut
from ground.diagnose.fit import Fit
from ground.diagnose.problem import sample_shifts
from ground.diagnose.released import ReleasedParameter
from ground.diagnose.scoring import OCCAM
from ground.diagnose.segments import Segment
from sim_hal.plant.simulate import Plant

STRENGTH_SIGMAS = 3.0
"""An effect whose strength is not this many of its own sigmas from zero is not identified."""
OBVIOUS = 0.1
"""An effect that leaves less than this share of chi-square is there, though its size may not be told: a delay of less
than a sample, of a reading that only moves at samples."""
LOST_SIGMAS = 2.0
"""One whose strength comes this near to zero once all others are in place is no finding any more."""
LEAST_SIGMA = 1e-300
LEAST_SHIFT = 0.05
"""A channel that is shifted in time by less than this share of the interval between samples, all through, is in step:
when in it a reading was taken, or a held input changed, no recording says so well."""
WORTHWHILE = 0.05
"""Least share of the remaining squared residual that an effect must remove where it was not fitted ..."""
OF_EXCESS = 0.1
"""... or else of what exceeds the sensors' noise, ..."""
EDGE_SIGMAS = 2.0
TOLD = 0.1
"""A parameter is at an edge of its range when it is this near to it, and told to this share of the range."""
NATS = 10.0
"""... and then with at least this gain in log predictive density."""
ELSEWHERE = (FLIGHT, "ground_contact", "body_momentum", "leg_momentum", "latch")
ELSEWHERE_ODDS = 0.1


def likelihood_here(candidate: Candidate, plant: Plant) -> float:
    """Prior odds that one of several laws that act alike is the one at work here.

    A rig is more often a mechanism than a body in the air or on soil, but for what its plant file calls ballistic.
    Further parameters cost what they cost in every comparison.
    """
    simple = OCCAM**-candidate.parameters
    home = candidate.effect.equation if isinstance(candidate, EffectCandidate) else candidate.equation
    if plant.kind in ("drive", "hop") or home == "sensor":
        return simple
    usual = candidate.equation == FLIGHT or home not in ELSEWHERE
    return simple if usual else ELSEWHERE_ODDS * simple


def degenerate(candidate: Candidate, fit: Fit) -> int:
    """How many of a law's shape parameters the fit has driven to an edge of their range, where it is another law.

    A spring-like friction that needs no travel to build up is dry friction; it must not win by a hair over that.
    """
    shapes = set(fit.values) - set(candidate.strengths())
    count = 0
    for free, z in zip(fit.free, fit.z, strict=True):
        if free.name in shapes and free.name.startswith(f"{candidate.key}."):
            low, high = free.bounds()
            sigma = fit.std[free.name] / free.scale
            near = min(z - low, high - z) < EDGE_SIGMAS * sigma
            count += near and sigma < TOLD * (high - low)
    return count


def worthwhile(before: HeldOut, after: HeldOut, nats: float) -> bool:
    """Whether an effect removes enough of what was left where it was not fitted."""
    removed = before.mean_square - after.mean_square
    excess = before.mean_square - 1.0
    return removed > WORTHWHILE * before.mean_square or (removed > OF_EXCESS * excess and nats > NATS)


def identified(candidate: Candidate, fit: Fit, segments: Sequence[Segment], without: float) -> bool:
    """Whether the effect is told from nothing (a tolerance: from what was stated), chi-square `without` it."""
    return significance(candidate, fit, segments, without) > STRENGTH_SIGMAS


def significance(candidate: Candidate, fit: Fit, segments: Sequence[Segment], without: float) -> float:
    """How many of its own sigmas an effect's strength is from zero by its own fit.

    Infinite for one that is obvious beside chi-square `without` it, and for one without parameters; none for a shift
    in time too small for any recording to tell. Of an effect that acts as a whole the best told parameter counts:
    where none is told, nothing acts.

    Its other parameters count as known: without strength they mean nothing, and one that no recording tells must
    not hide an effect that every recording shows.
    """
    if fit.chi2 < OBVIOUS * without:
        return math.inf
    if isinstance(candidate, ReleasedParameter):
        away = abs(fit.values[candidate.key] - candidate.stated)
        return float(away / max(candidate.tolerance, fit.std[candidate.key]))
    own = [name for name in fit.values if name.startswith(f"{candidate.key}.")]
    strengths = [name for name in candidate.strengths() if name in fit.values]
    one_sample = sample_shifts(fit.plant, segments)
    if any(abs(fit.values[n]) < LEAST_SHIFT * one_sample[n] for n in strengths if n in one_sample):
        return 0.0
    known = [name for name in own if name not in strengths] if strengths else []
    std = fit.std_given(known, segments)
    told = (abs(fit.values[name]) / max(std[name], LEAST_SIGMA) for name in strengths or own)
    return max(told, default=math.inf)
