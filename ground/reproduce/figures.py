"""The published figures with our runs in them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go

from ground.report.page import BLUE, GREEN, GREY, ORANGE, VIOLET
from ground.reproduce.chain import Chain, ChainRun
from ground.reproduce.moon import moon_height_m
from ground.reproduce.outcome import Reproduction, row_words
from ground.reproduce.paper import Paper, PaperSurface, Span
from sim_hal.soils import Soils

NINETY_FIVE = 1.96
CURVE_POINTS = 60


def efficiency_figure(made: Reproduction, paper: Paper) -> go.Figure:
    """Figure 9: jumping efficiency 1 − C1 over the mass ratio of legs and robot."""
    figure = go.Figure()
    ratio = np.linspace(0.2, 0.4, CURVE_POINTS)
    figure.add_scatter(
        x=ratio, y=1.0 - ratio, mode="lines", line={"color": BLUE}, name="Eq. (A3), two masses"
    )
    runs = made.chain.runs
    x = [_mass_ratio(paper, run.run.foot) for run in runs]
    figure.add_scatter(
        x=x,
        y=[1.0 - c1 for c1 in made.c1_analysis],
        mode="markers",
        marker={"color": GREY, "size": 8},
        name="analysis, ours",
    )
    known = list(paper.feet.values())
    figure.add_scatter(
        x=[foot.leg_inertia_kg_m2 / foot.total_inertia_kg_m2 for foot in known],
        y=[1.0 - foot.c1.mean for foot in known],
        error_y=_bars([_flipped(foot.c1) for foot in known], 1.0),
        mode="markers",
        marker={"color": GREEN, "symbol": "line-ew-open", "size": 14, "line": {"width": 3}},
        name="analysis, published (Table 4)",
    )
    tests = made.chain.references
    figure.add_scatter(
        x=[_mass_ratio(paper, run.run.foot) for run in tests],
        y=[run.potential_j.value / run.used_j.value for run in tests],
        error_y={"array": [NINETY_FIVE * (run.potential_j / run.used_j).sigma for run in tests]},
        mode="markers",
        marker={"color": ORANGE, "symbol": "triangle-up", "size": 10},
        name="reference jumps, ours (95 %)",
    )
    figure.update_xaxes(title="legs' share of the mass (of inertia, on the arm)", range=[0.25, 0.33])
    figure.update_yaxes(title="E_pot / E_used", range=[0.58, 0.82])
    return figure.update_layout(height=430)


def rows_figure(chain: Chain, paper: Paper) -> go.Figure:
    """Table 5: C3 row by row, published range and mean beside our runs."""
    rows = [row for row in reversed(paper.surfaces) if _c3(chain, row)]
    names = [row_words(row) for row in rows]
    figure = go.Figure()
    figure.add_bar(
        base=[100.0 * (row.c3_direct.low or 0.0) for row in rows],
        x=[100.0 * ((row.c3_direct.high or 0.0) - (row.c3_direct.low or 0.0)) for row in rows],
        y=names,
        orientation="h",
        width=0.5,
        marker={"color": GREEN, "opacity": 0.3, "line": {"width": 0}},
        name="published range",
    )
    figure.add_scatter(
        x=[100.0 * row.c3_direct.mean for row in rows],
        y=names,
        mode="markers",
        marker={"symbol": "line-ns-open", "size": 20, "color": GREEN, "line": {"width": 3}},
        name="published mean",
    )
    points = [(name, value) for row, name in zip(rows, names, strict=True) for value in _c3(chain, row)]
    figure.add_scatter(
        x=[100.0 * value for _, value in points],
        y=[name for name, _ in points],
        mode="markers",
        marker={"color": BLUE, "size": 8, "opacity": 0.8},
        name="our runs",
    )
    figure.add_scatter(
        x=[100.0 * float(np.mean(_c3(chain, row))) for row in rows],
        y=names,
        mode="markers",
        marker={"symbol": "line-ns-open", "size": 20, "color": ORANGE, "line": {"width": 3}},
        name="our mean",
    )
    figure.update_xaxes(title="C3 by the reference jump just before [%]")
    return figure.update_layout(height=150 + 44 * len(rows))


def area_figure(chain: Chain, paper: Paper, soils: Soils, surface: str = "quartz_sand") -> go.Figure:
    """Figure 16: C3 over the foot's contact area."""
    figure = go.Figure()
    shapes = (("flat", "circle", BLUE), ("round", "triangle-up", ORANGE))
    for shape, symbol, colour in shapes:
        rows = [
            (row, paper.feet[row.foot].area_m2 or 0.0)
            for row in paper.surfaces
            if row.surface == surface and not row.tilt_deg and paper.feet[row.foot].shape == shape
        ]
        figure.add_scatter(
            x=[1e4 * area for _, area in rows],
            y=[100.0 * row.c3_direct.mean for row, _ in rows],
            error_y=_bars([row.c3_direct for row, _ in rows], 100.0),
            mode="markers",
            marker={"color": GREY, "symbol": symbol, "size": 11},
            name=f"{shape} feet, published",
        )
        ours = [(area, value) for row, area in rows for value in _c3(chain, row)]
        figure.add_scatter(
            x=[1e4 * area * 1.02 for area, _ in ours],
            y=[100.0 * value for _, value in ours],
            mode="markers",
            marker={"color": colour, "symbol": symbol, "size": 9, "opacity": 0.8},
            name=f"{shape} feet, ours",
        )
    law = soils.foot_law
    figure.update_xaxes(title="contact area [cm²]", type="log", tickvals=[50, 100, 150, 200, 250])
    figure.update_yaxes(title="C3 [%]", rangemode="tozero")
    text = f"law: χ ∝ A<sup>−{law.exponent:.2f}</sup>, k_l ∝ A<sup>{law.stiffness_exponent:.2f}</sup>"
    figure.add_annotation(
        x=0.98, y=0.95, xref="paper", yref="paper", xanchor="right", text=text, showarrow=False
    )
    return figure.update_layout(height=400)


def compaction_figure(chain: Chain, paper: Paper) -> go.Figure:
    """Figure 17: C3 of the hops on the soil that compacts, in order; a new place stands apart."""
    known = paper.compaction
    row = paper.row(known.surface, "1", 0.0)
    figure = go.Figure()
    runs = [run for run in chain.tests if run.run.surface == known.surface and run.c3_direct is not None]
    places = dict.fromkeys((run.run.setup, run.run.place) for run in runs)
    for number, place in enumerate(places):
        here = [(i, run) for i, run in enumerate(runs, start=1) if (run.run.setup, run.run.place) == place]
        figure.add_scatter(
            x=[i for i, _ in here],
            y=[100.0 * run.c3_direct.value for _, run in here if run.c3_direct],
            error_y={
                "array": [100.0 * NINETY_FIVE * run.c3_direct.sigma for _, run in here if run.c3_direct]
            },
            mode="lines+markers",
            marker={"size": 10, "color": (BLUE, ORANGE)[number % 2]},
            name="in one place" if number == 0 else "loosened again",
        )
    if row is not None:
        low, high = row.c3_direct.low or 0.0, row.c3_direct.high or 0.0
        figure.add_hrect(
            y0=100.0 * low, y1=100.0 * high, fillcolor=GREEN, opacity=0.15, line_width=0, layer="below"
        )
        figure.add_annotation(
            x=1.0, xref="paper", y=100.0 * high, text="published range", showarrow=False, xanchor="right",
            yanchor="top",
        )  # fmt: skip
    figure.update_xaxes(title="hop", dtick=1)
    figure.update_yaxes(title="C3 [%]", rangemode="tozero")
    return figure.update_layout(height=380)


def prediction_figure(made: Reproduction) -> go.Figure:
    """Figure 22: predicted over measured height."""
    figure = go.Figure()
    ways = (
        ("by_average", "as published: averages", GREY, "circle-open"),
        ("by_flight", "flight code, before the hop", BLUE, "circle"),
    )
    for way, name, colour, symbol in ways:
        shown = [(p, p.error(way)) for p in made.predictions if p.error(way) is not None]
        figure.add_scatter(
            x=[1e3 * p.height_m for p, _ in shown],
            y=[1e3 * p.height_m * (1.0 + (error or 0.0)) for p, error in shown],
            text=[f"{p.run.run.label}: {100.0 * (error or 0.0):+.1f} %" for p, error in shown],
            hoverinfo="text",
            mode="markers",
            marker={"color": colour, "symbol": symbol, "size": 9},
            name=name,
        )
    most = 1.08e3 * max(p.height_m for p in made.predictions)
    figure.add_scatter(
        x=[0, most], y=[0, most], mode="lines", line={"color": GREEN, "width": 1}, name="as measured"
    )
    figure.update_xaxes(title="measured height [mm]", range=[0, most])
    figure.update_yaxes(title="predicted height [mm]", range=[0, most])
    return figure.update_layout(height=460)


def moon_figure(chain: Chain, paper: Paper) -> go.Figure:
    """Figure 23: Hopter's height on the Moon over C3, and where our grounds lie."""
    moon = paper.moon
    figure = go.Figure()
    c3 = np.linspace(0.0, 0.7, CURVE_POINTS)
    for legs, dash in ((moon.legs, "solid"), (1, "dot")):
        figure.add_scatter(
            x=100.0 * c3,
            y=[moon_height_m(moon, value, legs) for value in c3],
            mode="lines",
            line={"color": GREY, "dash": dash},
            name=f"Eq. (6), {legs * moon.spring_energy_j:g} J",
        )
    colours = (BLUE, ORANGE, GREEN, VIOLET)
    rows = [row for row in paper.surfaces if row.foot == "1" and not row.tilt_deg and _c3(chain, row)]
    for row, colour in zip(rows, colours, strict=False):
        values = _c3(chain, row)
        x = [min(values), float(np.mean(values)), max(values)]
        figure.add_scatter(
            x=[100.0 * value for value in x],
            y=[moon_height_m(moon, value, moon.legs) for value in x],
            mode="lines+markers",
            line={"color": colour, "width": 7},
            marker={"size": [1, 12, 1], "color": colour},
            name=row.surface.replace("_", " "),
        )
    figure.add_hrect(
        y0=moon.height_low_m,
        y1=moon.height_high_m,
        fillcolor=GREEN,
        opacity=0.12,
        line_width=0,
        layer="below",
    )
    figure.update_xaxes(title="C3 [%]", range=[0, 70])
    figure.update_yaxes(title="height on the Moon [m]", rangemode="tozero")
    return figure.update_layout(height=430)


def _c3(chain: Chain, row: PaperSurface) -> list[float]:
    """C3 of a row's runs by the direct reference."""
    return [run.c3_direct.value for run in _of_row(chain, row) if run.c3_direct is not None]


def _of_row(chain: Chain, row: PaperSurface) -> list[ChainRun]:
    return [run for run in chain.tests if run.run.row == row.key]


def _mass_ratio(paper: Paper, foot: str) -> float:
    known = paper.feet[foot]
    return known.leg_inertia_kg_m2 / known.total_inertia_kg_m2


def _flipped(span: Span) -> Span:
    """1 − a span."""
    low, high = (None if value is None else 1.0 - value for value in (span.high, span.low))
    return Span(1.0 - span.mean, low, high)


def _bars(spans: Sequence[Span], scale: float) -> dict[str, object]:
    """Error bars from mean to the ends of the ranges."""
    return {
        "symmetric": False,
        "array": [scale * ((span.high or span.mean) - span.mean) for span in spans],
        "arrayminus": [scale * (span.mean - (span.mean if span.low is None else span.low)) for span in spans],
        "thickness": 1.5,
    }
