"""The page of `hopper demo concealed`: what looked normal, what was found, and what it is good for."""

from __future__ import annotations

from pathlib import Path

from plotly.graph_objects import Figure

from ground.demo_concealed import WAYS, Concealed
from ground.report.concealed_tables import later_rows, learned_rows, rehearsed_rows, sentence
from ground.report.page import BLUE, GREEN, GREY, ORANGE, Page

COLOURS = dict(zip(WAYS, (GREY, ORANGE, GREEN), strict=True))


def write_concealed_page(result: Concealed, path: Path) -> Path:
    """Write the page, self-contained."""
    low, high = 100.0 * result.c3_low, 100.0 * result.c3_high
    page = Page("Concealed physics")
    page.sentence(sentence(result), "good" if result.found else "bad")
    page.section(
        "What the robot's own figures show",
        f"Every hop's C3 is judged by its published range, {low:.0f} to {high:.0f} %. The energy chain closes where "
        "height and C2, C3 and the loss-free jump agree. Neither says that something is missing.",
    )
    page.table(*learned_rows(result))
    page.figure(c3_figure(result), "C3 as flight estimated it, with its standard uncertainty.")
    page.section("What the diagnosis found in the same hops", findings_text(result))
    page.section(
        "Hops that no fit saw",
        "Predicted from the compression held before the fire command, nothing else of the hop.",
    )
    page.table(*later_rows(result))
    page.figure(
        error_figure(result), "Predicted less true height; the bar of what was found should be the smallest."
    )
    page.section(
        "Rehearsed with what was found",
        "The same flight software flew the same hops against the plant that the diagnosis wrote: what it would have "
        "seen there, beside what it saw on the robot.",
    )
    page.table(*rehearsed_rows(result))
    return page.write(path)


def findings_text(result: Concealed) -> str:
    """The findings in words, with where the whole diagnosis is."""
    found = result.outcome.diagnosis
    lines = [
        f"{f.statement} (probability {f.probability:.2f}, {f.equation.replace('_', ' ')})"
        for f in found.findings
    ]
    text = "\n\n".join(lines) or "Nothing beyond noise and tolerances."
    return f"{text}\n\nThe whole diagnosis is in the folder diagnosis beside this page."


def c3_figure(result: Concealed) -> Figure:
    """C3 by stored energy, the published range shaded."""
    seen = [(hop.report.plan.energy_j, hop.report.c3) for hop in result.learned if hop.report.c3 is not None]
    figure = Figure()
    figure.add_hrect(100 * result.c3_low, 100 * result.c3_high, fillcolor=BLUE, opacity=0.12, line_width=0)
    figure.add_scatter(
        x=[energy for energy, _ in seen],
        y=[100 * c3.value for _, c3 in seen],
        error_y={"array": [100 * c3.sigma for _, c3 in seen]},
        mode="markers",
        marker={"color": BLUE, "size": 9},
        name="C3",
    )
    figure.update_layout(xaxis_title="energy stored [J]", yaxis_title="C3 [%]", showlegend=False, height=320)
    return figure


def error_figure(result: Concealed) -> Figure:
    """Errors of the predicted heights by hop and way."""
    figure = Figure()
    names = [f"hop {one.hop}: {one.energy_j:g} J" for one in result.predictions]
    for way, colour in COLOURS.items():
        errors = [1e3 * (one.height_m[way] - one.true_height_m) for one in result.predictions]
        figure.add_bar(x=names, y=errors, name=way, marker_color=colour)
    figure.update_layout(barmode="group", yaxis_title="error of the height [mm]", height=340)
    return figure
