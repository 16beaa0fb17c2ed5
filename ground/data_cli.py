"""`hopper data`: public recordings of real rigs."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from ground import console
from ground.data_sets import fetch, known_sets
from ground.recordings_cli import Json

data_app = typer.Typer(no_args_is_help=True, help="Public recordings of real rigs.")


@data_app.command("list")
def list_sets(as_json: Json = False) -> None:
    """List the data sets that can be fetched, with their licences."""
    with console.clear_errors():
        known = known_sets()
    if as_json:
        console.print_json({name: asdict(one) for name, one in known.items()})
        return
    rows = [(name, one.title, one.licence) for name, one in known.items()]
    console.table("data sets", ("name", "what", "licence"), rows)


@data_app.command("fetch")
def fetch_set(
    name: Annotated[str, typer.Argument(help="Name of the data set (hopper data list).")],
    out: Annotated[Path | None, typer.Option("--out", help="Folder; default: data/NAME.")] = None,
    as_json: Json = False,
) -> None:
    """Fetch a data set, check it, and say how to import it."""
    with console.clear_errors():
        one = known_sets().get(name)
        with console.steps() as show:
            paths = fetch(name, out or Path("data") / name, show=show)
    if as_json:
        console.print_json({"files": [str(path) for path in paths]})
        return
    for path in paths:
        console.say(f"{path}: fetched and checked")
    if one is not None:
        console.say(f"licence: {one.licence}")
        if one.import_with:
            console.say(f"import it with --map {one.import_with}")
