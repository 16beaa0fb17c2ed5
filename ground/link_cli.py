"""`hopper command` and `hopper key`: the ground's end of the link."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer

from ground import console
from ground.live.view import answer_text
from ground.progress import Show
from ground.recordings_cli import Json
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
def key_command(
    file: Annotated[Path, typer.Argument(help="New key file, for robot and ground.")], as_json: Json = False
) -> None:
    """Make a key that signs commands; only its owner can read it."""
    with console.clear_errors():
        make_key(file)
    if as_json:
        console.print_json({"file": str(file)})
        return
    console.say(f"{file}: written; copy it to the robot by hand, with permissions 0600")


@link_app.command("command")
def send_command(
    name: Annotated[str, typer.Argument(help="A command of the dictionary.")],
    arguments: Annotated[list[str] | None, typer.Argument(help="Its arguments, as name=value.")] = None,
    port: Annotated[str, typer.Option(help="Serial port of the link.")] = "/dev/ttyUSB0",
    key: Annotated[Path, typer.Option(help="Key file.")] = Path("link.key"),
    wait_s: Annotated[float, typer.Option(help="How long to wait for each answer.")] = 10.0,
    as_json: Json = False,
) -> None:
    """Send one signed command and show what the robot answers."""
    with console.clear_errors():
        pairs = tuple(_pair(text) for text in arguments or ())
        if name not in dictionary().commands:
            raise ConfigError(f"{name!r} is no command; known: {', '.join(dictionary().commands)}")
        bounds = load_settings(config_path("link.yaml"), LinkSettings)
        station = GroundStation(SerialLine(port, bounds.baud), load_key(key), bounds.longest_packet_bytes)
        with console.steps(total=wait_s) as show:
            _wait_for_session(station, wait_s, show)
            station.command(name, pairs)
            answers = _answers(station, wait_s, show)
    if as_json:
        console.print_json({"accepted": not _refused(answers), "answers": answers})
    else:
        for answer in answers:
            console.say(answer_text(answer))
    if _refused(answers):
        raise typer.Exit(1)


def _pair(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        return name, float(value)
    except ValueError:
        raise ConfigError(f"{text!r} is no argument; write it as name=number") from None


def _wait_for_session(station: GroundStation, wait_s: float, show: Show) -> None:
    for waited_s in _waiting(wait_s):
        station.poll()
        if station.session is not None:
            return
        show("waiting for the robot", waited_s)
    raise ConfigError(f"no robot with this key was heard within {wait_s:g} s")


def _answers(station: GroundStation, wait_s: float, show: Show) -> list[dict[str, Any]]:
    """The link's answer, and where it took the command the robot's. Raises when one of them does not come."""
    answers: list[dict[str, Any]] = []
    for waited_s in _waiting(wait_s):
        for answer in acknowledgements(station.poll()):
            answers.append(answer)
            if answer.get("why") or answer["name"] != "link":
                return answers
        show("waiting for the answer", waited_s)
    taken = "the link took the command, but " if answers else ""
    raise ConfigError(f"{taken}the robot gave no answer within {wait_s:g} s")


def _refused(answers: list[dict[str, Any]]) -> bool:
    return any(answer.get("why") for answer in answers)


def _waiting(wait_s: float) -> Iterator[float]:
    """How long it was waited so far [s], until the time is over."""
    start_s = time.monotonic()
    while (waited_s := time.monotonic() - start_s) < wait_s:
        yield waited_s
        time.sleep(POLL_S)
