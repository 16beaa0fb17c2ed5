"""Screen: which explanations the residuals ask for, before any of them is fitted in full.

Rao's score test with nuisance parameters: the sensitivity of the residuals to the strength at zero, made orthogonal
to what all that is fitted already can absorb within its tolerances. The most promising are then simulated at the
strength that the line promises, since some effects (a gap, a stop, a delay) are anything but linear.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ground.diagnose.candidates import Candidate, EffectCandidate, ranges_of
from ground.diagnose.fit import Fit
from ground.diagnose.problem import FitProblem
from ground.diagnose.released import ReleasedParameter
from ground.diagnose.workers import Context

Float = NDArray[np.float64]

UNFELT = 1e-3
"""An effect that moves no reading by this share of its sigma, at its start's strength, cannot be judged."""
SMALL = 1e-3
"""Strength at which the derivative is taken, as a share of the candidate's start."""
SHARES = (1.0, 0.3)
"""Shares of the promised step that are tried."""
SEEN = 25.0
"""Drop in chi-square at which an effect counts as seen: more than the best of hundreds of trials gains by chance."""
PRESSED = 2.5
"""A parameter that the refit leaves within this many tolerances has no reason to be released."""


@dataclass(frozen=True)
class Promise:
    """What one start of a candidate promises: a drop in cost, where, and how it moves the residuals.

    Where: at `values` of what is fitted, and open states beginning from `initial`, by segment.
    `least` is the strength, as a multiple of the start's, that these recordings would have shown (`SEEN`); infinite
    where they do not feel the effect at all.
    """

    candidate: Candidate
    start: int
    gain: float
    step: Float
    values: Mapping[str, float]
    direction: Float
    least: float
    initial: tuple[Mapping[str, float], ...]


class Absorbed:
    """What the fitted unknowns can absorb: a projection out of their sensitivities, tolerances as prior rows."""

    def __init__(self, fit: Fit, without: int | None = None) -> None:
        self.fit = fit
        self.moving = ~fit.held
        prior = fit.prior.copy()
        if without is not None:
            self.moving[without], prior[without] = False, 0.0
        self._q, self._r = np.linalg.qr(np.vstack([fit.jacobian, np.diag(prior)])[:, self.moving])
        self.residuals = np.concatenate([fit.residuals, prior * fit.z])

    def out_of(self, slopes: Float) -> Float:
        """The part of slopes (rows, k) that the unknowns cannot absorb; (rows + unknowns, k)."""
        padded = np.vstack([slopes, np.zeros((self.fit.z.size, slopes.shape[1]))])
        return np.asarray(padded - self._q @ (self._q.T @ padded))

    def left_of(self, moved: Float) -> float:
        """The cost that is left when the residuals change (rows,) and the unknowns follow."""
        change = self._changed(moved)
        followed = self._q.T @ change
        return float(change @ change - followed @ followed)

    def _changed(self, moved: Float) -> Float:
        change = self.residuals.copy()
        change[: moved.size] += moved
        return change

    def follow(self, moved: Float) -> Float:
        """The step of the unknowns, (unknowns,), that best answers a change (rows,) of the residuals."""
        change = self._changed(moved)
        step = np.zeros(self.fit.z.size)
        step[self.moving] = -np.linalg.lstsq(self._r, self._q.T @ change, rcond=None)[0]
        return step


def promises_job(context: Context, task: tuple[Fit, Sequence[Candidate]]) -> list[Promise]:
    """What every start of each candidate promises by the score test."""
    fit, offered = task
    absorbed = Absorbed(fit)
    found: list[Promise] = []
    for candidate in offered:
        if isinstance(candidate, EffectCandidate):
            found += [
                effect_promise(context, absorbed, candidate, start) for start in range(candidate.starts)
            ]
        elif isinstance(candidate, ReleasedParameter):
            found += release_promise(fit, candidate)
    return found


def effect_promise(context: Context, absorbed: Absorbed, candidate: EffectCandidate, start: int) -> Promise:
    """The score test of one effect from one start; `step` is in shares of the start's strengths."""
    fit = absorbed.fit
    slopes = np.column_stack(
        [strength_slope(context, fit, candidate, start, name) for name in candidate.own_strengths]
    )
    clear = absorbed.out_of(slopes)
    lengths = np.linalg.norm(clear, axis=0)
    felt = lengths > UNFELT * np.sqrt(slopes.shape[0])
    least = float(np.sqrt(SEEN) / lengths.max()) if felt.any() else np.inf
    step = np.zeros(felt.size)
    if felt.any():
        step[felt] = -np.linalg.lstsq(clear[:, felt], absorbed.residuals, rcond=None)[0]
    if not candidate.two_sided and step[0] <= 0.0:
        step[:] = 0.0
    gone = clear @ step
    gain = float(gone @ gone)
    unknowns = fit.z + absorbed.follow(slopes @ step)
    values: dict[str, float] = {}
    initial: tuple[dict[str, float], ...] = tuple({} for _ in fit.initial)
    for f, z in zip(fit.free, unknowns, strict=True):
        (values if f.segment is None else initial[f.segment])[f.name] = float(f.centre + f.scale * z)
    return Promise(candidate, start, gain, step, values, gone / max(np.sqrt(gain), 1e-300), least, initial)


def strength_slope(
    context: Context, fit: Fit, candidate: EffectCandidate, start: int, strength: str
) -> Float:
    """Change of the residuals per start's worth of one strength, at zero of all, all else as fitted; (rows,)."""
    use = candidate.uses[start]
    weak = {
        name: replace(p, value=p.value * SMALL * (name == strength)) if name in candidate.own_strengths else p
        for name, p in use.parameters.items()
    }
    plant = fit.plant.with_effect(replace(use, parameters=weak))
    problem = FitProblem(plant, context.segments, context.sigmas, {}, frozen=fit.values)
    return (problem.residuals(problem.start({}, fit.initial)) - fit.residuals) / SMALL


def release_promise(fit: Fit, candidate: ReleasedParameter) -> list[Promise]:
    """The score test of a tolerance set aside; nothing for a parameter that its tolerance does not press."""
    index = next((i for i, free in enumerate(fit.free) if free.name == candidate.key), None)
    if index is None or abs(fit.z[index]) < PRESSED:
        return []
    absorbed = Absorbed(fit, without=index)
    column = fit.jacobian[:, [index]]
    clear = absorbed.out_of(column)
    step = -np.linalg.lstsq(clear, absorbed.residuals, rcond=None)[0]
    gone = clear @ step
    gain = float(gone @ gone) + float(fit.z[index] ** 2)
    if step[0] * fit.z[index] <= 0.0:
        return []
    least = float(np.sqrt(SEEN) / np.linalg.norm(clear))
    direction = gone / max(np.linalg.norm(gone), 1e-300)
    return [Promise(candidate, 0, gain, step, fit.values, direction, least, fit.initial)]


def trial_job(context: Context, task: tuple[Fit, Promise]) -> Promise:
    """A promise put to the test: the drop in cost when the effect is simulated at the strength promised."""
    fit, promise = task
    candidate = promise.candidate
    if not isinstance(candidate, EffectCandidate):
        return promise
    plant = candidate.joined(fit.plant, promise.start)
    ranges = ranges_of(plant, context.scales)
    problem = FitProblem(plant, context.segments, context.sigmas, ranges)
    best = replace(promise, gain=0.0, values=fit.values)
    tried = [(share, share * promise.step) for share in SHARES]
    # Where there are several strengths, the line may err in their proportions: those of the start as well.
    if len(candidate.own_strengths) > 1:
        tried.append((0.0, np.ones(promise.step.size)))
    for share, steps in tried:
        values = {name: old + share * (promise.values[name] - old) for name, old in fit.values.items()}
        for name, step in zip(candidate.own_strengths, steps, strict=True):
            if (flat := f"{candidate.key}.{name}") in ranges:  # what acts as a whole has nothing to choose
                start, low, high = ranges[flat]
                values[flat] = min(max(step * start, low), high)
        initial = [
            {name: old + share * (new[name] - old) for name, old in own.items()}
            for own, new in zip(fit.initial, promise.initial, strict=True)
        ]
        z = problem.start(values, initial)
        residuals = problem.residuals(z)
        prior = np.array([1.0 if free.prior else 0.0 for free in problem.free])
        gain = fit.cost - float(residuals @ residuals + prior @ z**2)
        if gain > best.gain:
            best = replace(best, gain=gain, values=values)
    return best
