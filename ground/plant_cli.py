"""`hopper plant`: plant files, checked and shown."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ground import console
from ground.diagnose.unlike_units import unstated_units
from ground.files import configured
from ground.recordings_cli import Json
from ground.report.page import Page
from ground.typeset import as_text, equations_of, mathml
from sim_hal.plant.simulate import Plant, compile_plant, load_plant

plant_app = typer.Typer(no_args_is_help=True, help="Plant files.")
HEADERS = ("parameter", "value", "± 1σ", "unit")


@plant_app.command()
def check(
    file: Annotated[str, typer.Argument(help="Plant file, or a name in config/plant.")], as_json: Json = False
) -> None:
    """Read a plant file, check names, units and formulas, and list what it holds."""
    with console.clear_errors():
        plant = load_plant(configured("plant", file))
        compile_plant(plant)
    if as_json:
        found = {name: {"value": p.value, "std": p.std, "unit": p.unit} for name, p in plant.flat().items()}
        enters = {name: balance.unit for name, balance in plant.structure.balances.items()}
        console.print_json(
            {"name": plant.name, "kind": plant.kind, "parameters": found, "missing_force": enters}
        )
        return
    console.table(f"{plant.name} ({plant.kind}): sound", HEADERS, parameter_rows(plant))
    for name, balance in plant.structure.balances.items():
        console.say(f"a missing force may enter {name}, in {balance.unit}")
    for note in unstated_units(plant):
        console.say(note)


@plant_app.command()
def show(
    file: Annotated[str, typer.Argument(help="Plant file, or a name in config/plant.")],
    page: Annotated[Path | None, typer.Option(help="Also write the equations as a page (HTML).")] = None,
) -> None:
    """Show a plant's equations as a person writes them, with the effects in it."""
    with console.clear_errors():
        plant = load_plant(configured("plant", file))
        compile_plant(plant)
        equations = equations_of(plant)
        if page is not None:
            shown = Page(f"{plant.name}: equations").equations(map(mathml, equations))
            shown.table(HEADERS, parameter_rows(plant)).write(page)
    lines = as_text(equations)
    wide = max(len(left) for left, _, _ in lines)
    for left, right, origin in lines:
        console.say(f"{left:>{wide}} = {right}" + (f"    ({origin})" if origin else ""))
    console.table("parameters", HEADERS, parameter_rows(plant))


def parameter_rows(plant: Plant) -> list[tuple[str, str, str, str]]:
    """Every parameter of a plant: name, value, tolerance, unit."""
    return [(name, f"{p.value:g}", f"{p.std:g}", p.unit) for name, p in plant.flat().items()]
