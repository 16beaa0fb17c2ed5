"""The page of a case study, as Markdown with two pictures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.case_studies.rivalry import comparison, overview, pooled, ratios
from benchmarks.case_studies.run import FOUND, REFIT, Result
from benchmarks.case_studies.scores import Score
from benchmarks.case_studies.study import Study
from benchmarks.case_studies.svg import plot
from hal.config import config_path
from sim_hal.plant.units import channel_unit

SMALLEST_SHOWN = 6


def write_page(path: Path, name: str, study: Study, results: Sequence[Result]) -> None:
    """Write NAME.md and its pictures beside it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    command = f"python -m benchmarks.case_studies {name} --data FOLDER"
    lines = [
        f"# {study.title}",
        "",
        study.about.strip(),
        "",
        f"Made by `{command}`; errors are of data that no fit saw; between close rivals it had a say.",
        "",
    ]
    lines += ["## The plant as given", "", "```yaml", plant_text(study), "```", ""]
    if len(results) > 1:
        lines += overview(results)
    first = results[0]
    for result in results if len(results) == 1 else results[:1]:
        lines += found_section(result)
        lines += parameter_section(study, result)
        lines += score_section(result)
        lines += pictures(path, name, result)
        lines += open_section(result)
    if study.remarks:
        lines += ["## What to keep in mind", "", *(f"- {text}" for text in study.remarks), ""]
    lines += [data_section(first)]
    path.write_text("\n".join(lines).rstrip() + "\n", encoding="utf-8")


def plant_text(study: Study) -> str:
    """The plant file without its comment lines."""
    text = config_path("plant", f"{study.plant}.yaml").read_text(encoding="utf-8")
    return "\n".join(line for line in text.splitlines() if not line.startswith("#"))


def found_section(result: Result) -> list[str]:
    """Verdict, findings with formulas."""
    title = f" ({result.label})" if result.label else ""
    lines = [f"## What it found{title}", "", f"Verdict: **{result.diagnosis['verdict']}**.", ""]
    for finding in result.diagnosis["findings"]:
        rivals = ", ".join(
            f"{a['physics_id'].replace('_', ' ')} {a['probability']:.2f}"
            for a in finding["alternatives"][:3]
            if a["probability"] >= 0.01
        )
        where = finding["equation"].replace("_", " ")
        lines.append(
            f"- **{finding['physics_id'].replace('_', ' ')}** ({where}, probability {finding['probability']:.2f}"
            + (f"; or {rivals}" if rivals else "")
            + f"). {finding['statement']}"
        )
        lines.append(f"  Formula: `{finding['formula']}`. {finding['regime']}")
    if not result.diagnosis["findings"]:
        lines.append("No known piece of physics was found that predicts held-out data better.")
    return [*lines, ""]


def parameter_section(study: Study, result: Result) -> list[str]:
    """Parameters beside the published ones."""
    lines = ["## Parameters", "", "| parameter | found | unit | published |", "| --- | --- | --- | --- |"]
    for name, p in result.plant.flat().items():
        theirs = study.beside.get(name)
        other = f"{theirs.value:g} {theirs.unit} ({theirs.source})" if theirs else "–"
        sigma = f" ± {p.std:.2g}" if p.std > 0.0 else ""
        lines.append(f"| `{name}` | {p.value:.5g}{sigma} | {p.unit} | {other} |")
    return [*lines, ""]


def score_section(result: Result) -> list[str]:
    """Held-out errors of all models, with 90 % intervals."""
    lines = ["## Held-out errors", "", "Root mean square, with 90 % interval by block bootstrap.", ""]
    channels = list(next(iter(result.windowed.values())))
    head = [f"{c}, windows" for c in channels] + [f"{c}, free run" for c in channels]
    with_force = bool(result.force)
    head += [f"missing force [{result.force_unit}]"] if with_force else []
    lines += ["| model | " + " | ".join(head) + " |", "| --- " * (len(head) + 1) + "|"]
    for model in result.windowed:
        cells = [cell(result.windowed[model][c]) for c in channels] + [
            cell(result.free[model][c]) for c in channels
        ]
        cells += [cell(result.force.get(model))] if with_force else []
        lines.append(f"| {model} | " + " | ".join(cells) + " |")
    lines += ["", comparison(result), ""]
    return lines


def cell(score: Score | None) -> str:
    """A score, or that there is none."""
    if score is None:
        return "–"
    return str(score) if np.isfinite(score.value) else "runs away"


def pictures(path: Path, name: str, result: Result) -> list[str]:
    """A held-out window, and the missing force before and after."""
    lines = []
    channel = next(iter(result.plant.structure.outputs))
    traces = {"measured": result.window.observed[:, 0], "refitted": result.traces[REFIT]}
    traces["found"] = result.traces[FOUND]
    traces = {key: values for key, values in traces.items() if np.isfinite(values).any()}
    picture = plot(result.window.run.times_s, traces, "time [s]", channel)
    (path.parent / f"{name}-window.svg").write_text(picture, encoding="utf-8")
    lines += [f"![A held-out window]({name}-window.svg)", ""]
    if result.before is not None:
        cause = max(result.before.explained.items(), key=lambda item: item[1])[0]
        forces = {"lacking before": result.before.before}
        if result.after is not None and result.after.before.size == result.before.before.size:
            forces["lacking after"] = result.after.before
        label = f"missing force [{result.before.unit}]"
        picture = plot(result.before.causes[cause], forces, cause, label, dots=tuple(forces))
        (path.parent / f"{name}-force.svg").write_text(picture, encoding="utf-8")
        lines += [f"![The force that the plant lacks, over {cause}]({name}-force.svg)", ""]
    return lines


def open_section(result: Result) -> list[str]:
    """What the data could not tell, and what is still missing."""
    lines = ["## What it could not tell", ""]
    diagnosis = result.diagnosis
    for channel, fit in diagnosis["fit"].items():
        ratio = fit["extended_rms"] / fit["noise_rms"] if fit["noise_rms"] else float("inf")
        white = diagnosis["residual_whiteness"][channel]["extended_p"]
        noise = "down to the noise" if ratio < 1.3 else f"{ratio:.3g} times the sensor's own noise"
        still = "no noise: something is still missing" if white is not None and white < 1e-6 else "white"
        lines.append(f"- `{channel}`: free-run error {noise}; what is left is {still}.")
    if result.after is not None and result.after.explained:
        cause, share = max(result.after.explained.items(), key=lambda item: item[1])
        lines.append(
            f"- Of the force still missing, {cause} explains {share:.0%} (the most of all single causes)."
        )
    if diagnosis["next_experiment"]:
        lines.append(f"- {diagnosis['next_experiment']}")
    lines += [f"- {note}" for note in diagnosis["notes"]]
    seen = diagnosis["details"].get("power", [])[:SMALLEST_SHOWN]
    if seen:
        small = "; ".join(
            f"{row['physics_id'].replace('_', ' ')} of {row['smallest_seen']:.2g} {row['unit']}"
            for row in seen
        )
        lines.append(f"- Smallest that would have been seen: {small}.")
    return [*lines, ""]


def data_section(result: Result) -> str:
    """Which recordings were fitted and held out."""
    split = result.diagnosis["recordings"]
    fitted, held = ", ".join(split["fitted"][:30]), ", ".join(split["held_out"])
    return f"Fitted: {fitted}. Held out: {held}."


def figures_of(results: Sequence[Result]) -> dict[str, Any]:
    """Everything measured, for `--json`; null where a model ran away."""
    found: dict[str, Any] = {}
    for result in results:
        prefix = f"{result.label}." if result.label else ""
        for kind, scores in (("windows", result.windowed), ("free_run", result.free)):
            for model, channels in scores.items():
                for channel, score in channels.items():
                    key = f"{prefix}{kind}.{model.replace(' ', '_')}.{channel}"
                    found[key] = figure(score, channel_unit(channel))
        for model, score in result.force.items():
            found[f"{prefix}force.{model.replace(' ', '_')}"] = figure(score, result.force_unit)
        found |= {f"{prefix}{key}": figure(score, "1") for key, score in ratios(result).items()}
    if len(results) > 1:
        found |= {f"all together.{key}": figure(score, "1") for key, score in pooled(results).items()}
    return found


def figure(score: Score, unit: str) -> dict[str, Any]:
    """A score with its interval and unit."""
    numbers = {"value": score.value, "low": score.low, "high": score.high}
    return {**{name: v if np.isfinite(v) else None for name, v in numbers.items()}, "unit": unit}
