"""`hopper command` and `hopper key`: the ground's end of the link."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from ground import console
from ground.station import GroundStation, acknowledgements
from hal.config import config_path, load_settings
from hal.dictionary import dictionary
from hal.errors import ConfigError
from hal.link.keys import load_key, make_key
from hal.link.robot import LinkSettings
from hal.link.streams import SerialLine

link_app = typer.Typer()
POLL_S = 0.02


@link_app.command("key")
def key_command(file: Annotated[Path, typer.Argument(help="New key file, for robot and ground.")]) -> None:
    """Make a key that signs commands; only its owner can read it."""
    with console.clear_errors():
        make_key(file)
    console.say(f"{file}: written; copy it to the robot by hand, with permissions 0600")


@link_app.command("command")
def send_command(
    name: Annotated[str, typer.Argument(help="A command of the dictionary.")],
    arguments: Annotated[list[str] | None, typer.Argument(help="Its arguments, as name=value.")] = None,
    port: Annotated[str, typer.Option(help="Serial port of the link.")] = "/dev/ttyUSB0",
    key: Annotated[Path, typer.Option(help="Key file.")] = Path("link.key"),
    wait_s: Annotated[float, typer.Option(help="How long to wait for each answer.")] = 10.0,
) -> None:
    """Send one signed command and show what the robot answers."""
    with console.clear_errors():
        pairs = tuple(_pair(text) for text in arguments or ())
        if name not in dictionary().commands:
            raise ConfigError(f"{name!r} is no command; known: {', '.join(dictionary().commands)}")
        bounds = load_settings(config_path("link.yaml"), LinkSettings)
        station = GroundStation(SerialLine(port, bounds.baud), load_key(key), bounds.longest_packet_bytes)
        _wait_for_session(station, wait_s)
        station.command(name, pairs)
        refused = _show_answers(station, wait_s)
    if refused:
        raise typer.Exit(1)


def _pair(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        return name, float(value)
    except ValueError:
        raise ConfigError(f"{text!r} is no argument; write it as name=number") from None


def _wait_for_session(station: GroundStation, wait_s: float) -> None:
    until_s = time.monotonic() + wait_s
    while station.session is None:
        station.poll()
        if time.monotonic() > until_s:
            raise ConfigError(f"no robot with this key was heard within {wait_s:g} s")
        time.sleep(POLL_S)


def _show_answers(station: GroundStation, wait_s: float) -> bool:
    """Show the link's answer and the robot's; returns whether either refused. Raises when there is none."""
    until_s = time.monotonic() + wait_s
    while time.monotonic() < until_s:
        for answer in acknowledgements(station.poll()):
            why = answer.get("why")
            console.say(f"{answer['name']}: {answer.get('command', '')} {why or ''}".rstrip())
            if why or answer["name"] != "link":
                return bool(why)
        time.sleep(POLL_S)
    raise ConfigError(f"the robot gave no answer within {wait_s:g} s")
