"""What to do next: probe, stamp, leap, move on or give up, at the least expected electrical energy.

A leap is made only where the belief gives it the mission's probability of success; the energy for that falls with
the loss, which stamping lowers, and with what is not known of it, which any hop lessens. For each number and energy
of stamps their cost and the expected cost of the leap after them are added up: given a hypothesis, the hops till then
leave of the leap's u a Gaussian whose variance does not depend on what they will show, so that the expectation is
exact but for the hypotheses that they would leave open. After every hop it is planned anew.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flight.settings import FlightSettings
from flight.surface.compaction import shares
from flight.surface.costs import HopCosts
from flight.surface.forecast import forecast_loss, normal_below
from flight.surface.goal import Demand, Goal
from flight.surface.mixture import COMMON, FALL, LOSS, SLOPE, Mixture, joined
from flight.surface.tracker import Tracker

Array = NDArray[np.float64]

PROBE, STAMP, LEAP, MOVE_ON, GIVE_UP = "probe", "stamp", "leap", "move_on", "give_up"
_NODES, _NODE_WEIGHTS = np.polynomial.hermite_e.hermegauss(5)
_NODE_WEIGHTS = _NODE_WEIGHTS / _NODE_WEIGHTS.sum()
_HEAVIEST = 60
_STAMP_ENERGIES = 4
_BISECTIONS = 60
_HALVINGS = 16  # of the energies that may be asked for: to a millijoule
_UNLIKELY = 1e-5
_MEASURED_STD = 0.006  # of a hop's own u


@dataclass(frozen=True)
class Spent:
    """What the mission has spent."""

    energy_j: float = 0.0
    time_s: float = 0.0


@dataclass(frozen=True)
class Decision:
    """What to do next, and why in one sentence; `success` of a leap, and all the energy that is expected to come."""

    action: str
    energy_j: float
    success: float | None
    expected_j: float
    sentence: str


@dataclass(frozen=True)
class _Beliefs:
    """The heaviest hypotheses of a belief: weights (n,), their Gaussians, and the dose that their spot has borne."""

    weights: Array
    mixture: Mixture
    doses: Array

    @staticmethod
    def of(tracker: Tracker) -> _Beliefs:
        weights, parts, doses = [], [], []
        for share, run in zip(tracker.run_weights, tracker.runs, strict=True):
            own = run.mixture.weights * share
            best = np.argsort(-own, kind="stable")[:_HEAVIEST]
            weights.append(own[best])
            parts.append(run.mixture.chosen(best))
            doses.append(np.full(best.size, tracker.dose - run.dose))
        together, base = np.concatenate(weights), np.concatenate(doses)
        whole = joined(parts)
        best = np.argsort(-together, kind="stable")[:_HEAVIEST]
        return _Beliefs(together[best] / together[best].sum(), whole.chosen(best), base[best])

    def rows(self, extra_dose: float, log_energy: float) -> Array:
        """How u of a hop follows from the state (n, 5)."""
        table = {dose: shares(float(dose) + extra_dose) for dose in np.unique(self.doses)}
        fallen = np.array([table[dose][law] for dose, law in zip(self.doses, self.mixture.laws, strict=True)])
        rows = np.zeros_like(self.mixture.means)
        rows[:, LOSS] = rows[:, COMMON] = 1.0
        rows[:, FALL], rows[:, SLOPE] = -fallen, log_energy
        return rows


class Planner:
    """Chooses the next hop for one rig."""

    def __init__(self, settings: FlightSettings) -> None:
        self.settings = settings
        self.costs = HopCosts(settings)

    def bound(self, goal: Goal) -> float:
        """The least probability of success with which a leap is made."""
        return goal.success_probability or self.settings.surface.planner.success_probability

    def decide(self, tracker: Tracker, goal: Goal, c2_ref: float, spent: Spent | None = None) -> Decision:
        """The next action towards a goal."""
        demand, bound = Demand.of(goal, self.settings, c2_ref), self.bound(goal)
        now_j = self.least_energy_j(tracker, demand, bound)
        ahead = self._ahead(tracker, demand, bound, _from_here(goal))
        leap_j = self._leaps_now_j(tracker, demand, bound, goal, now_j)
        best = min(ahead, key=lambda plan: plan[0], default=(math.inf, 0, 0.0))
        left_j, left_s = _left(goal, spent or Spent())
        if min(leap_j, best[0]) > left_j:
            best_j = min(leap_j, best[0])
            return Decision(GIVE_UP, 0.0, None, 0.0, _over_budget(goal, best_j, left_j))
        if now_j is not None and leap_j <= best[0]:
            if float(self.costs.time_s(now_j)) > left_s:
                return Decision(
                    GIVE_UP, 0.0, None, 0.0, f"Give up: {left_s:.0f} s are left, too few to leap."
                )
            return self._leap(tracker, goal, demand, now_j, leap_j, best)
        fresh_j = self._elsewhere_j(tracker, demand, bound, goal) if goal.may_move else math.inf
        if fresh_j < min(best[0], self._worth_j(goal)):
            return Decision(MOVE_ON, self._move_j(), None, fresh_j, _moving(goal, fresh_j, best[0]))
        if best[0] >= self._worth_j(goal):
            most_j = self.settings.tension.max_energy_j
            sure = f"{100.0 * bound:.0f} % sure to {goal.words}"
            why = f"Give up: from this ground not even {most_j:g} J make it {sure}."
            return Decision(GIVE_UP, 0.0, None, 0.0, why)
        return self._stamp(tracker, goal, best, now_j, leap_j)

    def success(self, tracker: Tracker, demand: Demand, energy_j: float) -> float:
        """Probability that a leap of this energy reaches the goal."""
        limit = float(np.interp(energy_j, demand.energies_j, demand.losses))
        return float(forecast_loss(tracker, energy_j).below(limit)[0])

    def least_energy_j(self, tracker: Tracker, demand: Demand, bound: float) -> float | None:
        """Least energy of a leap now that is sure enough; None where even the most is not."""
        low, high = float(demand.energies_j[0]), float(demand.energies_j[-1])
        tracker = tracker.without_the_unlikely(_UNLIKELY)
        if self.success(tracker, demand, high) < bound:
            return None
        if self.success(tracker, demand, low) >= bound:
            return low
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            if self.success(tracker, demand, middle) < bound:
                low = middle
            else:
                high = middle
        return high

    def _leaps_now_j(
        self, tracker: Tracker, demand: Demand, bound: float, goal: Goal, now_j: float | None
    ) -> float:
        """Cost of leaping at once, and of the leaps after that from the same spot."""
        if now_j is None:
            return math.inf
        leap_j, more = float(self.costs.energy_j(now_j)), _from_here(goal) - 1
        if more:
            leap_j += more * self._leap_after(tracker, _Beliefs.of(tracker), demand, bound, now_j, 1)
        return leap_j

    def _ahead(
        self, tracker: Tracker, demand: Demand, bound: float, leaps: int
    ) -> list[tuple[float, int, float]]:
        """Expected cost [J] of so many stamps of an energy [J] and the leaps from this spot after them."""
        planner = self.settings.surface.planner
        beliefs = _Beliefs.of(tracker)
        energies = np.geomspace(
            planner.least_stamp_j, self.settings.surface.learning.reference_energy_j, _STAMP_ENERGIES
        )
        plans = []
        for energy_j in map(float, energies):
            for count in range(1, planner.most_stamps + 1):
                leap_j = self._leap_after(tracker, beliefs, demand, bound, energy_j, count)
                plans.append((count * float(self.costs.energy_j(energy_j)) + leaps * leap_j, count, energy_j))
        return plans

    def _leap_after(
        self, tracker: Tracker, beliefs: _Beliefs, demand: Demand, bound: float, stamp_j: float, count: int
    ) -> float:
        """Expected electrical energy of the leap after `count` stamps; a leap that cannot be made costs dear."""
        dose, mixture = tracker.dose_of(stamp_j), beliefs.mixture
        means, covariances = mixture.means, mixture.covariances
        guess_j = float(demand.energies_j[-1]) * 0.7
        target = beliefs.rows(count * dose, tracker.log_energy(guess_j))
        mean = np.einsum("hi,hi->h", target, means)
        before = np.einsum("hi,hij,hj->h", target, covariances, target)
        for number in range(count):
            rows = beliefs.rows(number * dose, tracker.log_energy(stamp_j))
            gains = np.einsum("hij,hj->hi", covariances, rows)
            total = np.einsum("hi,hi->h", rows, gains) + mixture.loss_scatter**2 + _MEASURED_STD**2
            covariances = covariances - gains[:, :, None] * gains[:, None, :] / total[:, None, None]
        after = np.einsum("hi,hij,hj->h", target, covariances, target)
        learned = np.sqrt(np.maximum(before - after, 0.0))
        margin = _quantile(bound) * np.sqrt(np.maximum(after, 0.0) + mixture.loss_scatter**2)
        losses = (mean + margin)[:, None] + learned[:, None] * _NODES[None, :]
        needed = demand.energy_j(losses)
        dear = self._unreached_j
        cost = np.where(
            np.isfinite(needed), self.costs.energy_j(np.where(np.isfinite(needed), needed, 0.0)), dear
        )
        return float(beliefs.weights @ (cost @ _NODE_WEIGHTS))

    def _worth_j(self, goal: Goal) -> float:
        """What reaching a goal may cost before it is better given up."""
        return self._unreached_j * _from_here(goal)

    @property
    def _unreached_j(self) -> float:
        return self.settings.surface.planner.unreached_j

    def _move_j(self) -> float:
        return self.settings.surface.learning.reference_energy_j

    def _elsewhere_j(self, tracker: Tracker, demand: Demand, bound: float, goal: Goal) -> float:
        """Expected cost of reaching the goal from a fresh place, the way there included."""
        plans = self._ahead(tracker.on_new_place(), demand, bound, _from_here(goal))
        return float(self.costs.energy_j(self._move_j())) + min(plan[0] for plan in plans)

    def _leap(
        self,
        tracker: Tracker,
        goal: Goal,
        demand: Demand,
        now_j: float,
        leap_j: float,
        best: tuple[float, int, float],
    ) -> Decision:
        chance = self.success(tracker, demand, now_j)
        rival = f"; stamping first would need {best[0]:.0f} J in all" if math.isfinite(best[0]) else ""
        sure = f"{100.0 * chance:.0f} % sure, {leap_j:.0f} J electrical{rival}"
        sentence = f"Leap with {now_j:.1f} J to {goal.words}: {sure}."
        return Decision(LEAP, now_j, chance, leap_j, sentence)

    def _stamp(
        self, tracker: Tracker, goal: Goal, best: tuple[float, int, float], now_j: float | None, leap_j: float
    ) -> Decision:
        expected_j, count, energy_j = best
        first = tracker.hops == max(run.start for run in tracker.runs)
        action = PROBE if first else STAMP
        instead = (
            f"a leap that is sure enough would need {leap_j:.0f} J now"
            if now_j is not None
            else "no leap is sure enough now"
        )
        more = "" if count == 1 else f", the first of {count}"
        sentence = (
            f"{action.capitalize()} with {energy_j:.1f} J{more}: {instead}, with this "
            f"{expected_j:.0f} J are expected in all to {goal.words}."
        )
        return Decision(action, energy_j, None, expected_j, sentence)


def _from_here(goal: Goal) -> int:
    """Leaps to be made from the present spot: those that cover a distance lead away from it."""
    return goal.leaps if goal.clear_height_m is not None else 1


def equation_seven_energy_j(demand: Demand, last_loss: float) -> float:
    """The published control law (Eq. 7): the next leap loses what the last hop lost, for certain."""
    return float(np.minimum(demand.energy_j(last_loss), demand.energies_j[-1]))


def _left(goal: Goal, spent: Spent) -> tuple[float, float]:
    energy_j = math.inf if goal.energy_budget_j is None else goal.energy_budget_j - spent.energy_j
    time_s = math.inf if goal.time_budget_s is None else goal.time_budget_s - spent.time_s
    return energy_j, time_s


def _over_budget(goal: Goal, needed_j: float, left_j: float) -> str:
    need = f"{needed_j:.0f} J" if math.isfinite(needed_j) else "more than there can be"
    return f"Give up: to {goal.words} {need} would be needed, and {max(left_j, 0.0):.0f} J are left."


def _moving(goal: Goal, fresh_j: float, here_j: float) -> str:
    here = f"{here_j:.0f} J" if math.isfinite(here_j) else "no energy suffices"
    return f"Move on: elsewhere {fresh_j:.0f} J are expected to {goal.words}, here {here}."


def _quantile(probability: float) -> float:
    """Standard normal quantile, by bisection."""
    low, high = -8.0, 8.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if float(normal_below(np.array(middle))) < probability else (low, middle)
    return 0.5 * (low + high)
