"""A mission flown without the ground's help: which hop comes next, and the report of each hop."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from flight import energy
from flight.evaluation import HopEnergies, evaluate_hop
from flight.heartbeat import Heartbeat
from flight.plans import GoalPlan, HopPlan, MissionPlan, load_mission
from flight.record import HopRecord
from flight.settings import FlightSettings
from flight.states import STOWED, Event, Machine, Phase
from flight.surface.belief import GroundBelief
from flight.surface.known import SurfaceSettings
from flight.surface.seeker import Decided, GoalSeeker
from flight.surface.stance import Stance, stance_of
from flight.surface.tracker import Tracker
from flight.surface.trajectory import LeapForecast
from flight.surface.watch import GroundWatch, common_sigma, hop_seen
from flight.uncertain import Uncertain, mean_of
from hal.readings import GroundCommand

__all__ = ["GoalPlan", "HopPlan", "HopReport", "MissionPilot", "MissionPlan", "MissionResult", "load_mission"]

_ASKING = (Phase.READY, Phase.HOMING, Phase.HOLD, Phase.ARMED)  # where the mission commands anything
_RETRY_S = 0.5  # a command that was refused is given again after this time


@dataclass(frozen=True)
class HopReport:
    """What one hop told. `None` where it could not be evaluated; the reasons say why."""

    hop_index: int
    plan: HopPlan
    fire_s: float
    energies: HopEnergies
    c1: Uncertain | None
    c2_ref: Uncertain
    c2_ref_source: str  # "direct": reference hops of this mission; "average": config/flight.yaml
    c2_measured: Uncertain | None  # of a reference hop
    c3: Uncertain | None  # of any other hop
    belief: GroundBelief | None
    stance: Stance | None = None
    elsewhere: Mapping[str, LeapForecast] = field(
        default_factory=dict
    )  # the next such leap, by place of gravity

    @property
    def verdict(self) -> str:
        """`valid`, `degraded` or `rejected`."""
        return self.energies.flight.verdict

    @property
    def reasons(self) -> tuple[str, ...]:
        return self.energies.flight.reasons

    def as_payload(self) -> dict[str, Any]:
        """The report as JSON-able data: every quantity as value, sigma and the share common to all hops."""
        seen, flight = self.energies, self.energies.flight
        known = flight.verdict != "rejected"
        belief = self.belief
        return {
            "hop_index": self.hop_index,
            "surface": self.plan.surface,
            "place": self.plan.place,
            "reference": self.plan.reference,
            "tilt_deg": self.plan.tilt_deg,
            "wanted_energy_j": self.plan.energy_j,
            "verdict": self.verdict,
            "reasons": list(self.reasons),
            "fire_s": self.fire_s,
            "take_off_s": flight.take_off_s if known else None,
            "take_off_sigma_s": flight.take_off_sigma_s if known else None,
            "touchdown_s": flight.touchdown_s if known else None,
            "touchdown_sigma_s": flight.touchdown_sigma_s if known else None,
            "time_of_flight_s": _payload(seen.time_of_flight_s),
            "compression_m": _payload(seen.compression_m),
            "energy_used_j": _payload(seen.used_j),
            "energy_pot_analysis_j": _payload(seen.analysis_j),
            "energy_pot_j": _payload(seen.potential_j),
            "height_m": _payload(seen.height_m),
            "gravity_m_s2": _payload(seen.gravity_m_s2),
            "c1": _payload(self.c1),
            "c2_ref": _payload(self.c2_ref),
            "c2_ref_source": self.c2_ref_source,
            "c2_measured": _payload(self.c2_measured),
            "c3": _payload(self.c3),
            "stance": None if self.stance is None else self.stance.as_payload(),
            "belief": None if belief is None else belief.as_payload(),
            "elsewhere": {name: leap.as_payload() for name, leap in self.elsewhere.items()},
        }


def _payload(value: Uncertain | None) -> Mapping[str, float] | None:
    if value is None:
        return None
    return {
        "value": value.value,
        "sigma": value.sigma,
        "sigma_common": value.sigma_of((*energy.COMMON_SOURCES, "c2_ref")),
    }


@dataclass(frozen=True)
class MissionResult:
    """A mission flown: the report of each hop, what was decided, and how it ended (`stowed` is the good end).

    `hops` are the newest where `fly` was told to keep no more; `made` counts them all. `goals_left` counts the goals
    that were neither sought to their end nor given up.
    """

    plan: MissionPlan
    hops: tuple[HopReport, ...]
    end_reason: str
    spring_loaded: bool
    made: int
    decided: tuple[Decided, ...] = ()
    goals_left: int = 0

    @property
    def completed(self) -> bool:
        """All planned hops made, all goals done with, and the robot stowed with the spring shown to hold nothing."""
        enough = self.made >= len(self.plan.hops)  # the ground may have commanded more
        return self.end_reason == STOWED and enough and not self.goals_left and not self.spring_loaded


def _own(now_s: float, name: str, arguments: tuple[tuple[str, float], ...] = ()) -> GroundCommand:
    """A command of the mission, which was loaded on board and needs no signature."""
    return GroundCommand(now_s, name, arguments, authenticated=True)


@dataclass
class MissionPilot:
    """The autonomous source of commands, and the keeper of what the hops have told.

    Its commands pass the same checks as the ground's. `reports` are those of the newest `kept_reports` hops.
    """

    plan: MissionPlan
    settings: FlightSettings
    surfaces: SurfaceSettings
    kept_reports: int | None = None
    reports: deque[HopReport] = field(init=False)
    made: int = field(default=0, init=False)
    ground: GroundWatch = field(init=False)
    seeker: GoalSeeker = field(init=False)
    _references: list[Uncertain] = field(default_factory=list)  # C2_ref as each reference hop has measured it
    _asked: tuple[str, float] | None = None
    _asked_in: tuple[Phase, float] | None = None

    def __post_init__(self) -> None:
        self.reports = deque(maxlen=self.kept_reports)
        self.ground = GroundWatch(self.surfaces, self.settings)
        self.seeker = GoalSeeker(self.plan.goals, self.settings)

    def begin(self) -> None:
        """With what the memory held: decide on the first hop, if that is for the pilot to do."""
        if not self.plan.hops:
            self._decide()

    def told(self) -> list[Event]:
        """What has been decided and learned since this was asked last."""
        events = self.ground.events + self.seeker.events
        self.ground.events, self.seeker.events = [], []
        return events

    @property
    def next_hop(self) -> HopPlan | None:
        """The hop to make next; None when all is done."""
        return self.plan.hops[self.made] if self.made < len(self.plan.hops) else self.seeker.hop

    def commands(self, machine: Machine, now_s: float) -> tuple[GroundCommand, ...]:
        """What the mission asks for at this tick."""
        if machine.phase not in _ASKING:
            return ()
        wanted = self._wanted(machine, now_s)
        if wanted is None:
            return ()
        visit = (machine.phase, machine.since_s)
        if self._asked is not None and self._asked_in == visit and now_s - self._asked[1] < _RETRY_S:
            return ()
        self._asked, self._asked_in = (wanted.name, now_s), visit
        return (wanted,)

    def _wanted(self, machine: Machine, now_s: float) -> GroundCommand | None:
        hop = self.next_hop
        if machine.phase is Phase.READY:
            if hop is None:
                return _own(now_s, "stow")
            return _own(now_s, "tension", (("energy_j", hop.energy_j),))
        if machine.phase is Phase.HOMING and hop is None:
            return _own(now_s, "stow")
        if machine.phase is Phase.HOLD:
            return _own(now_s, "arm")
        # One tick more than the least time, so that rounding of the clock does not cost a refusal.
        waited_s = now_s - machine.since_s - self.settings.tick.period_s
        if machine.phase is Phase.ARMED and waited_s > self.settings.timeouts.arm_min_s:
            return _own(now_s, "fire")
        return None

    def evaluate(self, record: HopRecord, heartbeat: Heartbeat | None = None) -> HopReport:
        """Evaluate the hop just made and update what is believed of the ground."""
        index = self.made
        sought = index >= len(self.plan.hops) and self.seeker.hop is not None
        # A hop that the ground commanded beyond the plan is reported like the last one.
        plan = self.next_hop or (self.reports[-1].plan if self.reports else self.plan.hops[-1])
        seen = evaluate_hop(record, self.settings, index, heartbeat)
        c2_ref, source = self._c2_ref()
        c1 = c2_measured = c3 = None
        if seen.analysis_j is not None and seen.used_j is not None:
            c1 = energy.c1_analysis(seen.analysis_j, seen.used_j)
            if seen.potential_j is not None and plan.reference:
                c2_measured = energy.c2_reference(seen.potential_j, seen.analysis_j)
            elif seen.potential_j is not None:
                c3 = energy.c3_surface(seen.potential_j, seen.analysis_j, c2_ref)
        stance = stance_of(record, seen, self.settings)
        belief = self._believe(plan, c3, seen, stance, source, sought)
        # Reports are kept; a fit holds the hop's samples, which are not.
        seen = replace(seen, flight=replace(seen.flight, fit=None))
        report = HopReport(
            index, plan, record.fire_s, seen, c1, c2_ref, source, c2_measured, c3, belief, stance
        )
        if belief is not None and c3 is not None:
            leaps = self.ground.elsewhere(plan.place, plan.energy_j, c2_ref.value)
            report = replace(report, elsewhere=leaps)
        self.reports.append(report)
        self.made += 1
        if c2_measured is not None:
            self._references.append(c2_measured)
        if sought:
            self.seeker.after_hop(None if seen.height_m is None else seen.height_m.value)
        if index + 1 >= len(self.plan.hops):
            self._decide()
        return report

    def result(self, machine: Machine) -> MissionResult:
        return MissionResult(
            self.plan,
            tuple(self.reports),
            machine.reason,
            machine.loaded,
            self.made,
            tuple(self.seeker.decided),
            self.seeker.goals_left,
        )

    def _c2_ref(self) -> tuple[Uncertain, str]:
        """C2_ref from this mission's reference hops if there are any, else the foot's average."""
        if self._references:
            repeat = self.settings.evaluation.reference_repeatability
            return mean_of(self._references).with_part("c2_ref_repeatability", repeat), "direct"
        foot = self.settings.rig.feet[self.settings.rig.foot]
        return Uncertain.of(foot.c2_ref_mean, foot.c2_ref_std, "c2_ref"), "average"

    def _believe(
        self,
        plan: HopPlan,
        c3: Uncertain | None,
        seen: HopEnergies,
        stance: Stance | None,
        source: str,
        sought: bool,
    ) -> GroundBelief | None:
        if plan.reference:
            return None
        index = self.made
        if c3 is None or seen.used_j is None:
            return self.ground.unseen(plan.place, plan.tilt_deg, self._common(), plan.energy_j)
        hop = hop_seen(c3, seen.used_j.value, stance, index)
        moved = sought and self.seeker.moved
        return self.ground.see(plan.place, plan.tilt_deg, hop, common_sigma(c3, index), source, moved=moved)

    def _decide(self) -> None:
        def tracker_of(place: str, tilt_deg: float) -> Tracker:
            return self.ground.tracker(place, tilt_deg, self._common())

        self.seeker.decide(self.made, tracker_of, self._c2_ref()[0])

    def _common(self) -> float:
        """The error of u that C2_ref brings."""
        c2_ref = self._c2_ref()[0]
        return c2_ref.sigma / (1.0 - c2_ref.value)
