"""Seeking the goals of a mission, one decision at a time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from flight.plans import GoalPlan, HopPlan
from flight.settings import FlightSettings
from flight.states import Event
from flight.surface.forecast import forecast_loss
from flight.surface.goal import Goal
from flight.surface.planner import GIVE_UP, LEAP, MOVE_ON, Decision, Planner, Spent
from flight.surface.tracker import Tracker
from flight.surface.trajectory import Jumper, LeapForecast, predict_leap, range_of_height_m
from flight.tensioning import compression_for_energy_m
from flight.uncertain import Uncertain

TrackerOf = Callable[[str, float], Tracker]


@dataclass(frozen=True)
class Decided:
    """One decision: for which hop and goal, what and why; of a hop what it should reach, and what came of it."""

    hop_index: int
    place: str
    decision: Decision
    forecast: LeapForecast | None = None
    reached: bool | None = None  # of a leap whose height was seen

    def as_payload(self) -> Mapping[str, Any]:
        """As JSON-able data."""
        forecast, decision = self.forecast, self.decision
        return {
            "hop_index": self.hop_index,
            "place": self.place,
            "action": decision.action,
            "energy_j": decision.energy_j,
            "success": decision.success,
            "sentence": decision.sentence,
            "forecast": None if forecast is None else forecast.as_payload(),
        }


@dataclass
class GoalSeeker:
    """Which hop comes next on the way to the goals, if any."""

    goals: tuple[GoalPlan, ...]
    settings: FlightSettings
    decided: list[Decided] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    _at: int = 0
    _moves: int = 0
    _goal: Goal | None = None
    _spent: Spent = field(default_factory=Spent)
    _planner: Planner | None = None

    @property
    def hop(self) -> HopPlan | None:
        """The hop decided on; None when all goals are done with."""
        if self._at >= len(self.goals) or not self.decided:
            return None
        plan, goal = self.goals[self._at], self.goals[self._at].goal
        energy_j = self.decided[-1].decision.energy_j
        return HopPlan(energy_j, plan.surface, self.place, tilt_deg=abs(goal.tilt_deg))

    @property
    def place(self) -> str:
        """Where the robot stands: the goal's place, or so many moves away from it."""
        return self.goals[self._at].place + "'" * self._moves

    @property
    def moved(self) -> bool:
        """Whether the hop decided on is made from where a leap led, by intention."""
        return len(self.decided) > 1 and self._left(self.decided[-2])

    @property
    def goals_left(self) -> int:
        """Goals neither sought to their end nor given up."""
        return len(self.goals) - self._at

    def decide(self, hop_index: int, tracker_of: TrackerOf, c2_ref: Uncertain) -> None:
        """Decide on the next hop, going on to the next goal where one is given up."""
        if self._planner is None and self.goals_left:
            self._planner = Planner(self.settings)
        while self._planner is not None and self.goals_left:
            plan = self.goals[self._at]
            self._goal = self._goal or plan.goal
            tracker = tracker_of(self.place, abs(plan.goal.tilt_deg))
            if self.decided and self._left(self.decided[-1]):
                tracker = tracker.on_new_place()
            decision = self._planner.decide(tracker, self._goal, c2_ref.value, self._spent)
            self._say(hop_index, tracker, decision, c2_ref.value)
            if decision.action != GIVE_UP:
                return
            self._next_goal()

    def after_hop(self, height_m: float | None) -> None:
        """Take account of the hop decided on, which rose so high (None: not seen)."""
        last, goal = self.decided[-1], self._goal
        assert goal is not None and self._planner is not None
        costs, energy_j = self._planner.costs, last.decision.energy_j
        self._spent = Spent(
            self._spent.energy_j + float(costs.energy_j(energy_j)),
            self._spent.time_s + float(costs.time_s(energy_j)),
        )
        if last.decision.action == MOVE_ON:
            self._moves += 1
        if last.decision.action == LEAP:
            self._after_leap(last, goal, height_m)

    def _after_leap(self, last: Decided, goal: Goal, height_m: float | None) -> None:
        covered_m = self._covered_m(last.decision.energy_j, goal, height_m)
        reached: bool | None = None  # not seen
        if height_m is not None and goal.clear_height_m is not None:
            reached = height_m >= goal.clear_height_m
        elif covered_m is not None and goal.distance_m is not None:
            reached = covered_m >= goal.distance_m / goal.leaps
        self.decided[-1] = Decided(last.hop_index, last.place, last.decision, last.forecast, reached)
        self._goal = goal.after_leap(covered_m)
        if self._goal.leaps < 1 or (self._goal.distance_m is not None and self._goal.distance_m <= 2e-3):
            self._next_goal()

    def _covered_m(self, energy_j: float, goal: Goal, height_m: float | None) -> float | None:
        """Range of the leap by its height, as if upright; what the rig measures."""
        if height_m is None or goal.distance_m is None:
            return None
        compression_m = compression_for_energy_m(energy_j, self.settings.rig)
        return range_of_height_m(Jumper.of(self.settings.rig), compression_m, height_m, goal.tilt_deg)

    def _left(self, decided: Decided) -> bool:
        """Whether a hop led away from where it was made."""
        action = decided.decision.action
        return action == MOVE_ON or (
            action == LEAP and self._goal is not None and self._goal.distance_m is not None
        )

    def _next_goal(self) -> None:
        self._at += 1
        self._moves, self._goal, self._spent = 0, None, Spent()

    def _say(self, hop_index: int, tracker: Tracker, decision: Decision, c2_ref: float) -> None:
        tilt_deg = abs(self.goals[self._at].goal.tilt_deg)
        forecast = None
        if decision.action != GIVE_UP:
            loss = forecast_loss(tracker, decision.energy_j)
            forecast = predict_leap(
                loss, decision.energy_j, self.settings, c2_ref, tilt_deg=tilt_deg, measured_tilt_deg=tilt_deg
            )
        self.decided.append(Decided(hop_index, self.place, decision, forecast))
        self.events.append(Event("decision", dict(self.decided[-1].as_payload())))
