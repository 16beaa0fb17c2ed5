"""`hopper reproduce` and `hopper calibrate`: the simulation beside the published measurements."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Annotated

import typer

from ground import console
from ground.calibration.run import (
    CALIBRATION_HEADERS,
    calibrate_surfaces,
    calibration_content,
    calibration_rows,
    write_calibration,
)
from ground.files import configured
from ground.recordings_cli import Json
from ground.reproduce.command import (
    CONSOLE_HEADERS,
    JSON_NAME,
    configured_campaign,
    console_rows,
    flown_words,
    reproduce_by_flight,
    reproduce_by_table,
    write_results,
)
from ground.reproduce.page import verdict
from hal.errors import ConfigError


def add_paper_commands(app: typer.Typer) -> None:
    """Add both commands to the `hopper` command."""
    app.command()(reproduce)
    app.command()(calibrate)


def reproduce(
    table: Annotated[
        Path | None, typer.Option(help="A laboratory's campaign (CSV or XLSX) in place of the flown one.")
    ] = None,
    mapping: Annotated[str | None, typer.Option("--map", help="Which column of the table is what.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of the flown campaign; it repeats to the bit.")] = 1,
    out: Annotated[Path, typer.Option("--out", help="Folder for the results.")] = Path("out/reproduction"),
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Write every published number with ours to this file, too.")
    ] = None,
    processes: Annotated[int, typer.Option(min=1, help="Processes to fly on; the answer is the same.")] = 2,
    figures: console.FigureFolder = None,
) -> None:
    """Fly the published campaign through the flight code, and show every published number beside ours."""
    with console.clear_errors():
        if (table is None) != (mapping is None):
            raise ConfigError("--table and --map go together: the mapping says which column is what")
        campaign = configured_campaign()
        if table is not None and mapping is not None:
            made, flown_seed = (
                reproduce_by_table(campaign, table, configured("campaign_tables", mapping)),
                None,
            )
            how = f"From the table {table.name}: the same energy chain as the flown campaign's."
        else:
            with console.steps(total=float(campaign.hops)) as show:
                show(f"flying {campaign.hops} hops on {processes} processes")
                made, flown_seed = reproduce_by_flight(campaign, seed, show, processes), seed
            how = flown_words(campaign, seed)
            console.say_if_interpreted()
        page = write_results(campaign, made, out, flown_seed, how)
        console.draw_figures(page, figures)
        if json_file is not None:
            shutil.copyfile(out / JSON_NAME, json_file)
    console.table(campaign.paper.citation, CONSOLE_HEADERS, console_rows(made))
    console.say(verdict(made))
    console.say(f"page: {page}")


def calibrate(
    write: Annotated[
        bool, typer.Option("--write", help="Write config/surfaces.yaml and the plants.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Fit the simulated soils to the published dissipation, and show target and fit."""
    with console.clear_errors():
        with console.steps() as show:
            calibration, soils = calibrate_surfaces(show)
        fits = calibration.table(soils)
        written = write_calibration(calibration, soils, fits) if write else []
    if as_json:
        console.print_json(calibration_content(fits, written))
        return
    for path in written:
        console.say(f"{path}: written")
    console.table("C3 of fresh soil, %", CALIBRATION_HEADERS, calibration_rows(fits))
