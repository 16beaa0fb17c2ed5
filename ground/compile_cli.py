"""`hopper compile`: machine code for what each tick of flight and simulation runs through."""

from __future__ import annotations

from typing import Annotated

import typer

from ground import console
from ground.compiling import MODULES, compile_modules, forget, up_to_date
from ground.recordings_cli import Json

compile_app = typer.Typer()


@compile_app.command("compile")
def compile_command(
    remove: Annotated[
        bool, typer.Option("--remove", help="Remove the machine code instead; the sources run again.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Translate flight and simulation to machine code, once: missions then take less than half the time.

    It needs a C compiler and takes a minute. What flies does the same to the bit. The code is used as long as the
    sources stay as they are, HOPPER_COMPILED=0 leaves it aside.
    """
    with console.clear_errors():
        if remove:
            told, nothing = {str(folder): "removed" for folder in forget()}, "there was no machine code"
        elif up_to_date():
            told, nothing = {}, "there is machine code of these sources"
        else:
            with console.steps() as show:
                show(f"translating {sum(map(len, MODULES.values()))} modules")
                made = compile_modules()
            told, nothing = {str(one.folder): f"{one.modules} modules of {one.package}" for one in made}, ""
    if as_json:
        console.print_json(told)
        return
    for folder, what in told.items():
        console.say(f"{folder}: {what}")
    if nothing and not told:
        console.say(nothing)
