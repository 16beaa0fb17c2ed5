"""`hopper campaign`: many simulated cases at once, on this computer or on a cluster."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from ground import console
from ground.campaign import engine, summary
from ground.campaign.crews import crew
from ground.campaign.diagnosis import load_diagnosis
from ground.campaign.engine import StudyResult, run_study
from ground.campaign.missions import load_missions
from ground.campaign.store import STAMP_NAME, kept_stamp, read_rows
from ground.campaign.study import FAILED, Study, stamp_of
from ground.fault_campaign.campaign import CampaignResult, FaultStudy, run_campaign
from ground.fault_campaign.drawing import load_campaign
from ground.files import write_atomic
from ground.report.campaign_page import write_campaign_page
from hal.errors import ConfigError

campaign_app = typer.Typer(no_args_is_help=True, help="Campaigns of simulated missions.")

Seed = Annotated[int, typer.Option(min=0, help="Seed; the same one draws the same cases.")]
OutOption = Annotated[
    Path | None, typer.Option("--out", help="Folder that keeps each case (Parquet); goes on there.")
]
Processes = Annotated[int | None, typer.Option(min=1, help="Processes; all cores unless given.")]
Scheduler = Annotated[
    str | None, typer.Option(help="Address of a Dask scheduler (tcp://HOST:8786), instead of this computer.")
]
JsonFile = Annotated[Path | None, typer.Option("--json", help="File for the figures.")]

STUDIES: dict[str, Callable[[int], Study]] = {
    "faults": lambda seed: FaultStudy(load_campaign(), seed),
    "missions": load_missions,
    "diagnosis": load_diagnosis,
}


@campaign_app.callback()
def campaign() -> None:
    """Campaigns of simulated missions."""


@campaign_app.command()
def faults(
    count: Annotated[
        int, typer.Option(min=1, help="Faults that make a difference, several in a mission.")
    ] = 100,
    seed: Seed = 1,
    out: OutOption = None,
    processes: Processes = None,
    scheduler: Scheduler = None,
    json_file: JsonFile = None,
    figure_folder: console.FigureFolder = None,
) -> None:
    """Plant random faults in whole missions, and count what was dangerous, by the plant's truth."""
    folder = out or Path("out/campaign-faults")
    with _kept(folder):
        study = FaultStudy(load_campaign(), seed)
        with console.steps(total=float(count)) as show, crew(_cores(processes), scheduler) as workers:
            result, ran = run_campaign(study, count, folder, show, workers)
        page = write_campaign_page(result, seed, folder / "report.html")
        console.draw_figures(page, figure_folder)
        _write_figures(json_file, figures(result))
    console.table("Hazards", ("hazard", "missions"), [(k, str(v)) for k, v in result.hazards.items()])
    console.table("Ends", ("reason", "missions"), [(k, str(v)) for k, v in result.ends.most_common()])
    console.say(
        f"{result.faults} faults in {len(result.rows)} missions: {sum(result.hazards.values())} hazards, "
        f"{result.without_effect} faults without effect (a further {result.came_to_nothing} came to nothing and "
        "do not count)"
    )
    _show_run(study, ran, folder)
    console.say(f"page: {page}")
    if sum(result.hazards.values()) or result.failed:
        raise typer.Exit(1)


@campaign_app.command()
def missions(
    count: Annotated[int, typer.Option(min=1, help="Missions.")] = 100,
    seed: Seed = 1,
    out: OutOption = None,
    processes: Processes = None,
    scheduler: Scheduler = None,
    json_file: JsonFile = None,
) -> None:
    """Fly rigs as built on ground as it comes, and hold every estimate to the truth."""
    _study("missions", count, seed, out, processes, scheduler, json_file)


@campaign_app.command()
def diagnosis(
    count: Annotated[int, typer.Option(min=1, help="Diagnoses.")] = 20,
    seed: Seed = 1,
    out: OutOption = None,
    processes: Processes = None,
    scheduler: Scheduler = None,
    json_file: JsonFile = None,
) -> None:
    """Fly rigs that hide something or nothing, diagnose them, and count what was right."""
    _study("diagnosis", count, seed, out, processes, scheduler, json_file)


@campaign_app.command()
def replay(
    folder: Annotated[Path, typer.Argument(help="Folder of a campaign.")],
    case: Annotated[int, typer.Argument(min=0, help="Index of the case.")],
) -> None:
    """Do one case of a campaign again, show all of it, and say whether it came out the same."""
    with console.clear_errors():
        stamp = kept_stamp(folder)
        if stamp is None or stamp["study"] not in STUDIES:
            raise ConfigError(f"{folder / STAMP_NAME}: there is no campaign of {', '.join(STUDIES)}")
        study = STUDIES[stamp["study"]](int(stamp["seed"]))
        kept = read_rows(folder).get(case)
        for key, value in stamp_of(study).items():
            if stamp.get(key) != value:
                console.err.print(f"note: {key} is another by now, so the case may come out otherwise")
        with console.steps() as show:
            show(f"doing case {case} again")
            row, error = engine.replay(study, case)
    console.print_json(row)
    if error:
        console.err.print(error, markup=False, highlight=False)
    if kept is None:
        console.err.print(f"{folder} keeps no case {case}: nothing to compare with")
    elif kept == row:
        console.err.print("the same as it was kept")
    else:
        console.err.print("not the same as it was kept")
        raise typer.Exit(1)


def _study(
    name: str,
    count: int,
    seed: int,
    out: Path | None,
    processes: int | None,
    scheduler: str | None,
    json_file: Path | None,
) -> None:
    """Run a study whose cases count as one each, and show its table."""
    folder = out or Path("out") / f"campaign-{name}"
    with _kept(folder):
        study = STUDIES[name](seed)
        with console.steps(total=float(count)) as show, crew(_cores(processes), scheduler) as workers:
            ran = run_study(study, float(count), folder, workers, show)
        made = summary.SUMMARIES[name](ran.rows)
        _write_figures(json_file, {**made.figures, "failed": {"value": len(ran.failed), "unit": "1"}})
    console.table(made.title, made.headers, made.rows)
    console.say(made.sentence)
    _show_run(study, ran, folder)
    if ran.failed:
        raise typer.Exit(1)


@contextmanager
def _kept(folder: Path) -> Iterator[None]:
    with console.clear_errors(stopped=f"what was done is kept in {folder}; the same command goes on there"):
        yield


def _cores(processes: int | None) -> int:
    return processes or os.cpu_count() or 1


def _show_run(study: Study, ran: StudyResult, folder: Path) -> None:
    """How fast it went, which cases to look at, and how."""
    console.say(ran.throughput.text)
    console.say_if_interpreted()
    odd = [row["index"] for row in ran.rows if study.suspicious(row)]
    for what, indices in (("failed", [row["index"] for row in ran.failed]), ("to look at", odd)):
        if indices:
            more = f" and {len(indices) - 10} more" if len(indices) > 10 else ""
            console.say(f"{what}: cases {', '.join(map(str, indices[:10]))}{more}")
    first = [row["index"] for row in ran.failed] + odd
    if first:
        console.say(f"one again: hopper campaign replay {folder} {first[0]}")
    for row in ran.failed[:1]:
        console.say(f"case {row['index']}: {row[FAILED]}")


def _write_figures(path: Path | None, content: dict[str, dict[str, object]]) -> None:
    if path is not None:
        write_atomic(path, json.dumps({"figures": content}, indent=1) + "\n")


def figures(result: CampaignResult) -> dict[str, dict[str, object]]:
    """The figures of a campaign of faults."""
    values = {
        "faults": result.faults,
        "missions": len(result.rows),
        "hazards": sum(result.hazards.values()),
        "without_effect": result.without_effect,
        "came_to_nothing": result.came_to_nothing,
        "failed": len(result.failed),
        **{f"hazard_{name}": number for name, number in result.hazards.items()},
    }
    return {name: {"value": value, "unit": "1"} for name, value in values.items()}
