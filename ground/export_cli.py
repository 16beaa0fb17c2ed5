"""`hopper export` and `hopper dictionary`: what the project writes for other tools."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from ground import console
from ground.dictionary_page import dictionary_page
from ground.export import export
from ground.recordings_cli import Json
from ground.viewer_layout import write_layout
from ground.xtce import write_xtce
from hal.dictionary import load_dictionary

export_app = typer.Typer()
dictionary_app = typer.Typer(help="Commands, events, telemetry channels and parameters.")


@export_app.command("export")
def export_command(
    file: Annotated[Path, typer.Argument(help="Flight log (MCAP) or recording (CSV pair, MCAP).")],
    to: Annotated[str, typer.Option("--to", help="csv or parquet.")] = "csv",
    out: Annotated[Path, typer.Option("--out", help="Folder for the tables.")] = Path("out/export"),
    recover: Annotated[bool, typer.Option(help="Take the whole part of a log that was cut.")] = False,
    as_json: Json = False,
) -> None:
    """Write a log or a recording as plain tables, one file for each device and kind of message."""
    with console.clear_errors(), console.steps() as show:
        written = export(file, out, to, recover, show)
    if as_json:
        console.print_json({"folder": str(out), "rows": written})
        return
    console.table(f"{out}", ("file", "", "rows"), [(name, "", str(rows)) for name, rows in written.items()])


@export_app.command("figures")
def figures_command(
    page: Annotated[Path, typer.Argument(help="A page that a command of hopper wrote (HTML).")],
    out: Annotated[Path, typer.Option("--out", help="Folder for the files.")] = Path("out/figures"),
    as_json: Json = False,
) -> None:
    """Write each plot of a page as PNG and SVG, for a paper; needs a Chromium and the extra 'figures'."""
    with console.clear_errors():
        written = console.draw_figures(page, out, quiet=as_json)
    if as_json:
        console.print_json({"folder": str(out), "files": [path.name for path in written]})


@export_app.command("layout")
def layout_command(
    file: Annotated[Path, typer.Argument(help="Layout file to write (JSON).")] = Path("hopper.layout.json"),
    as_json: Json = False,
) -> None:
    """Write a layout by which Foxglove or Lichtblick show a flight log: signals, phases, events, hops."""
    with console.clear_errors():
        write_layout(file)
    if as_json:
        console.print_json({"file": str(file)})
        return
    console.say(f"{file}: written; open the log in the viewer, then import this layout")


@dictionary_app.callback(invoke_without_command=True)
def dictionary_command(
    context: typer.Context,
    as_json: Json = False,
) -> None:
    """Print every command, event, telemetry channel and parameter as a page (Markdown)."""
    if context.invoked_subcommand is not None:
        return
    with console.clear_errors():
        found = load_dictionary()
    if as_json:
        console.print_json(asdict(found))
    else:
        print(dictionary_page(found), end="")


@dictionary_app.command("export")
def dictionary_export(
    xtce: Annotated[Path, typer.Option("--xtce", help="File to write: XTCE 1.2.")],
    as_json: Json = False,
) -> None:
    """Describe the link's telemetry packets to a mission control system such as Yamcs."""
    with console.clear_errors():
        write_xtce(load_dictionary(), xtce)
    if as_json:
        console.print_json({"file": str(xtce)})
    else:
        console.say(f"{xtce}: written")
