"""`hopper campaign`: many simulated missions at once."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Annotated

import typer

from ground import console
from ground.fault_campaign.campaign import CampaignResult, run_campaign
from ground.fault_campaign.drawing import load_campaign
from ground.files import write_atomic
from ground.report.campaign_page import write_campaign_page

campaign_app = typer.Typer(no_args_is_help=True, help="Campaigns of simulated missions.")


@campaign_app.callback()
def campaign() -> None:
    """Campaigns of simulated missions."""


@campaign_app.command()
def faults(
    count: Annotated[
        int, typer.Option(min=1, help="Faults that make a difference, several in a mission.")
    ] = 100,
    seed: Annotated[int, typer.Option(help="Seed; the same one draws the same cases.")] = 1,
    out: Annotated[Path, typer.Option("--out", help="Folder that keeps each case; goes on there.")] = Path(
        "out/campaign-faults"
    ),
    processes: Annotated[int | None, typer.Option(min=1, help="Processes; all cores unless given.")] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="File for the figures.")] = None,
    figure_folder: console.FigureFolder = None,
) -> None:
    """Plant random faults in whole missions, and count what was dangerous, by the plant's truth."""
    with console.clear_errors(stopped=f"what was flown is kept in {out}; the same command goes on there"):
        settings = load_campaign()
        with console.steps(total=float(count)) as show:
            result = run_campaign(settings, count, seed, out, processes or os.cpu_count() or 1, show)
        page = write_campaign_page(result, seed, out / "report.html")
        console.draw_figures(page, figure_folder)
        if json_file is not None:
            write_atomic(json_file, json.dumps({"figures": figures(result)}, indent=1) + "\n")
    console.table("Hazards", ("hazard", "missions"), [(k, str(v)) for k, v in result.hazards.items()])
    console.table("Ends", ("reason", "missions"), [(k, str(v)) for k, v in result.ends.most_common()])
    console.say(
        f"{result.faults} faults in {len(result.rows)} missions: {sum(result.hazards.values())} hazards, "
        f"{result.without_effect} faults without effect (a further {result.came_to_nothing} came to nothing and "
        "do not count)"
    )
    console.say(f"page: {page}")
    if sum(result.hazards.values()):
        raise typer.Exit(1)


def figures(result: CampaignResult) -> dict[str, dict[str, object]]:
    """The figures of a campaign."""
    values = {
        "faults": result.faults,
        "missions": len(result.rows),
        "hazards": sum(result.hazards.values()),
        "without_effect": result.without_effect,
        "came_to_nothing": result.came_to_nothing,
        **{f"hazard_{name}": number for name, number in result.hazards.items()},
    }
    return {name: {"value": value, "unit": "1"} for name, value in values.items()}
