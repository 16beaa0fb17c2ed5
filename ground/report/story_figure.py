"""One hop from end to end in one picture: what is wound up, and what comes of it."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from flight.settings import RigSettings
from ground.mission_summary import HopOutcome, figures
from ground.recordings import Recording
from ground.report.mission_figures import flight_marks
from ground.report.page import BLUE, GREEN, ORANGE

BEFORE_S, AFTER_S = 0.03, 0.25


def story_figure(outcome: HopOutcome, rig: RigSettings) -> go.Figure:
    """Stored energy and motor current while tensioning; specific force from release to rest, its flight shaded."""
    assert outcome.drive is not None and outcome.hop is not None
    figure = make_subplots(
        rows=2,
        cols=2,
        specs=[[{}, {"rowspan": 2}], [{}, None]],
        column_widths=[0.38, 0.62],
        horizontal_spacing=0.1,
        vertical_spacing=0.09,
        shared_xaxes=True,
        subplot_titles=["winding up", "the hop", ""],
    )
    _add_tensioning(figure, outcome.drive, rig)
    _add_flight(figure, outcome, outcome.hop)
    return figure.update_layout(height=430, showlegend=False, margin={"t": 40})


def _add_tensioning(figure: go.Figure, drive: Recording, rig: RigSettings) -> None:
    compression_m = drive.channels["spring_compression_m"]
    weight_n = rig.body_mass_kg * rig.gravity_m_s2
    energy_j = (0.5 * rig.spring_stiffness_n_m * compression_m + weight_n) * compression_m
    for row, values, colour, title in (
        (1, energy_j, BLUE, "stored energy [J]"),
        (2, drive.channels["motor_current_a"], ORANGE, "motor current [A]"),
    ):
        there = np.isfinite(values)
        line = {"color": colour, "width": 1.6}
        figure.add_scatter(x=drive.times_s[there], y=values[there], mode="lines", line=line, row=row, col=1)
        figure.update_yaxes(title=title, row=row, col=1)
    figure.update_xaxes(title="time [s]", row=2, col=1)


def _add_flight(figure: go.Figure, outcome: HopOutcome, hop: Recording) -> None:
    since_s = hop.times_s - (hop.event_time_s("fire_command") or 0.0)
    force = hop.channels["body_acceleration_m_s2"]
    marks = flight_marks(outcome)
    end_s = marks[-1].time_s + AFTER_S if marks else 1.0
    shown = np.isfinite(force) & (since_s > -BEFORE_S) & (since_s < end_s)
    line = {"color": BLUE, "width": 1.4}
    figure.add_scatter(x=1e3 * since_s[shown], y=force[shown], mode="lines", line=line, row=1, col=2)
    figure.update_xaxes(title="time since the fire command [ms]", row=1, col=2)
    figure.update_yaxes(title="specific force [m/s²]", row=1, col=2)
    if not marks:
        return
    found = {each.name: each.text for each in figures(outcome)}
    said = f"flight {found['time of flight']}<br>height {found['height']}"
    start_ms, stop_ms = (1e3 * mark.time_s for mark in marks)
    figure.add_vrect(x0=start_ms, x1=stop_ms, fillcolor=GREEN, opacity=0.14, line_width=0, row=1, col=2)
    middle = {"x": 0.5 * (start_ms + stop_ms), "y": 0.85 * float(force[shown].max()), "showarrow": False}
    figure.add_annotation(text=said, font={"size": 14}, row=1, col=2, **middle)
