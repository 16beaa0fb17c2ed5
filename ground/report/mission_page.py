"""The page of a mission: what the hops came to, and what each estimate rests on."""

from __future__ import annotations

from pathlib import Path

from flight.surface.planner import GIVE_UP
from ground.mission_summary import (
    HOP_HEADERS,
    Figure,
    HopOutcome,
    MissionRun,
    comparisons,
    hop_rows,
    last_on_each_place,
    verdict_sentence,
    words,
)
from ground.report.decision_figures import belief_figure, height_figure
from ground.report.mission_figures import NINETY_FIVE, c3_figure, drive_figure, hop_figure, surface_figure
from ground.report.page import Cell, Page
from ground.report.story_figure import story_figure

DRAWN_HOPS = 12
"""Hops whose signals are drawn; each adds 50 kB to the page."""
TONES = {"valid": "good", "degraded": "plain", "rejected": "bad"}


def write_mission_page(run: MissionRun, path: Path) -> Path:
    """Write the page of a mission, whole or not at all. Returns `path`."""
    page = Page(f"Mission “{run.result.plan.name}”")
    good = run.result.completed and all(hop.report.verdict != "rejected" for hop in run.hops)
    page.sentence(verdict_sentence(run), "good" if good else "bad")
    seed = "" if run.seed is None else f", seed {run.seed}"
    page.text(
        f"Flown on the board “{run.board}”{seed}, rig {run.settings.rig.name}, foot {run.settings.rig.foot}."
    )
    _add_hops(page, run)
    _add_story(page, run)
    if comparisons(run):
        _add_comparisons(page, run)
    _add_ground(page, run)
    if run.result.decided:
        _add_decisions(page, run)
    _add_elsewhere(page, run)
    for outcome in run.hops[:DRAWN_HOPS]:
        _add_hop(page, run, outcome)
    if len(run.hops) > DRAWN_HOPS:
        page.section(
            "The later hops",
            f"Not drawn, to keep this page light: hops {DRAWN_HOPS + 1} to {len(run.hops)}. "
            "Their recordings lie beside it, and the console plays back the log.",
        )
    if run.notes:
        page.section("Keep in mind", "\n\n".join(run.notes))
    return page.write(path)


def _add_hops(page: Page, run: MissionRun) -> None:
    page.section("The hops", "Uncertainties are one standard deviation, errors common to all hops included.")
    rows: list[list[object]] = []
    for row, outcome in zip(hop_rows(run), run.hops, strict=True):
        verdict = Cell(outcome.report.verdict, TONES[outcome.report.verdict])  # type: ignore[arg-type]
        rows.append([*row[:2], verdict, *row[3:]])
    headers = HOP_HEADERS if run.simulated else HOP_HEADERS[:-1]
    page.table(headers, [row[: len(headers)] for row in rows])
    for outcome in run.hops:
        if outcome.report.reasons:
            page.text(f"Hop {outcome.report.hop_index + 1}: {'; '.join(outcome.report.reasons)}.")


def _add_story(page: Page, run: MissionRun) -> None:
    """The last hop whose flight was seen, from end to end."""
    seen = [hop for hop in run.hops if hop.drive and hop.hop and hop.report.verdict != "rejected"]
    if seen:
        page.figure(
            story_figure(seen[-1], run.settings.rig),
            f"Hop {seen[-1].report.hop_index + 1} from end to end: the motor winds up the spring, the magnet lets "
            "go, the accelerometer sees take-off and touchdown (shaded between them: the flight).",
        )


def _add_comparisons(page: Page, run: MissionRun) -> None:
    page.section(
        "Estimates against the simulation's truth",
        "The simulated rig is the one that the flight software believes in, unless its plant file was changed: the "
        "part of σ that stands for the rig's own tolerances (springs, masses, gravity) is then not drawn, and "
        "errors of quantities that it dominates stay well below 1 σ.",
    )
    found = comparisons(run)
    names = list(dict.fromkeys(item.name for item in found))
    by_place = {(item.hop, item.name): item for item in found}
    rows = [
        [str(hop + 1), *(_comparison_cell(by_place.get((hop, name))) for name in names)]
        for hop in dict.fromkeys(item.hop for item in found)
    ]
    page.table(["hop", *names], rows, "The truth, and how many σ of its own the estimate is away from it.")


def _comparison_cell(item: Figure | None) -> Cell:
    if item is None or item.truth is None or item.error_sigmas is None:
        return Cell("–", "muted")
    error = f"{item.error_sigmas:+.2f}".replace("-0.00", "+0.00").replace("-", "−")
    text = f"{item.lines[2]} {item.unit} ({error} σ)"
    return Cell(text, "bad" if abs(item.error_sigmas) > NINETY_FIVE else "plain")


def _add_ground(page: Page, run: MissionRun) -> None:
    measured = [hop for hop in run.hops if hop.report.c3 is not None]
    if not measured:
        return
    page.section(
        "What the ground took",
        "C3 is the share of the jump energy that the ground keeps: 0 % on steel. The belief about a place joins its "
        "hops, allowing for the ground being compacted from hop to hop.",
    )
    page.figure(
        c3_figure(measured), "C3 of each hop with its 95 % interval, and the belief about its place after it."
    )
    page.figure(belief_figure(measured), "What the robot believes to stand on, hop by hop.")
    for place, outcome in last_on_each_place(run).items():
        belief = outcome.report.belief
        assert belief is not None
        tilt_deg = outcome.report.plan.tilt_deg
        published = {name: run.published_c3(name, tilt_deg) for name in belief.probabilities}
        hops = "one hop" if belief.hops == 1 else f"{belief.hops} hops"
        caption = f"Which ground place {place} is, after {hops}, by all that they showed; beside it the published C3."
        page.figure(surface_figure(belief, published), caption)


def _add_decisions(page: Page, run: MissionRun) -> None:
    page.section(
        "What the robot decided, and why",
        "Before each hop it weighs a probe, stamps, a leap and moving on by the electrical energy that is expected "
        "until the goal is reached. It never leaps with less than the mission's probability of success.",
    )
    made = {hop.report.hop_index: hop.report for hop in run.hops}
    rows = []
    for each in run.result.decided:
        report = made.get(each.hop_index)
        height = None if report is None else report.energies.height_m
        came = {None: Cell("–", "muted"), True: Cell("reached", "good"), False: Cell("not reached", "bad")}[
            each.reached
        ]
        shown = "–" if height is None or each.decision.action == GIVE_UP else f"{1e3 * height.value:.1f} mm"
        believed = "–" if report is None or report.belief is None else words(report.belief.said)
        rows.append([str(each.hop_index + 1), each.place, each.decision.sentence, shown, came, believed])
    page.table(["hop", "place", "decision", "height", "goal", "ground believed after it"], rows)
    page.figure(
        height_figure(list(run.result.decided), list(run.hops)), "Predicted before each hop, and reached."
    )


def _add_elsewhere(page: Page, run: MissionRun) -> None:
    """The published Figure 23, by the belief about each place."""
    last = [hop.report for hop in last_on_each_place(run).values() if hop.report.elsewhere]
    if not last:
        return
    page.section(
        "The same leap on other worlds",
        "Height of the next leap of the same energy, carried to another gravity.",
    )
    names = list(last[0].elsewhere)
    rows = []
    for report in last:
        reaches = [report.elsewhere[name].height_m for name in names]
        cells = [f"{each.middle:.2f} m ({each.low:.2f} to {each.high:.2f})" for each in reaches]
        rows.append([report.plan.place, f"{report.plan.energy_j:.1f} J", *cells])
    page.table(["place", "energy", *(f"on {name}, 95 %" for name in names)], rows)
    notes = dict.fromkeys(
        note for report in last for leap in report.elsewhere.values() for note in leap.notes
    )
    page.text("\n\n".join(f"{note}." for note in notes))


def _add_hop(page: Page, run: MissionRun, outcome: HopOutcome) -> None:
    report = outcome.report
    kind = "reference hop off" if report.plan.reference else "hop off"
    page.section(f"Hop {report.hop_index + 1}: {kind} {words(report.plan.surface or 'unknown ground')}")
    if outcome.drive is not None:
        page.figure(
            drive_figure(outcome.drive, run.settings.rig, report.plan.energy_j),
            f"Tensioning to {report.plan.energy_j:g} J of usable energy.",
        )
    if outcome.hop is not None:
        page.figure(
            hop_figure(outcome),
            "Specific force along the leg. Bands: 95 % intervals of take-off and touchdown"
            + (", dotted lines: what really happened." if outcome.truth else "."),
        )
