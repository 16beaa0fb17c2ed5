"""The page of a diagnosis: verdict, where it shows, what it is, how much better the prediction becomes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from ground.diagnose.evidence import Evidence, LocatedForce, Trace
from ground.diagnose.result import Diagnosis, Finding
from ground.report.page import BLUE, GREEN, GREY, ORANGE, RED, Cell, Page, Tone

Float = NDArray[np.float64]

POINTS = 2000
"""Points that a plot keeps of a long trace; more only make the page heavy."""
NO_CHANGE = 0.02
"""Errors this close to each other are the same."""
WILD = 5.0
"""A nominal prediction this many times worse than the refit is hidden until asked for: it would flatten the rest."""
STRETCHES = 60
CLEARLY = 2.0


def write_diagnosis_page(
    path: Path, diagnosis: Diagnosis, evidence: Evidence, plant_text: str, equations: Sequence[str] = ()
) -> Path:
    """Write the page to `path`, whole or not at all; `equations` (MathML) are those of the extended plant."""
    page = Page(f"What the simulation of {diagnosis.plant} left out")
    page.sentence(verdict_sentence(diagnosis), "good" if diagnosis.verdict == "consistent" else "bad")
    for number, finding in enumerate(diagnosis.findings, start=1):
        add_finding(page, number, finding)
    add_fit(page, diagnosis)
    for trace in evidence.traces:
        noise = diagnosis.fit[trace.channel].noise_rms
        page.figure(
            trace_figure(trace, noise),
            f"{trace.run}: {trace.channel}, held out of the fit. Shaded: where the refitted plant's error exceeds "
            "the sensor's noise.",
        )
    add_forces(page, evidence)
    add_published(page, diagnosis.details.get("reference"))
    page.section(
        "What to do next", diagnosis.next_experiment or "Nothing that this plant and these runs ask for."
    )
    add_power(page, diagnosis)
    if diagnosis.notes:
        page.section("Keep in mind", "\n\n".join(diagnosis.notes))
    page.section("The plant with what was found").equations(equations).code(plant_text)
    return page.write(path)


def verdict_sentence(diagnosis: Diagnosis) -> str:
    """The answer in one sentence."""
    if diagnosis.verdict == "consistent":
        return (
            "Simulation and recordings agree within noise and tolerances; nothing is missing that shows here."
        )
    if not diagnosis.findings:
        return "Simulation and recordings differ, and no known piece of physics explains the difference."
    names = [finding.physics_id.replace("_", " ") for finding in diagnosis.findings]
    listed = names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
    if diagnosis.verdict == "undecidable":
        return f"Simulation and recordings differ; the data leave open what it is ({listed} come closest)."
    channel, before, after, unit = main_improvement(diagnosis)
    return (
        f"The simulation left out {listed}. With it, the error of {channel} on data that the fit never saw falls "
        f"from {before:.3g} to {after:.3g} {unit}."
    )


def main_improvement(diagnosis: Diagnosis) -> tuple[str, float, float, str]:
    """The channel that gains the most on held-out data: name, error of the refit, error extended, unit."""
    name, fit = max(
        diagnosis.fit.items(), key=lambda item: item[1].refit_rms / max(item[1].extended_rms, 1e-300)
    )
    return name, fit.refit_rms, fit.extended_rms, fit.unit


def add_finding(page: Page, number: int, finding: Finding) -> None:
    """One finding: statement, formula, parameters, rivals."""
    page.section(f"{number}. {finding.physics_id.replace('_', ' ')}", finding.statement)
    page.code(finding.formula)
    page.table(
        ["parameter", "value", "± 1σ", "unit"],
        [[n, f"{e.value:.5g}", f"{e.std:.2g}", e.unit] for n, e in finding.parameters.items()],
    )
    page.text(
        f"Enters {finding.equation.replace('_', ' ')}, phase {finding.phase.replace('_', ' ')}. {finding.regime}"
    )
    rows = [[finding.physics_id, f"{finding.probability:.3f}"]]
    rows += [[rival.physics_id, f"{rival.probability:.3f}"] for rival in finding.alternatives]
    page.table(["explanation", "probability"], rows)


def add_fit(page: Page, diagnosis: Diagnosis) -> None:
    """Held-out errors of the three fits."""
    page.section(
        "Before and after, on data that the fit never saw",
        "Nominal: the plant as given. Refit: its own parameters re-estimated within their tolerances. "
        "Extended: with what was found. Held out: " + ", ".join(diagnosis.held_out) + ".",
    )
    rows = []
    for name, fit in diagnosis.fit.items():
        extended = Cell(f"{fit.extended_rms:.4g}", tone_of(fit.extended_rms / max(fit.refit_rms, 1e-300)))
        white = diagnosis.residual_whiteness[name]
        figures = (fit.nominal_rms, fit.refit_rms)
        whiteness = (f"{p:.2g}" for p in (white.refit_p, white.extended_p))
        errors = (f"{figure:.4g}" for figure in figures)
        rows.append([name, *errors, extended, f"{fit.noise_rms:.3g}", fit.unit, *whiteness])
    page.table(
        [
            "channel",
            "nominal rms",
            "refit rms",
            "extended rms",
            "noise",
            "unit",
            "white before",
            "white after",
        ],
        rows,
    )
    windows = diagnosis.details.get("windowed_rms")
    if windows:
        page.table(
            ["channel, anchored anew in each window", "nominal rms", "refit rms", "extended rms", "unit"],
            [
                [
                    name,
                    *(f"{errors[key]:.4g}" for key in ("nominal", "refit", "extended")),
                    diagnosis.fit[name].unit,
                ]
                for name, errors in windows.items()
            ],
        )


def tone_of(ratio: float) -> Tone:
    """Whether an error that became `ratio` of what it was is better, worse or the same."""
    return "plain" if abs(ratio - 1.0) < NO_CHANGE else "good" if ratio < 1.0 else "bad"


def add_power(page: Page, diagnosis: Diagnosis) -> None:
    """What else these recordings would have shown, and what they could not."""
    power = diagnosis.details.get("power")
    if not power:
        return
    page.section(
        "What else would have shown",
        "The smallest strength of each effect that these recordings would have given away, at the shape that they "
        "feel best. An effect that is not found here may still be there if it is weaker.",
    )
    page.table(
        ["effect", "enters", "parameter", "smallest strength seen", "unit"],
        [
            [
                row["physics_id"].replace("_", " "),
                row["place"].replace("_", " "),
                row["parameter"],
                f"{row['smallest_seen']:.2g}",
                row["unit"],
            ]
            for row in sorted(power, key=lambda row: str(row["physics_id"]))
        ],
    )
    if diagnosis.details.get("untestable"):
        page.text(
            "Would not show in these recordings at all: " + ", ".join(diagnosis.details["untestable"]) + "."
        )


def thin(values: Float) -> Float:
    """At most `POINTS` of a trace, evenly taken."""
    step = max(1, -(-values.size // POINTS))
    return values[::step].astype(np.float32)


def trace_figure(trace: Trace, noise: float) -> go.Figure:
    """Prediction against measurement above, the errors below; shaded where the refit's exceed the noise."""
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.06)
    time = thin(trace.times_s)
    lines: Mapping[str, tuple[Float, str]] = {
        "nominal": (trace.nominal, GREY),
        "refit": (trace.refit, ORANGE),
        "extended": (trace.extended, GREEN),
    }
    usual = error_of(trace.measured - trace.refit)
    for name, (values, colour) in lines.items():
        wild = error_of(trace.measured - values) > WILD * max(usual, 1e-300)
        visible = "legendonly" if wild and name == "nominal" else True
        line = {"color": colour, "width": 1.5}
        shared = {"x": time, "line": line, "legendgroup": name, "visible": visible, "mode": "lines"}
        figure.add_scatter(y=thin(values), name=name, row=1, col=1, **shared)
        figure.add_scatter(y=thin(trace.measured - values), showlegend=False, row=2, col=1, **shared)
    figure.add_scatter(
        x=time, y=thin(trace.measured), name="measured", line={"color": BLUE, "width": 1.5}, row=1, col=1
    )
    for start, stop in shaded(trace, noise):
        figure.add_vrect(x0=start, x1=stop, fillcolor=RED, opacity=0.12, line_width=0)
    figure.update_yaxes(title_text=f"{trace.channel} [{trace.unit}]", row=1, col=1)
    figure.update_yaxes(title_text=f"measured − predicted [{trace.unit}]", row=2, col=1)
    figure.update_xaxes(title_text="time [s]", row=2, col=1)
    figure.update_layout(height=560, legend={"orientation": "h", "y": 1.08})
    return figure


def error_of(errors: Float) -> float:
    """Root mean square of what is there."""
    return float(np.sqrt(np.nanmean(errors**2))) if np.isfinite(errors).any() else 0.0


def shaded(trace: Trace, noise: float) -> list[tuple[float, float]]:
    """Stretches in which the refitted plant's error is clearly more than noise, neighbours joined."""
    errors = trace.measured - trace.refit
    found: list[tuple[float, float]] = []
    edges = np.unique(np.linspace(0, errors.size, STRETCHES + 1).round().astype(int))
    for start, stop in pairwise(edges):
        if error_of(errors[start:stop]) > CLEARLY * max(noise, 1e-300):
            span = (float(trace.times_s[start]), float(trace.times_s[min(stop, errors.size - 1)]))
            joins = bool(found) and found[-1][1] >= span[0]
            found = [*found[:-1], (found[-1][0], span[1])] if joins else [*found, span]
    return found


def add_forces(page: Page, evidence: Evidence) -> None:
    """The missing force of each balance equation, against time and against what it depends on most."""
    if not evidence.forces:
        return
    page.section(
        "Where it is missing",
        "An unknown force, let into one balance equation at a time and smoothed from the recording without "
        "assuming its form. The equation whose force makes the recording likeliest is the deficient one.",
    )
    page.table(
        ["equation", "log-likelihood gained", "its force is explained by"],
        [
            [
                force.equation,
                f"{force.log_likelihood_gain:.4g}",
                ", ".join(f"{cause} {share:.0%}" for cause, share in force.explained.items() if share > 0.05)
                or "none of these alone: " + ", ".join(force.explained),
            ]
            for force in evidence.forces
        ],
    )
    force = evidence.forces[0]
    page.figure(
        force_figure(force), f"{force.run}: the force that {force.equation} lacks, and what was found for it."
    )


def force_figure(force: LocatedForce) -> go.Figure:
    """Smoothed force against time with its band; beside it, against its strongest cause."""
    best = max(force.causes, key=lambda name: force.explained[name])
    cause = best if force.explained[best] > 0.0 else "time"
    figure = make_subplots(rows=1, cols=2, column_widths=[0.6, 0.4], horizontal_spacing=0.1)
    time, before, std = thin(force.times_s), thin(force.before), thin(force.before_std)
    edge = {"mode": "lines", "line": {"width": 0}, "showlegend": False, "hoverinfo": "skip"}
    figure.add_scatter(x=time, y=before + 1.96 * std, row=1, col=1, **edge)
    figure.add_scatter(
        x=time, y=before - 1.96 * std, fill="tonexty", fillcolor="rgba(59,130,246,0.25)", row=1, col=1, **edge
    )
    figure.add_scatter(
        x=time, y=before, name="lacking before", line={"color": BLUE, "width": 1}, row=1, col=1
    )
    by_cause = {"mode": "markers", "marker": {"size": 3, "color": BLUE, "opacity": 0.5}, "showlegend": False}
    figure.add_scatter(x=thin(force.causes[cause]), y=before, row=1, col=2, **by_cause)
    if force.law is not None and force.after is not None:
        law = {
            "name": "what was found",
            "marker": {"size": 3, "color": RED},
            "line": {"color": RED, "width": 1},
        }
        figure.add_scatter(x=time, y=thin(force.law), row=1, col=1, mode="lines", **law)
        figure.add_scatter(
            x=thin(force.causes[cause]),
            y=thin(force.law),
            row=1,
            col=2,
            mode="markers",
            showlegend=False,
            **law,
        )
        figure.add_scatter(
            x=time, y=thin(force.after), name="lacking after", line={"color": GREEN, "width": 1}, row=1, col=1
        )
    figure.update_xaxes(title_text="time [s]", row=1, col=1)
    figure.update_xaxes(title_text=cause, row=1, col=2)
    figure.update_yaxes(title_text=f"missing force [{force.unit}]", row=1, col=1)
    figure.update_layout(height=420, legend={"orientation": "h", "y": 1.12})
    return figure


def add_published(page: Page, reference: object) -> None:
    """Parameters found beside published ones, where the user gave some."""
    if not isinstance(reference, dict) or not reference.get("rows"):
        return
    page.section(f"Beside {reference['source']}")
    page.table(
        ["quantity", "unit", "found", "± 1σ", "published", "± 1σ", "apart"],
        [[str(cell) for cell in row] for row in reference["rows"]],
    )
