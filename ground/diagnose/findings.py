"""From the search's end to findings in the contract's terms, and the verdict."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ground.diagnose.ask import propose
from ground.diagnose.candidates import Candidate
from ground.diagnose.chosen import Chosen, Named
from ground.diagnose.combinations import told_combinations, untold
from ground.diagnose.crossval import in_sample
from ground.diagnose.evidence import LocatedForce
from ground.diagnose.fit import Fit
from ground.diagnose.result import Alternative, Estimate, Finding, Interval, Verdict
from ground.diagnose.scoring import whiteness_p
from ground.diagnose.segments import Segment
from ground.diagnose.tension import listed
from sim_hal.plant.effects.unlisted import PHYSICS_ID as UNLISTED
from sim_hal.plant.expressions import to_text
from sim_hal.plant.simulate import Plant
from sim_hal.plant.units import dimension, sound_unit_of

Float = NDArray[np.float64]

EXCESS_OF_BUILT_IN = 1.1
SURELY_NO_NOISE = 1e-6
UNDECIDED = 0.5
"""Kind and place less probable than this are not claimed: the verdict is then undecidable."""
EXCESS = 1.5
"""Standardised rms above which residuals say that something is there, though no candidate explains it."""
NEARLY, FAR_BEYOND = 0.5, 10.0
"""Rms above which they say so as well where the sensor is much finer than a model is judged: in what that is judged
by, and in sigmas of the sensor itself."""
STILL_OPEN = 0.02
"""An alternative more probable than this is worth a run."""
SHARE_OF_GAIN = 0.8
"""The intervals named are the stretches that bring this share of the improvement."""
PHASES = {
    "magnet": "release",
    "latch": "release",
    "ground_contact": "stance",
    "body_momentum": "stance",
    "leg_momentum": "stance",
    "ballistic": "flight",
}


def findings_of(
    named: Named, refit: Fit, segments: Sequence[Segment], forces: Sequence[LocatedForce]
) -> tuple[Finding, ...]:
    """One finding for each effect that joined the plant, the one whose absence would cost the most first."""
    by_size = sorted(named.chosen, key=lambda chosen: -chosen.chi2_without)
    return tuple(finding_of(chosen, named.fit, refit, segments, forces) for chosen in by_size)


def finding_of(
    chosen: Chosen, fit: Fit, refit: Fit, segments: Sequence[Segment], forces: Sequence[LocatedForce]
) -> Finding:
    """One effect in the contract's terms."""
    candidate = chosen.candidate
    parameters = candidate.estimates(fit.plant, fit.values, fit.std)
    rivals = shared_with_twins(chosen)
    known = 1.0 if candidate.physics_id == UNLISTED else listed(fit) * accounted(fit, refit, segments)
    own = known * next(w for c, w in rivals if c is candidate)
    return Finding(
        kind=candidate.kind,
        phase=phase_of(candidate, fit),
        equation=candidate.equation,
        channels=channels_of(candidate, fit, refit),
        intervals=intervals_of(fit, refit, segments),
        regime=regime_of(candidate, forces),
        physics_id=candidate.physics_id,
        probability=own,
        alternatives=tuple(Alternative(c.physics_id, known * w) for c, w in rivals if c is not candidate),
        statement=statement_of(candidate, parameters, fit, segments),
        formula=candidate.formula(fit.plant),
        parameters=parameters,
    )


def statement_of(
    candidate: Candidate, parameters: Mapping[str, Estimate], fit: Fit, segments: Sequence[Segment]
) -> str:
    """The effect in words; of parameters that are not told each by itself, the combinations that are."""
    text = candidate.statement(parameters) + what_moves(candidate, fit.plant)
    vague = [name for name, e in parameters.items() if untold(e)]
    if not vague:
        return text
    told = told_combinations(candidate.key, parameters, fit, segments)
    return f"{text} These recordings hardly tell {' and '.join(vague)} alone" + (
        f"; they do tell {' and '.join(told)}." if told else "."
    )


def what_moves(candidate: Candidate, plant: Plant) -> str:
    """What speed and position are in an equation in which nothing moves: a tank's level, a temperature."""
    balance = plant.structure.balances.get(candidate.equation)
    if (
        candidate.kind != "physics"
        or plant.kind != "equations"
        or balance is None
        or balance.velocity is None
    ):
        return ""
    units = plant.structure.units()
    if sound_unit_of(balance.velocity, units) in (dimension("m/s"), dimension("rad/s")):
        return ""
    meant = [("speed", balance.velocity), ("position", balance.position)]
    words = [f"{word} is {to_text(node)}" for word, node in meant if node is not None]
    loss = "friction" in candidate.physics_id
    still = (
        "; nothing moves, and what is called friction is a loss by the same law, as of a leak" if loss else ""
    )
    return f" Here {' and '.join(words)}{still}."


def shared_with_twins(chosen: Chosen) -> list[tuple[Candidate, float]]:
    """Probabilities of the effect, its rivals and their twins, largest first; twins share by their prior odds.

    What acts alike from one start but was told apart when fitted from another is a rival and no twin.
    """
    rivals = {candidate.key for candidate, _ in chosen.weights}
    found: dict[str, tuple[Candidate, float]] = {}
    for candidate, weight in chosen.weights:
        twins = ((c, odd) for c, odd in chosen.twins.get(candidate.key, ()) if c.key not in rivals)
        alike = ((candidate, 1.0), *twins)
        whole = sum(odd for _, odd in alike)
        for one, odd in alike:
            _, before = found.get(one.key, (one, 0.0))
            found[one.key] = one, before + weight * chosen.probability_better * odd / whole
    return sorted(found.values(), key=lambda item: -item[1])


def phase_of(candidate: Candidate, fit: Fit) -> str:
    """The phase of the taxonomy that an effect shows in."""
    if candidate.kind == "sensor" or fit.plant.kind not in ("drive", "hop"):
        return "whole_run"
    return "tensioning" if fit.plant.kind == "drive" else PHASES.get(candidate.equation, "whole_run")


def channels_of(candidate: Candidate, fit: Fit, refit: Fit) -> tuple[str, ...]:
    """The channels in which the extended plant fits better, the most improved first."""
    if candidate.channel is not None:
        return (candidate.channel,)
    names = tuple(fit.plant.structure.outputs)
    before = np.sum(refit.residuals.reshape(-1, len(names)) ** 2, axis=0)
    after = np.sum(fit.residuals.reshape(-1, len(names)) ** 2, axis=0)
    gained = before - after
    order = np.argsort(gained)[::-1]
    return tuple(names[i] for i in order if gained[i] > 0.05 * gained.max())


def intervals_of(fit: Fit, refit: Fit, segments: Sequence[Segment], most: int = 8) -> tuple[Interval, ...]:
    """The stretches of the fitted recordings that the improvement comes from, neighbours joined."""
    gains, places = [], []
    offset = 0
    for segment in segments:
        size = segment.observed.size
        width = segment.observed.shape[1]
        power = refit.residuals[offset : offset + size] ** 2 - fit.residuals[offset : offset + size] ** 2
        offset += size
        edges = np.linspace(0, segment.samples, 9).round().astype(int)
        for a, b in itertools.pairwise(edges):
            if b > a:
                gains.append(float(power.reshape(-1, width)[a:b].sum()))
                places.append(Interval(segment.run_name, *map(float, segment.run.times_s[[a, b - 1]])))
    order = np.argsort(gains)[::-1]
    total = sum(gain for gain in gains if gain > 0.0)
    reached, kept = 0.0, []
    for i in order:
        if reached >= SHARE_OF_GAIN * total or gains[i] <= 0.0:
            break
        reached += gains[i]
        kept.append(int(i))
    return join([places[i] for i in sorted(kept)])[:most]


def join(intervals: Sequence[Interval]) -> tuple[Interval, ...]:
    """Neighbouring intervals of one run as one."""
    joined: list[Interval] = []
    for interval in intervals:
        last = joined[-1] if joined else None
        if (
            last
            and last.run == interval.run
            and interval.from_s - last.to_s < 0.05 * (interval.to_s - last.from_s)
        ):
            joined[-1] = Interval(last.run, last.from_s, interval.to_s)
        else:
            joined.append(interval)
    return tuple(joined)


def regime_of(candidate: Candidate, forces: Sequence[LocatedForce]) -> str:
    """In words, what the missing force of this equation depends on."""
    force = next((f for f in forces if f.equation == candidate.equation), None)
    if force is None:
        return "Regime not resolved."
    cause, share = max(force.explained.items(), key=lambda item: item[1])
    if share < 0.2:
        return "The missing force of this equation follows none of speed, position, load or time alone."
    return f"Before the extension, {cause} alone explains {share:.0%} of this equation's missing force."


def verdict_of(named: Named, refit: Fit, segments: Sequence[Segment], finer: Float) -> Verdict:
    """Mismatch when it is told what lacks; undecidable when something is there and the data do not say what.

    `finer` (outputs,) is how many times finer each sensor is than a model of the rig is judged.
    """
    share = accounted(named.fit, refit, segments)
    if any(share * told_where(chosen, named.fit.plant) >= UNDECIDED for chosen in named.chosen):
        return "mismatch"
    there = unexplained(named.fit, segments) or beyond(named.fit, segments, finer)
    return "undecidable" if named.chosen or there else "consistent"


def accounted(fit: Fit, refit: Fit, segments: Sequence[Segment]) -> float:
    """Share of what exceeded the noise that the extended plant explains; 1 where what it leaves may be noise.

    A law of the catalogue may take half of what another, which is in none, has done; it is not at work for that.
    """
    if not unexplained(fit, segments):
        return 1.0
    noise = sum(int(np.isfinite(segment.observed).sum()) for segment in segments)
    excess, left = refit.chi2 - noise, fit.chi2 - noise
    return float(np.clip(1.0 - left / excess, 0.0, 1.0)) if excess > 0.0 else 1.0


def beyond(fit: Fit, segments: Sequence[Segment], finer: Float) -> bool:
    """Whether a sensor that is finer than a model is judged by sees errors far beyond its noise, and no noise."""
    channels = in_sample(fit, segments).by_channel()
    for channel, factor in zip(channels, finer, strict=True):
        seen = channel[np.isfinite(channel)]
        rms = float(np.sqrt(np.mean(seen**2))) if seen.size else 0.0
        if rms > NEARLY and rms * factor > FAR_BEYOND and whiteness_p(channel) < SURELY_NO_NOISE:
            return True
    return False


def told_where(chosen: Chosen, plant: Plant) -> float:
    """Probability that the plant is wrong in this equation (a sensor in this channel), whatever the law's name.

    That a law is missing or a parameter is far from what is stated says the same of the equation: look there.
    """
    place = chosen.candidate.place(plant)
    return sum(weight for candidate, weight in shared_with_twins(chosen) if candidate.place(plant) == place)


def unexplained(fit: Fit, segments: Sequence[Segment]) -> bool:
    """Whether a channel's residuals are larger than its sensor's noise, and no noise.

    A rig's own noise is seldom known as well as a built-in kind's, and a rig given as equations is allowed more.
    """
    excess = EXCESS if fit.plant.kind == "equations" else EXCESS_OF_BUILT_IN
    for channel in in_sample(fit, segments).by_channel():
        seen = channel[np.isfinite(channel)]
        if seen.size and float(np.sqrt(np.mean(seen**2))) > excess and whiteness_p(channel) < SURELY_NO_NOISE:
            return True
    return False


def next_run(
    named: Named, findings: Sequence[Finding], segments: Sequence[Segment], sigmas: Float
) -> str | None:
    """What run would tell the remaining alternatives apart; None when nothing is open."""
    for chosen in named.chosen:
        finding = next(f for f in findings if f.physics_id == chosen.candidate.physics_id)
        rivals = [rival for rival in finding.alternatives if rival.probability > STILL_OPEN]
        if not rivals:
            continue
        names = f"{finding.physics_id.replace('_', ' ')} from {rivals[0].physics_id.replace('_', ' ')}"
        if chosen.rival_fit is None or chosen.rival_fit[0].physics_id != rivals[0].physics_id:
            return (
                f"No run of these kinds tells {names}: the two act alike. What would is a look at the rig, or a run "
                "with one of their causes taken away."
            )
        proposal = propose(named.fit, chosen.rival_fit[1], segments, sigmas)
        if proposal is not None:
            return (
                f"To tell {names}: {proposal.words}. The two predict it {proposal.separation:.0f} sigmas apart; "
                f"a repeat of what was recorded, {proposal.as_recorded:.0f}."
            )
    return None
