"""The `hopper` command."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from flight import settings as flight_settings
from flight.executive import Progress
from flight.plans import load_mission
from ground import api, console
from ground.campaign_cli import campaign_app
from ground.compile_cli import compile_app
from ground.data_cli import data_app
from ground.demo_cli import demo_app
from ground.diagnose.belonging import belonging
from ground.diagnose.pipeline import RESULTS, Outcome, diagnose, write_outcome
from ground.export_cli import dictionary_app, export_app
from ground.files import check_place, configured
from ground.help_examples import add_examples
from ground.link_cli import link_app
from ground.live.command import console_app
from ground.mission_run import plan_mission, run_mission
from ground.mission_summary import (
    HOP_LINE_HEADERS,
    MissionRun,
    hop_lines,
    mission_content,
    verdict_sentence,
    words,
)
from ground.paper_cli import add_paper_commands
from ground.plant_cli import plant_app
from ground.recordings_cli import Json, MapOption, PlantOption, recordings_app
from ground.replay import ReplayResult, replay_log
from ground.report.diagnosis_page import verdict_sentence as diagnosis_sentence
from hal.config import config_path
from hal.raspberry_pi import setup_check
from sim_hal.plant.simulate import load_plant

HOPS_OF_A_GOAL = 3
"""About as many, for the moving line."""

app = typer.Typer(no_args_is_help=True, help=__doc__, pretty_exceptions_enable=False)
app.add_typer(plant_app, name="plant")
app.add_typer(campaign_app, name="campaign")
add_paper_commands(app)
app.add_typer(dictionary_app, name="dictionary")
for other in (recordings_app, link_app, console_app, export_app, compile_app):
    app.registered_commands += other.registered_commands
app.add_typer(demo_app, name="demo")
app.add_typer(data_app, name="data")

Out = Annotated[Path, typer.Option("--out", help="Folder for the results.")]


@app.command()
def run(
    surface: Annotated[str, typer.Option(help="Surface to hop on (config/surfaces.yaml).")] = "quartz_sand",
    hops: Annotated[int, typer.Option(help="Hops on that surface.")] = 3,
    mission: Annotated[
        str | None,
        typer.Option(help="Mission file, or its name in config/missions, instead of hops on one surface."),
    ] = None,
    ground_memory: Annotated[
        Path | None,
        typer.Option(help="File that keeps what is learned of the ground from mission to mission."),
    ] = None,
    energy_j: Annotated[float, typer.Option("--energy-j", help="E_used of each hop.")] = 18.0,
    references: Annotated[int, typer.Option(help="Hops on steel first, which give C2_ref.")] = 1,
    board: Annotated[str, typer.Option(help="Board to fly on, by name; never another.")] = "sim",
    seed: Annotated[int, typer.Option(help="Seed of a simulated mission; it repeats to the bit.")] = 1,
    out: Out = Path("out/run"),
    as_json: Json = False,
    figures: console.FigureFolder = None,
) -> None:
    """Fly N hops on a surface, or a mission file: a table per hop, decisions, recordings and a page."""
    with console.clear_errors():
        settings = flight_settings.load(config_path("flight.yaml"))
        if mission is None:
            plan = plan_mission(surface, hops, energy_j, settings, references=references)
        else:
            plan = load_mission(configured("missions", mission), settings)
        expected = len(plan.hops) + HOPS_OF_A_GOAL * len(plan.goals)
        with console.steps(total=float(expected)) as show:
            show(f"opening the board {board!r} (a simulation compiles itself at its first use)")
            watch = mission_watcher(show, energy_j, expected)
            flown = run_mission(plan, out, board=board, seed=seed, watch=watch, ground_memory=ground_memory)
        console.draw_figures(flown.folder / "report.html", figures, quiet=as_json)
    if as_json:
        console.print_json(mission_content(flown))
    else:
        show_mission(flown)
    if not flown.result.completed:
        raise typer.Exit(1)


@app.command("diagnose")
def diagnose_command(
    recordings: Annotated[
        list[Path], typer.Argument(help="Recordings: CSV, MCAP, folders; others with --map.")
    ],
    plant: PlantOption,
    out: Out = Path("out/diagnosis"),
    mapping: MapOption = None,
    compare: Annotated[
        str | None, typer.Option(help="A plant with published physics and parameters, to compare with.")
    ] = None,
    as_json: Json = False,
    figures: console.FigureFolder = None,
) -> None:
    """Say what physics the plant lacks, add it, and show the fit improve on data that it never saw."""
    with console.clear_errors():
        given = load_plant(configured("plant", plant))
        reference = load_plant(configured("plant", compare)) if compare else None
        check_place(out, RESULTS[0], RESULTS)
        read = api.load(*recordings, mapping=mapping)
        if any(path.is_dir() for path in recordings):  # a folder may hold other rigs' recordings as well
            read, left_out = belonging(read, given)
            for reason in left_out:
                console.err.print(f"left out: {reason}", markup=False, highlight=False)
        with console.steps() as show:
            outcome = diagnose(read, given, show, reference, processes=min(4, os.cpu_count() or 1))
        write_outcome(outcome, out)
        console.draw_figures(out / "report.html", figures, quiet=as_json)
    if as_json:
        console.print_json(json.loads(outcome.diagnosis.to_json()))
    else:
        show_diagnosis(outcome, out)


@app.command()
def replay(
    log: Annotated[Path, typer.Argument(help="Flight log (MCAP) of a mission.")],
    recover: Annotated[bool, typer.Option(help="Take the whole part of a log that was cut.")] = False,
    as_json: Json = False,
) -> None:
    """Feed a log back through the flight code and compare every command and decision, bit for bit."""
    with console.clear_errors(), console.steps(total=1.0) as show:
        show(f"reading {log}")
        result = replay_log(log, recover, show)
    if as_json:
        console.print_json(replay_content(result))
    else:
        show_replay(result)
    if not result.same:
        raise typer.Exit(1)


def replay_content(result: ReplayResult) -> dict[str, Any]:
    """What a replay found, as JSON-able data."""
    counts = {"compared": result.compared, "commands": result.commands, "decisions": result.decisions}
    different = None if result.first_difference is None else str(result.first_difference)
    return {"same": result.same, **counts, "first_difference": different, "damage": result.damage}


def show_replay(result: ReplayResult) -> None:
    """What was compared, and where it first differed."""
    console.say(
        f"compared: {result.compared} messages, of them {result.commands} commands, {result.decisions} decisions"
    )
    if result.first_difference is None:
        console.say("the replay is the same, bit for bit")
    else:
        console.err.print(f"first difference: {result.first_difference}", markup=False, highlight=False)


@app.command()
def setup(
    board_settings: Annotated[
        Path | None, typer.Option(help="Wiring instead of config/boards/raspberry_pi.yaml.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Check whether this computer is ready to be the robot; say what is wrong and how to mend it."""
    with console.clear_errors():
        findings = setup_check.look(board_settings)
    if as_json:
        console.print_json([asdict(finding) for finding in findings])
    else:
        console.say(setup_check.report(findings))
    if not all(finding.good for finding in findings):
        raise typer.Exit(1)


def mission_watcher(show: Callable[..., None], energy_j: float, hops: int) -> Callable[[Progress], None]:
    """Turn the flight's progress into the moving line."""

    def watch(progress: Progress) -> None:
        phase = words(progress.phase.name.lower())
        at = min(progress.hop_index + 1, hops)
        stored = min(1.0, progress.energy_used_j / energy_j)
        text = f"hop {at} of {hops}: {phase}, {progress.energy_used_j:.1f} J, t = {progress.time_s:.0f} s"
        show(text, progress.hop_index + stored)

    return watch


def show_mission(flown: MissionRun) -> None:
    """The table of hops, what came of the mission in words, and where its page is."""
    console.hop_table(HOP_LINE_HEADERS, [hop_lines(outcome) for outcome in flown.hops])
    for each in flown.result.decided:
        came = {None: "", True: " Reached.", False: " Not reached."}[each.reached]
        console.say(f"hop {each.hop_index + 1} at {each.place}: {each.decision.sentence}{came}")
    for text in (verdict_sentence(flown), *flown.notes, f"page: {flown.folder / 'report.html'}"):
        console.say(text)


def show_diagnosis(outcome: Outcome, folder: Path) -> None:
    """Verdict, findings, and the fit before and after."""
    found = outcome.diagnosis
    console.out.print(f"[bold]{found.verdict}[/]: ", end="")
    console.say(diagnosis_sentence(found))
    rows = []
    for number, finding in enumerate(found.findings, start=1):
        rivals = ", ".join(f"{a.physics_id} {a.probability:.2f}" for a in finding.alternatives[:2]) or "–"
        rows.append((str(number), finding.physics_id, f"{finding.probability:.2f}", rivals))
        console.say(f"{number}. {finding.statement}")
    if rows:
        console.table("Findings", ("", "physics", "probability", "rivals"), rows)
    fits = [
        (
            name,
            f.unit,
            f"{f.nominal_rms:.4g}",
            f"{f.refit_rms:.4g}",
            f"{f.extended_rms:.4g}",
            f"{f.noise_rms:.2g}",
        )
        for name, f in found.fit.items()
    ]
    headings = ("channel", "unit", "nominal", "refit", "extended", "noise")
    console.table("Held-out error (rms)", headings, fits)
    reference = found.details.get("reference")
    if isinstance(reference, dict):
        headers = ("quantity", "unit", "found", "± 1σ", "published", "± 1σ", "apart")
        console.table(f"Beside {reference['source']}", headers, reference["rows"])
    for note in found.notes:
        console.say(f"note: {note}")
    console.say(f"page: {folder / 'report.html'}")


add_examples(app)
