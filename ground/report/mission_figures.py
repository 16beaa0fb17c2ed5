"""The figures of a mission's page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from flight.settings import RigSettings
from flight.surface.belief import GroundBelief
from ground.mission_summary import HopOutcome, plus_minus, words
from ground.recordings import Recording
from ground.report.page import BLUE, GREEN, GREY, ORANGE, RED, VIOLET

NINETY_FIVE = 1.96
ZOOM_S = 0.006
"""Half the stretch that is shown around take-off and touchdown."""
BEFORE_S, AFTER_S = 0.2, 0.5
"""What a hop's figure keeps before the fire command, and beyond the end of what is shown at first."""


def c3_figure(hops: list[HopOutcome]) -> go.Figure:
    """C3 over hops: estimates with 95 % intervals, truth where known, belief as a band."""
    figure = go.Figure()
    places = dict.fromkeys(hop.report.plan.place for hop in hops)
    for place in places:
        here = [hop for hop in hops if hop.report.plan.place == place]
        _add_belief_band(figure, here, place)
        values = [(hop.report.hop_index + 1, hop.report.c3) for hop in here if hop.report.c3 is not None]
        figure.add_scatter(
            x=[number for number, _ in values],
            y=[100.0 * c3.value for _, c3 in values],
            error_y={
                "array": [100.0 * NINETY_FIVE * c3.sigma for _, c3 in values],
                "thickness": 2,
                "width": 6,
            },
            mode="markers",
            marker={"size": 9, "color": BLUE},
            name=f"estimate, place {place}",
        )
        known = [(hop.report.hop_index + 1, hop.truth.c3) for hop in here if hop.truth is not None]
        if known:
            figure.add_scatter(
                x=[number for number, _ in known],
                y=[100.0 * c3 for _, c3 in known],
                mode="markers",
                marker={"size": 13, "symbol": "line-ew-open", "color": ORANGE, "line": {"width": 3}},
                name="truth",
            )
    figure.update_xaxes(title="hop", dtick=1)
    figure.update_yaxes(title="C3 [%]")
    return figure.update_layout(height=340)


def _add_belief_band(figure: go.Figure, hops: list[HopOutcome], place: str) -> None:
    beliefs = [(hop.report.hop_index + 1, hop.report.belief) for hop in hops if hop.report.belief is not None]
    for number, belief in beliefs:
        half = NINETY_FIVE * belief.c3_std
        figure.add_bar(
            x=[number],
            base=[100.0 * (belief.c3_mean - half)],
            y=[200.0 * half],
            width=0.36,
            marker={"color": GREEN, "opacity": 0.3, "line": {"width": 0}},
            name=f"belief, place {place} (95 %)",
            legendgroup=f"belief {place}",
            showlegend=number == beliefs[0][0],
        )


def surface_figure(belief: GroundBelief, published_c3: Mapping[str, str]) -> go.Figure:
    """Probability of each known surface, beside its name the published range of C3, and of none of them."""
    names = sorted(belief.probabilities, key=lambda name: belief.probabilities[name])
    shares = [100.0 * belief.probabilities[name] for name in names]
    figure = go.Figure(
        go.Bar(
            x=shares,
            y=[f"{words(name)}  {published_c3.get(name, '')}".strip() for name in names],
            orientation="h",
            marker={"color": VIOLET},
            text=[f"{share:.0f} %" if share >= 0.5 else "< 0.5 %" for share in shares],
            textposition="outside",
            cliponaxis=False,
        )
    )
    figure.update_xaxes(title="probability [%]", range=[0, 108])
    return figure.update_layout(height=110 + 32 * len(names), showlegend=False)


def drive_figure(drive: Recording, rig: RigSettings, wanted_j: float) -> go.Figure:
    """Voltage, current and stored energy while tensioning."""
    figure = make_subplots(rows=3, shared_xaxes=True, vertical_spacing=0.05)
    time_s, compression_m = drive.times_s, drive.channels["spring_compression_m"]
    weight_n = rig.body_mass_kg * rig.gravity_m_s2
    energy_j = 0.5 * rig.spring_stiffness_n_m * compression_m**2 + weight_n * compression_m
    for row, (values, colour, title) in enumerate(
        (
            (drive.channels["motor_voltage_v"], GREY, "voltage [V]"),
            (drive.channels["motor_current_a"], ORANGE, "current [A]"),
            (energy_j, BLUE, "energy [J]"),
        ),
        start=1,
    ):
        shape = "hv" if row == 1 else "linear"
        there = np.isfinite(values)
        figure.add_scatter(
            x=time_s[there],
            y=values[there],
            mode="lines",
            line={"color": colour, "width": 1.3, "shape": shape},
            row=row,
            col=1,
        )
        figure.update_yaxes(title=title, row=row, col=1)
    figure.add_hline(y=wanted_j, line={"color": GREEN, "dash": "dash", "width": 1.5}, row=3, col=1)
    figure.update_xaxes(title="time [s]", row=3, col=1)
    return figure.update_layout(height=520, showlegend=False)


def hop_figure(outcome: HopOutcome) -> go.Figure:
    """Accelerometer over the hop, and around take-off and touchdown, sample by sample."""
    assert outcome.hop is not None
    fire_s = outcome.hop.event_time_s("fire_command") or 0.0
    force = outcome.hop.channels["body_acceleration_m_s2"]
    since_s = outcome.hop.times_s - fire_s
    there = np.isfinite(force) & (since_s > -BEFORE_S) & (since_s < _shown_until_s(outcome) + AFTER_S)
    time_s, force = since_s[there], force[there]
    marks = flight_marks(outcome)
    grid: list[list[dict[str, int] | None]] = [[{"colspan": 2}, None], [{}, {}]]
    figure = make_subplots(
        rows=2 if marks else 1,
        cols=2,
        specs=grid if marks else grid[:1],
        row_heights=[0.6, 0.4] if marks else None,
        vertical_spacing=0.2,
        subplot_titles=["", *(mark.title for mark in marks)],
    )
    figure.add_scatter(x=time_s, y=force, mode="lines", line={"color": BLUE, "width": 1.2}, row=1, col=1)
    figure.update_xaxes(
        title="time since the fire command [s]", range=[-0.05, _shown_until_s(outcome)], row=1, col=1
    )
    figure.update_yaxes(title="specific force [m/s²]", col=1)
    for column, mark in enumerate(marks, start=1):
        _draw(figure, mark, 1, 1, 1.0)
        near = np.abs(time_s - mark.time_s) < ZOOM_S
        figure.add_scatter(
            x=1e3 * time_s[near],
            y=force[near],
            mode="lines+markers",
            line={"color": BLUE, "width": 1},
            marker={"size": 4},
            row=2,
            col=column,
        )
        _draw(figure, mark, 2, column, 1e3)
        figure.update_xaxes(title="time [ms]", row=2, col=column)
    return figure.update_layout(height=600 if marks else 360, showlegend=False)


@dataclass(frozen=True)
class Mark:
    """An instant of the flight since the fire command [s], with its standard uncertainty and its truth."""

    name: str
    time_s: float
    sigma_s: float
    truth_s: float | None

    @property
    def title(self) -> str:
        """The instant in words."""
        return f"{self.name} {plus_minus(1e3 * self.time_s, 1e3 * self.sigma_s)} ms"


def flight_marks(outcome: HopOutcome) -> list[Mark]:
    """Take-off and touchdown as estimated; none where the flight could not be seen."""
    flight, truth, fire_s = outcome.report.energies.flight, outcome.truth, outcome.report.fire_s
    if outcome.report.verdict == "rejected":
        return []
    true = (truth.take_off_s, truth.touchdown_s) if truth else (None, None)
    since = [None if time_s is None else time_s - fire_s for time_s in true]
    return [
        Mark("take-off", flight.take_off_s - fire_s, flight.take_off_sigma_s, since[0]),
        Mark("touchdown", flight.touchdown_s - fire_s, flight.touchdown_sigma_s, since[1]),
    ]


def _draw(figure: go.Figure, mark: Mark, row: int, column: int, scale: float) -> None:
    """The 95 % band of an instant, and a dotted line where it truly was; `scale` converts seconds."""
    half_s = NINETY_FIVE * mark.sigma_s
    low, high = scale * (mark.time_s - half_s), scale * (mark.time_s + half_s)
    at = {"row": row, "col": column}
    figure.add_vrect(x0=low, x1=high, fillcolor=RED, opacity=0.25, line_width=0, **at)
    figure.add_vline(x=scale * mark.time_s, line={"color": RED, "width": 1.2}, **at)
    if mark.truth_s is not None:
        figure.add_vline(x=scale * mark.truth_s, line={"color": GREY, "dash": "dot", "width": 2}, **at)


def _shown_until_s(outcome: HopOutcome) -> float:
    """The end of what is shown at first: some time after the touchdown."""
    marks = flight_marks(outcome)
    return marks[-1].time_s + 0.3 if marks else 1.0
