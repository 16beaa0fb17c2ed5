"""The figures of what the robot believed and decided."""

from __future__ import annotations

import plotly.graph_objects as go

from flight.surface.known import UNKNOWN
from flight.surface.seeker import Decided
from ground.mission_summary import HopOutcome, words
from ground.report.page import BLUE, GREEN, GREY, ORANGE, RED, VIOLET

COLOURS = (BLUE, ORANGE, GREEN, VIOLET, "#c9a227", "#4bb3c4")


def belief_figure(hops: list[HopOutcome]) -> go.Figure:
    """Probability of each surface after each hop, stacked; over it the probability that the ground had changed."""
    figure = go.Figure()
    known = [(hop.report.hop_index + 1, hop.report.belief) for hop in hops if hop.report.belief is not None]
    names = list(dict.fromkeys(name for _, belief in known for name in belief.probabilities))
    x = [number for number, _ in known]
    for index, name in enumerate(names):
        colour = GREY if name == UNKNOWN else COLOURS[index % len(COLOURS)]
        shares = [100.0 * belief.probabilities.get(name, 0.0) for _, belief in known]
        figure.add_bar(x=x, y=shares, name=words(name), marker={"color": colour})
    changed = [100.0 * belief.changed for _, belief in known]
    figure.add_scatter(
        x=x, y=changed, mode="markers", name="ground changed", marker={"color": RED, "symbol": "x", "size": 9}
    )
    figure.update_xaxes(title="hop", dtick=1)
    figure.update_yaxes(title="probability [%]", range=[0, 105])
    return figure.update_layout(height=360, barmode="stack")


def height_figure(decided: list[Decided], hops: list[HopOutcome]) -> go.Figure:
    """Predicted height of each hop with its 95 % interval, and the height that it reached."""
    figure = go.Figure()
    made = {hop.report.hop_index: hop for hop in hops}
    shown = [
        (each.hop_index, each.forecast)
        for each in decided
        if each.forecast is not None and each.hop_index in made
    ]
    figure.add_scatter(
        x=[index + 1 for index, _ in shown],
        y=[1e3 * forecast.height_m.middle for _, forecast in shown],
        error_y={
            "array": [1e3 * (forecast.height_m.high - forecast.height_m.middle) for _, forecast in shown],
            "arrayminus": [1e3 * (forecast.height_m.middle - forecast.height_m.low) for _, forecast in shown],
            "thickness": 2,
            "width": 6,
        },
        mode="markers",
        marker={"size": 9, "color": BLUE},
        name="predicted (95 %)",
    )
    measured = [(index + 1, made[index].report.energies.height_m) for index, _ in shown]
    figure.add_scatter(
        x=[number for number, height in measured if height is not None],
        y=[1e3 * height.value for _, height in measured if height is not None],
        mode="markers",
        marker={"size": 13, "symbol": "line-ew-open", "color": ORANGE, "line": {"width": 3}},
        name="reached",
    )
    figure.update_xaxes(title="hop", dtick=1)
    figure.update_yaxes(title="height [mm]")
    return figure.update_layout(height=340)
