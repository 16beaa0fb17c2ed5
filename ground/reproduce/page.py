"""The page: every published number and figure beside ours."""

from __future__ import annotations

from pathlib import Path

from flight.settings import RigSettings
from ground.report.page import Cell, Page, Tone
from ground.reproduce.disagreements import disagreements
from ground.reproduce.figures import (
    area_figure,
    compaction_figure,
    efficiency_figure,
    moon_figure,
    prediction_figure,
    rows_figure,
)
from ground.reproduce.outcome import WAYS, Found, Reproduction
from ground.reproduce.paper import Paper
from sim_hal.soils import Soils

HEADERS = ("quantity", "published", "range", "ours", "range", "± σ", "runs", "goal")
KINDS = ("c1_expected", "c1_analysis", "c1_loss_free", "c1", "c2", "c3_direct", "c3_average")
ERROR_HEADERS = (
    "ground",
    "runs",
    "published",
    "averages",
    "averages of the others",
    "flight code, before the hop",
    "goal",
)
SECTIONS = (
    ("Table 3", "Table 4", "Eq. (2)", "Section 4.1"),
    ("Table 5", "Section 4.2", "Section 5.1, Figure 17"),
    ("Table 6",),
    ("Figure 23",),
)


def verdict(made: Reproduction) -> str:
    """What came of it, in words."""
    asked = [found for found in made.found if found.met is not None]
    missed = [found.says for found in asked if not found.met]
    text = f"{len(made.chain.runs)} runs"
    text += f", {len(made.rejected)} rejected" if made.rejected else ""
    text += f"; {len(asked) - len(missed)} of {len(asked)} goals met"
    mae = made.named("mae_by_flight_all") or made.named("mae_by_average_all")
    if mae is not None and mae.published is not None:
        text += f"; predicted heights are {100 * mae.value:.1f} % off on average, "
        text += f"published {100 * mae.published:.1f} %"
    return text + (f". Not met: {'; '.join(missed)}." if missed else ".")


def write_page(
    made: Reproduction, paper: Paper, rig: RigSettings, soils: Soils, how: str, path: Path, title: str
) -> Path:
    """Write the page, whole or not at all. Returns `path`."""
    page = Page(title)
    asked = [found.met for found in made.found if found.met is not None]
    tone: Tone = "plain" if not asked else "good" if all(asked) else "bad"
    page.sentence(verdict(made), tone)
    page.text(how)
    if made.rejected:
        page.text("Rejected by the flight code, and left out: " + ". ".join(made.rejected) + ".")
    _coefficients(page, made, paper)
    _ground(page, made, paper, soils)
    _heights(page, made)
    _moon(page, made, paper)
    _disagreements(page, paper, rig)
    _runs(page, made)
    return page.write(path)


def _coefficients(page: Page, made: Reproduction, paper: Paper) -> None:
    page.section(
        "C1 and C2_ref (Tables 3 and 4)",
        "C1 by the analysis is Eq. (2) with a numerical model of the rig that has, like the published one, minimal "
        "damping; its one number is fitted for all five feet together. The flight code's own C1 is free of losses "
        "and lies below; why the published values cannot be loss-free is said under “Where the published numbers "
        "disagree”. C2_ref is measured against the loss-free hop.",
    )
    _table(page, made, 0)
    page.figure(efficiency_figure(made, paper), "Figure 9 again. Published: mean and range of Table 4.")


def _ground(page: Page, made: Reproduction, paper: Paper, soils: Soils) -> None:
    page.section(
        "What the ground takes (Table 5)",
        "C3 as the flight code estimates it in each hop, direct (by the reference jump of the set-up) and by the "
        f"average of all references. Goal: the mean of each row within 2 points. {paper.citation}.",
    )
    _table(page, made, 1)
    if any(run.c3_direct for run in made.chain.tests):
        page.figure(rows_figure(made.chain, paper), "Table 5 as a picture, level and tilted.")
        page.figure(
            area_figure(made.chain, paper, soils), "Figure 16 again: dissipation over the foot's area."
        )
    if any(run.run.surface == paper.compaction.surface for run in made.chain.tests):
        page.figure(
            compaction_figure(made.chain, paper),
            "Figure 17 again: the soil compacts in one place. Bars: 95 % intervals.",
        )


def _heights(page: Page, made: Reproduction) -> None:
    if not made.predictions:
        return
    page.section(
        "Predicted heights (Table 6)",
        "Mean absolute error of the height that Eq. (7) predicts. As published, C2_ref is the average of all "
        "references and C3 that of the row, the run itself among them, so that the error is the spread of the "
        "ground; with the other runs alone it is what such an average foretells. The flight code predicts from what "
        "it knows just before the hop: the reference jump of the set-up and its belief about the place, from a small "
        "probing hop there or, where the soil compacts, from the hop before less the published fall; what is "
        "published of a new place where nothing hopped before. Goal: half the published error over all tests.",
    )
    _errors(page, made)
    page.figure(prediction_figure(made), "Figure 22 again; hover for the run.")


def _errors(page: Page, made: Reproduction) -> None:
    """Table 6: a row a ground, a column a way of predicting."""
    found = {each.name: each for each in made.found if each.source == "Table 6"}
    rows: list[list[object]] = []
    for name, each in found.items():
        if not name.startswith(f"mae_{WAYS[0]}_"):
            continue
        ground = name.removeprefix(f"mae_{WAYS[0]}_")
        ways = [found.get(f"mae_{way}_{ground}") for way in WAYS]
        last = ways[-1]
        goal = "" if last is None or last.met is None else "met" if last.met else "missed"
        words = ground.replace("_", " ").replace("deg", "°")
        rows.append(
            [
                words,
                each.runs or "–",
                _percent(each.published),
                *(_percent(None if way is None else way.value) for way in ways),
                _goal(goal),
            ]
        )
    headers = (
        "ground",
        "runs",
        "published",
        "averages",
        "averages of the others",
        "flight code, before the hop",
        "goal",
    )
    page.table(headers, rows)


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100.0 * share:.1f} %"


def _moon(page: Page, made: Reproduction, paper: Paper) -> None:
    if not any(found.source == "Figure 23" for found in made.found):
        return
    page.section(
        "On the Moon (Figure 23)",
        f"Hopter: {paper.moon.mass_kg:g} kg, C1 = {100 * paper.moon.c1:.0f} %, C2_ref = {100 * paper.moon.c2:.1f} %, "
        f"g = {paper.moon.gravity_m_s2:g} m/s², C3 carried over unchanged, as in the paper. Beside our C3 stands the "
        "height that Eq. (6) gives with the published one.",
    )
    _table(page, made, 3)
    page.figure(
        moon_figure(made.chain, paper), "Bars: range of our runs, dots their mean; band: published 3 to 6 m."
    )


def _disagreements(page: Page, paper: Paper, rig: RigSettings) -> None:
    page.section("Where the published numbers disagree")
    rows = [(each.title, each.text, each.here) for each in disagreements(paper, rig)]
    page.table(("matter", "what does not fit", "here"), rows)


def _runs(page: Page, made: Reproduction) -> None:
    page.section("All runs")
    rows = []
    for each, c1 in zip(made.chain.runs, made.c1_analysis, strict=True):
        run = each.run
        c2, c3 = each.c2_reference, each.c3_direct
        rows.append(
            [
                run.label,
                f"{run.surface.replace('_', ' ')} {run.tilt_deg:g}°",
                f"#{run.foot}",
                f"{each.used_j.value:.2f}",
                f"{1e3 * run.height_m.value:.1f} ± {1e3 * run.height_m.sigma:.1f}",
                "–" if run.true_height_m is None else f"{1e3 * run.true_height_m:.1f}",
                f"{100 * c1:.1f}",
                "–" if c2 is None else f"{100 * c2.value:.1f} ± {100 * c2.sigma:.1f}",
                "–" if c3 is None else f"{100 * c3.value:.1f} ± {100 * c3.sigma:.1f}",
                "–" if run.true_c3 is None else f"{100 * run.true_c3:.1f}",
            ]
        )
    page.table(
        ("run", "ground", "foot", "E_used J", "height mm", "true", "C1 %", "C2_ref %", "C3 %", "true"), rows
    )


def _table(page: Page, made: Reproduction, section: int) -> None:
    shown = [found for found in made.found if found.source in SECTIONS[section]]
    rows = [
        table_row(found) for found in sorted(shown, key=_kind)
    ]  # stable: feet and grounds keep their order
    goal = len(HEADERS) - 1
    page.table(HEADERS, [[*row[:goal], _goal(row[goal])] for row in rows])


def _kind(found: Found) -> int:
    """What is alike stands together."""
    return next((i for i, kind in enumerate(KINDS) if found.name.startswith(kind)), len(KINDS))


def _goal(text: str) -> Cell:
    tone: Tone = "good" if text == "met" else "bad" if text == "missed" else "muted"
    return Cell(text, tone)


def table_row(found: Found) -> tuple[str, ...]:
    """One number under `HEADERS`."""
    scale, unit = (100.0, " %") if found.unit == "1" else (1.0, f" {found.unit}")
    if found.name in ("compaction_fold", "tilt_factor"):
        scale, unit = 1.0, "×"
    digits = 2 if unit == "×" or found.unit == "m" or found.name.startswith("c1") else 1

    def text(value: float | None) -> str:
        return "–" if value is None else f"{scale * value:.{digits}f}"

    def span(low: float | None, high: float | None) -> str:
        return "–" if low is None or high is None else f"{text(low)} – {text(high)}"

    return (
        found.says,
        "–" if found.published is None else text(found.published) + unit,
        span(found.published_low, found.published_high),
        text(found.value) + unit,
        span(found.low, found.high),
        text(found.sigma),
        "–" if found.runs is None else str(found.runs),
        "" if found.met is None else "met" if found.met else "missed",
    )
