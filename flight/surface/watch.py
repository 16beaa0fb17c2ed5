"""The belief of the flying robot: taken on from hop to hop, place to place, and over restarts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from flight.settings import FlightSettings
from flight.states import Event
from flight.surface.belief import GroundBelief, belief_of
from flight.surface.forecast import forecast_loss
from flight.surface.known import SurfaceSettings
from flight.surface.learner import GroundRecord, LearnedSurface, learned_from, models_of
from flight.surface.priors import loss_of
from flight.surface.stance import Stance
from flight.surface.tracker import HopSeen, Tracker
from flight.surface.trajectory import LeapForecast, predict_leap
from flight.uncertain import Uncertain

_LEAST_SIGMA = 1e-4
_MOST_C3 = 0.999


def hop_seen(c3: Uncertain, energy_j: float, stance: Stance | None, hop_index: int) -> HopSeen:
    """A hop as the belief takes it in: u = -ln(1 - C3) with the part of its error that is this hop's alone."""
    value = min(c3.value, _MOST_C3)
    own = math.sqrt(sum(part**2 for name, part in c3.parts.items() if name.endswith(f"#{hop_index}")))
    sigma = max(own / (1.0 - value), _LEAST_SIGMA)
    if stance is None:
        return HopSeen(energy_j, loss_of(value), sigma)
    return HopSeen(energy_j, loss_of(value), sigma, stance.log_stiffness, stance.log_stiffness_sigma)


def common_sigma(c3: Uncertain, hop_index: int) -> float:
    """The error of u that this hop shares with others: C2_ref's, and the rig's constants'."""
    parts = (part for name, part in c3.parts.items() if not name.endswith(f"#{hop_index}"))
    return max(math.sqrt(sum(part**2 for part in parts)) / (1.0 - min(c3.value, _MOST_C3)), _LEAST_SIGMA)


@dataclass
class GroundWatch:
    """What is believed of the place underfoot, of places left, and of surfaces that no table has."""

    surfaces: SurfaceSettings
    settings: FlightSettings
    learned: tuple[LearnedSurface, ...] = ()
    events: list[Event] = field(default_factory=list)
    _trackers: dict[str, Tracker] = field(default_factory=dict)
    _tilts: dict[str, float] = field(default_factory=dict)
    _place: str | None = None
    _restored: GroundRecord | None = None
    _source: str = ""

    def restore(self, record: GroundRecord) -> None:
        """Go on with what was known before a restart; whether the robot still stands there, the hops will say."""
        self.learned = record.learned
        self._restored = record

    def record(self) -> GroundRecord:
        """What is worth keeping over a restart."""
        if self._place is None:
            return self._restored or GroundRecord(self.learned)
        foot, tilt_deg = self.settings.rig.foot, self._tilts[self._place]
        return GroundRecord(self.learned, self._trackers[self._place], foot, tilt_deg)

    def tracker(self, place: str, tilt_deg: float, common: float) -> Tracker:
        """The belief about a place, be it the one underfoot, one left, or one that the robot just came to."""
        if place in self._trackers and self._tilts[place] == tilt_deg:
            return self._trackers[place]
        foot = self.settings.rig.foot
        ground = models_of(self.surfaces, self.settings.surface, foot, tilt_deg, self.learned)
        before = self._before(foot, tilt_deg)
        if before is None:
            return Tracker.begin(ground, (0.0, common))
        return before if self._place is None else before.on_new_place(ground)

    def see(
        self, place: str, tilt_deg: float, hop: HopSeen, common: float, source: str, *, moved: bool = False
    ) -> GroundBelief:
        """Take a hop in. `source` says where C2_ref is from: another one brings a new common error.

        `moved`: the robot leapt off to elsewhere before this hop, but no one said that it arrived.
        """
        told = self._place is not None and place != self._place
        self._leave(place)
        tracker = self.tracker(place, tilt_deg, common)
        if source != self._source and tracker.hops:
            tracker = tracker.with_common(common)
        self._source = source
        hazard = self.settings.surface.change.moved_hazard if moved or self._unsure else None
        self._restored = None
        after = tracker.after(hop, hazard)
        self._trackers[place], self._tilts[place], self._place = after, tilt_deg, place
        belief = belief_of(after, hop.energy_j)
        changed = belief.changed >= self.settings.surface.decision.changed and belief.hops == 1
        if changed and tracker.hops and not told:
            self._tell(
                "ground_changed", {"place": place, "way": belief.change, "probability": belief.changed}
            )
        return belief

    def elsewhere(self, place: str, energy_j: float, c2_ref: float) -> dict[str, LeapForecast]:
        """The same leap, carried to other gravities (the published Figure 23), by the belief about a place."""
        tilt_deg, planner = self._tilts[place], self.settings.surface.planner
        if tilt_deg > planner.most_tilt_deg:
            return {}
        gravities = {"the Moon": planner.moon_gravity_m_s2, "Mars": planner.mars_gravity_m_s2}
        loss = forecast_loss(self._trackers[place], energy_j)
        return {
            name: predict_leap(
                loss,
                energy_j,
                self.settings,
                c2_ref,
                tilt_deg=tilt_deg,
                measured_tilt_deg=tilt_deg,
                gravity_m_s2=gravity_m_s2,
            )
            for name, gravity_m_s2 in gravities.items()
        }

    def unseen(self, place: str, tilt_deg: float, common: float, energy_j: float) -> GroundBelief:
        """The belief when a hop could not be evaluated."""
        return belief_of(self.tracker(place, tilt_deg, common), energy_j)

    @property
    def _unsure(self) -> bool:
        """Whether the belief is from before a restart, and this is the first hop since."""
        return self._place is None and self._restored is not None

    def _before(self, foot: str, tilt_deg: float) -> Tracker | None:
        if self._place is not None:
            return self._trackers[self._place]
        kept = self._restored
        same = kept is not None and kept.foot == foot and math.isclose(kept.tilt_deg, tilt_deg, abs_tol=0.5)
        return kept.tracker if kept is not None and same else None

    def _leave(self, place: str) -> None:
        """Before the first hop elsewhere: keep what was learned of the place left."""
        if self._place is None or place == self._place:
            return
        tracker, tilt_deg = self._trackers[self._place], self._tilts[self._place]
        learned = learned_from(tracker, self.settings.rig.foot, tilt_deg, self.learned)
        if learned != self.learned:
            changed = next(new for new in reversed(learned) if new not in self.learned)
            self._tell("ground_learned", {"surface": changed.name, "places": changed.places})
        self.learned = learned

    def _tell(self, name: str, details: Mapping[str, object]) -> None:
        self.events.append(Event(name, dict(details)))
