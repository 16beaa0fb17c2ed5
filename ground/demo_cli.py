"""`hopper demo`: demonstrations that fly, diagnose and predict, from nothing to figures."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from ground import console
from ground.demo_concealed import demonstrate
from ground.report.concealed_page import write_concealed_page
from ground.report.concealed_tables import content_of, later_rows, learned_rows, rehearsed_rows, sentence

demo_app = typer.Typer(no_args_is_help=True, help="Demonstrations, from a simulated robot to figures.")


@demo_app.callback()
def demo() -> None:
    """Demonstrations, from a simulated robot to figures."""


@demo_app.command()
def concealed(
    hide: Annotated[
        str, typer.Option(help="What the robot hides (config/demo/concealed.yaml), or: nothing.")
    ] = "soil_rate_dependence",
    seed: Annotated[int, typer.Option(help="Seed of the rig and of all noise; it repeats to the bit.")] = 1,
    out: Annotated[Path, typer.Option("--out", help="Folder for the results.")] = Path("out/concealed"),
    as_json: Annotated[bool, typer.Option("--json", help="Print the answer as JSON, for machines.")] = False,
    figures: console.FigureFolder = None,
) -> None:
    """Hide physics in a robot whose C3 looks normal, find it, and predict the next hops with it."""
    with console.clear_errors():
        with console.steps() as show:
            result = demonstrate(out, hide, seed, show, processes=min(4, os.cpu_count() or 1))
        page = write_concealed_page(result, out / "concealed.html")
        console.draw_figures(page, figures, quiet=as_json)
    if as_json:
        console.print_json(content_of(result))
        return
    console.table("Hops that the diagnosis saw", *learned_rows(result))
    console.table("Hops that no fit saw", *later_rows(result))
    console.table("The same hops by the same software, on the plant found", *rehearsed_rows(result))
    console.say(f"{sentence(result)}\npage: {page}")
