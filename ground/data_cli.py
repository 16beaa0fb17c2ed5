"""`hopper data`: public recordings of real rigs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ground import console
from ground.data_sets import fetch, known_sets

data_app = typer.Typer(no_args_is_help=True, help="Public recordings of real rigs.")


@data_app.command("list")
def list_sets() -> None:
    """List the data sets that can be fetched, with their licences."""
    with console.clear_errors():
        rows = [(name, one.title, one.licence) for name, one in known_sets().items()]
    console.table("data sets", ("name", "what", "licence"), rows)


@data_app.command("fetch")
def fetch_set(
    name: Annotated[str, typer.Argument(help="Name of the data set (hopper data list).")],
    out: Annotated[Path | None, typer.Option("--out", help="Folder; default: data/NAME.")] = None,
) -> None:
    """Fetch a data set, check it, and say how to import it."""
    with console.clear_errors():
        one = known_sets().get(name)
        for path in fetch(name, out or Path("data") / name):
            console.say(f"{path}: fetched and checked")
    if one is not None:
        console.say(f"licence: {one.licence}")
        if one.import_with:
            console.say(f"import it with --map {one.import_with}")
