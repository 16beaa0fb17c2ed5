"""What a flown mission came to: measured against what is known, as figures, as rows and as one sentence."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from flight.mission import HopReport, MissionResult
from flight.settings import FlightSettings
from flight.surface.belief import UNDECIDED
from flight.surface.known import SurfaceSettings, load_surfaces
from flight.surface.planner import GIVE_UP
from flight.uncertain import Uncertain
from ground.recordings import Recording
from sim_hal.truth import HopTruth

FORMAT = 1


@dataclass(frozen=True)
class HopOutcome:
    """One hop: what flight made of it, its recordings, and, in simulation, what really happened."""

    report: HopReport
    truth: HopTruth | None = None
    drive: Recording | None = None
    hop: Recording | None = None


@dataclass(frozen=True)
class MissionRun:
    """A mission that was flown and is on file in `folder`. `seed` is None on a real robot."""

    folder: Path
    board: str
    seed: int | None
    settings: FlightSettings
    result: MissionResult
    hops: tuple[HopOutcome, ...]
    notes: tuple[str, ...] = ()
    surfaces: SurfaceSettings = field(default_factory=load_surfaces)

    def published_c3(self, surface: str, tilt_deg: float) -> str:
        """The published range of C3 on a surface with this foot and tilt, in words; "" where none is known."""
        for known in self.surfaces.surfaces:
            same_foot = known.foot == self.settings.rig.foot and math.isclose(known.tilt_deg, tilt_deg)
            if same_foot and known.name == surface:
                return f"{100.0 * known.c3_low:.0f} to {100.0 * known.c3_high:.0f} %".replace("-", "−")
        return ""

    @property
    def simulated(self) -> bool:
        """Whether the truth is known."""
        return any(hop.truth is not None for hop in self.hops)


@dataclass(frozen=True)
class Figure:
    """One estimated quantity of a hop beside its truth, in display units."""

    hop: int
    name: str
    unit: str
    value: float
    sigma: float
    truth: float | None

    @property
    def error_sigmas(self) -> float | None:
        """How many of its own standard uncertainties the estimate is away from the truth."""
        if self.truth is None or self.sigma <= 0.0:
            return None
        return (self.value - self.truth) / self.sigma

    @property
    def text(self) -> str:
        """Value ± sigma with the unit."""
        return f"{plus_minus(self.value, self.sigma)} {self.unit}"

    @property
    def lines(self) -> tuple[str, str, str]:
        """Value, sigma and truth without unit, the truth with the digits of its estimate; "–" where unknown."""
        value, _, sigma = plus_minus(self.value, self.sigma).partition(" ± ")
        decimals = len(value.partition(".")[2])
        return value, sigma or "–", "–" if self.truth is None else f"{self.truth:.{decimals}f}"


def figures(outcome: HopOutcome) -> Iterator[Figure]:
    """The quantities that could be estimated of one hop."""
    report, truth = outcome.report, outcome.truth
    seen = report.energies
    known = (
        dict.fromkeys(("used", "flight", "pot", "height", "c3"))
        if truth is None
        else {
            "used": truth.energy_used_j,
            "flight": truth.time_of_flight_s,
            "pot": truth.energy_potential_j,
            "height": truth.hop_height_m,
            "c3": truth.c3,
        }
    )
    for key, name, unit, scale, estimate in (
        ("used", "E_used", "J", 1.0, seen.used_j),
        ("flight", "time of flight", "ms", 1e3, seen.time_of_flight_s),
        ("pot", "E_pot", "J", 1.0, seen.potential_j),
        ("height", "height", "mm", 1e3, seen.height_m),
        ("c3", "C3", "%", 100.0, report.c3),
    ):
        if estimate is not None:
            true = known[key]
            scaled = None if true is None else scale * true
            yield Figure(report.hop_index, name, unit, scale * estimate.value, scale * estimate.sigma, scaled)


def plus_minus(value: float, sigma: float) -> str:
    """A value with its standard uncertainty, rounded to two digits of the latter."""
    if not (math.isfinite(sigma) and sigma > 0.0):
        return f"{value:.4g}"
    decimals = max(0, 1 - math.floor(math.log10(sigma)))
    return f"{value:.{decimals}f} ± {sigma:.{decimals}f}"


def percent(value: Uncertain | None) -> str:
    """A share as a percentage with its uncertainty; a dash where there is none."""
    return "–" if value is None else f"{plus_minus(100.0 * value.value, 100.0 * value.sigma)} %"


HOP_HEADERS = ("hop", "ground", "verdict", "E_used", "time of flight", "E_pot", "C3", "true C3")


def hop_rows(run: MissionRun) -> list[tuple[str, ...]]:
    """One row for each hop, under `HOP_HEADERS`."""
    rows = []
    for outcome in run.hops:
        report, truth = outcome.report, outcome.truth
        found = {figure.name: figure.text for figure in figures(outcome)}
        c3 = f"reference: C2 {percent(report.c2_measured)}" if report.plan.reference else found.get("C3", "–")
        rows.append(
            (
                str(report.hop_index + 1),
                words(report.plan.surface or "unknown"),
                report.verdict,
                *(found.get(name, "–") for name in ("E_used", "time of flight", "E_pot")),
                c3,
                "–" if truth is None else f"{100.0 * truth.c3:.1f} %",
            )
        )
    return rows


HOP_LINE_HEADERS = ("hop", "ground", "E_used\nJ", "flight\nms", "E_pot\nJ", "height\nmm", "C3\n%", "verdict")


def hop_lines(outcome: HopOutcome) -> list[tuple[str, ...]]:
    """One hop under `HOP_LINE_HEADERS`: its estimates, beneath each its 1σ and, where known, the truth."""
    found = {figure.name: figure.lines for figure in figures(outcome)}
    names = ("E_used", "time of flight", "E_pot", "height", "C3")
    values, sigmas, truths = zip(*(found.get(name, ("–", "", "")) for name in names), strict=True)
    report = outcome.report
    ground = words(report.plan.surface or "unknown") + " (ref.)" * report.plan.reference
    lines = [(str(report.hop_index + 1), ground, *values, report.verdict), ("", "± 1σ", *sigmas, "")]
    return lines if outcome.truth is None else [*lines, ("", "truth", *truths, "")]


def comparisons(run: MissionRun) -> list[Figure]:
    """All estimates whose truth is known."""
    return [figure for hop in run.hops for figure in figures(hop) if figure.error_sigmas is not None]


def verdict_sentence(run: MissionRun) -> str:
    """What came of the mission, in words."""
    planned, made = len(run.result.plan.hops), len(run.hops)
    goals = len(run.result.plan.goals)
    if run.result.completed and goals:
        parts = [f"{made} hops were made, and the robot is stowed; {goal_words(run)}"]
    elif run.result.completed:
        parts = [f"All {made} hops were made, and the robot is stowed"]
    elif goals:
        parts = [f"The mission ended after {made} hops with {run.result.goals_left} of {goals} goals left"]
        parts[0] += f": {run.result.end_reason}" + ", with its spring loaded" * run.result.spring_loaded
    else:
        loaded = ", with its spring loaded" if run.result.spring_loaded else ""
        parts = [f"The mission ended after {made} of {planned} hops: {run.result.end_reason}{loaded}"]
    parts += [_ground_words(run, outcome) for outcome in last_on_each_place(run).values()]
    return "; ".join(parts) + "." + _truth_words(run)


def goal_words(run: MissionRun) -> str:
    """How many leaps towards the goals reached what they should, and what was given up."""
    leaps = [each for each in run.result.decided if each.reached is not None]
    given_up = sum(each.decision.action == GIVE_UP for each in run.result.decided)
    text = f"{sum(bool(each.reached) for each in leaps)} of {len(leaps)} leaps reached what they should"
    return text + (f", {given_up} goal{'s were' if given_up > 1 else ' was'} given up" if given_up else "")


def last_on_each_place(run: MissionRun) -> dict[str, HopOutcome]:
    """The last hop on each place that has a belief about its ground."""
    return {hop.report.plan.place: hop for hop in run.hops if hop.report.belief is not None}


def _ground_words(run: MissionRun, outcome: HopOutcome) -> str:
    belief, plan = outcome.report.belief, outcome.report.plan
    assert belief is not None
    share = plus_minus(100.0 * belief.c3_mean, 100.0 * belief.c3_std)
    name, told = belief.most_probable, plan.surface
    ground = f"{words(told)} (place {plan.place})" if told else "the ground"
    like = f"{words(name)} (probability {100.0 * belief.probabilities[name]:.0f} %)"
    doubt = "; the robot leaves that open" if belief.said == UNDECIDED else ""
    sentence = f"{ground} takes C3 = {share} % of the jump energy; it is most probably {like}{doubt}"
    published = [(each, run.published_c3(each, plan.tilt_deg)) for each in (name, told) if each]
    if name == told or not all(found for _, found in published):
        return sentence
    return (
        f"{sentence}; published are {' and '.join(f'{found} for {words(each)}' for each, found in published)}"
    )


def words(name: str) -> str:
    """A name as it is read aloud."""
    return name.replace("_", " ")


def _truth_words(run: MissionRun) -> str:
    errors = [abs(figure.error_sigmas or 0.0) for figure in comparisons(run)]
    if not errors:
        return ""
    inside = sum(error <= 1.96 for error in errors)
    return (
        f" {inside} of {len(errors)} estimates have the simulation's truth within their 95 % interval; "
        f"the worst is {max(errors):.1f} σ away."
    )


def mission_content(run: MissionRun) -> dict[str, Any]:
    """The content of `mission.json`."""
    return {
        "format": FORMAT,
        "mission": asdict(run.result.plan),
        "board": run.board,
        "seed": run.seed,
        "completed": run.result.completed,
        "end_reason": run.result.end_reason,
        "spring_loaded": run.result.spring_loaded,
        "summary": verdict_sentence(run),
        "notes": list(run.notes),
        "hops": [_hop_content(outcome) for outcome in run.hops],
        "decisions": [{**each.as_payload(), "reached": each.reached} for each in run.result.decided],
    }


def _hop_content(outcome: HopOutcome) -> Mapping[str, Any]:
    files = {
        kind: recording.source.name
        for kind, recording in (("drive", outcome.drive), ("hop", outcome.hop))
        if recording is not None and recording.source is not None
    }
    truth = None if outcome.truth is None else asdict(outcome.truth)
    return {**outcome.report.as_payload(), "truth": truth, "recordings": files}
