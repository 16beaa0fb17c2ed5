"""A mission: hops at given energies, flown without the ground's help, and the report of each hop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from flight import energy
from flight.evaluation import HopEnergies, evaluate_hop
from flight.heartbeat import Heartbeat
from flight.record import HopRecord
from flight.settings import FlightSettings
from flight.states import STOWED, Machine, Phase
from flight.surface_belief import (
    SurfaceBelief,
    SurfaceSettings,
    prior_belief,
    updated_belief,
)
from flight.uncertain import Uncertain, mean_of
from hal.config import Limits, load_settings
from hal.errors import ConfigError
from hal.readings import GroundCommand

_RETRY_S = 0.5  # a command that was refused is given again after this time


@dataclass(frozen=True)
class HopPlan:
    """One hop to be made: usable energy, and what is known of the ground there.

    `reference` marks a hop off a rigid surface, which measures C2_ref for the hops after it.
    """

    energy_j: Annotated[float, Limits(1e-3, 1e3)]
    surface: str | None = None
    place: str = "A"
    reference: bool = False
    tilt_deg: Annotated[float, Limits(0.0, 45.0)] = 0.0


@dataclass(frozen=True)
class MissionPlan:
    """The hops of a mission, in order."""

    name: str
    hops: tuple[HopPlan, ...]


def load_mission(path: Path, settings: FlightSettings) -> MissionPlan:
    """Read and check a mission file. Raises `ConfigError` naming file, key, value and limit."""
    plan = load_settings(path, MissionPlan)
    if not plan.hops:
        raise ConfigError(f"{path}: hops: a mission needs at least one hop")
    limits = settings.tension
    for index, hop in enumerate(plan.hops):
        if not limits.min_energy_j <= hop.energy_j <= limits.max_energy_j:
            raise ConfigError(
                f"{path}: hops[{index}].energy_j = {hop.energy_j:g} is outside the rig's limits "
                f"[{limits.min_energy_j:g}, {limits.max_energy_j:g}]"
            )
    return plan


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
    belief: SurfaceBelief | None

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
            "belief": None
            if belief is None
            else {
                "c3_mean": belief.c3_mean,
                "c3_std": belief.c3_std,
                "hops": belief.hops,
                "surfaces": dict(belief.probabilities),
            },
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
    """A mission flown: the report of each hop, and how it ended (`stowed` is the good end)."""

    plan: MissionPlan
    hops: tuple[HopReport, ...]
    end_reason: str
    spring_loaded: bool

    @property
    def completed(self) -> bool:
        """All planned hops made, and the robot stowed with the spring shown to hold nothing."""
        made = len(self.hops) >= len(self.plan.hops)  # the ground may have commanded more
        return self.end_reason == STOWED and made and not self.spring_loaded


def _own(now_s: float, name: str, arguments: tuple[tuple[str, float], ...] = ()) -> GroundCommand:
    """A command of the mission, which was loaded on board and needs no signature."""
    return GroundCommand(now_s, name, arguments, authenticated=True)


@dataclass
class MissionPilot:
    """The autonomous source of commands, and the keeper of what the hops have told.

    Its commands pass the same checks as the ground's.
    """

    plan: MissionPlan
    settings: FlightSettings
    surfaces: SurfaceSettings
    reports: list[HopReport] = field(default_factory=list)
    _beliefs: dict[str, SurfaceBelief] = field(default_factory=dict)
    _asked: tuple[str, float] | None = None
    _asked_in: tuple[Phase, float] | None = None

    def commands(self, machine: Machine, now_s: float) -> tuple[GroundCommand, ...]:
        """What the mission asks for at this tick."""
        wanted = self._wanted(machine, now_s)
        if wanted is None:
            return ()
        visit = (machine.phase, machine.since_s)
        if self._asked is not None and self._asked_in == visit and now_s - self._asked[1] < _RETRY_S:
            return ()
        self._asked, self._asked_in = (wanted.name, now_s), visit
        return (wanted,)

    def _wanted(self, machine: Machine, now_s: float) -> GroundCommand | None:
        done = len(self.reports) >= len(self.plan.hops)
        if machine.phase is Phase.READY:
            if done:
                return _own(now_s, "stow")
            energy_j = self.plan.hops[len(self.reports)].energy_j
            return _own(now_s, "tension", (("energy_j", energy_j),))
        if machine.phase is Phase.HOMING and done:
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
        index = len(self.reports)
        # A hop that the ground commanded beyond the plan is reported like the plan's last.
        plan = self.plan.hops[min(index, len(self.plan.hops) - 1)]
        seen = evaluate_hop(record, self.settings, index, heartbeat)
        c2_ref, source = self._c2_ref()
        c1 = c2_measured = c3 = None
        if seen.analysis_j is not None and seen.used_j is not None:
            c1 = energy.c1_analysis(seen.analysis_j, seen.used_j)
            if seen.potential_j is not None and plan.reference:
                c2_measured = energy.c2_reference(seen.potential_j, seen.analysis_j)
            elif seen.potential_j is not None:
                c3 = energy.c3_surface(seen.potential_j, seen.analysis_j, c2_ref)
        belief = self._believe(plan, c3)
        report = HopReport(index, plan, record.fire_s, seen, c1, c2_ref, source, c2_measured, c3, belief)
        self.reports.append(report)
        return report

    def result(self, machine: Machine) -> MissionResult:
        return MissionResult(self.plan, tuple(self.reports), machine.reason, machine.loaded)

    def _c2_ref(self) -> tuple[Uncertain, str]:
        """C2_ref from this mission's reference hops if there are any, else the foot's average."""
        measured = [report.c2_measured for report in self.reports if report.c2_measured is not None]
        if measured:
            repeat = self.settings.evaluation.reference_repeatability
            return mean_of(measured).with_part("c2_ref_repeatability", repeat), "direct"
        foot = self.settings.rig.feet[self.settings.rig.foot]
        return Uncertain.of(foot.c2_ref_mean, foot.c2_ref_std, "c2_ref"), "average"

    def _believe(self, plan: HopPlan, c3: Uncertain | None) -> SurfaceBelief | None:
        if plan.reference:
            return None
        foot = self.settings.rig.foot
        before = self._beliefs.get(plan.place) or prior_belief(self.surfaces, foot, plan.tilt_deg)
        after = before
        if c3 is not None:
            after = updated_belief(before, c3.value, c3.sigma, self.surfaces, foot, plan.tilt_deg)
        self._beliefs[plan.place] = after
        return after
