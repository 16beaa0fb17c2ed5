"""`hopper console`: the robot's state in the browser or the terminal, live or from a log."""

from __future__ import annotations

import threading
import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from flight import settings as flight_settings
from flight.mission import MissionPlan, load_mission
from ground import console
from ground.files import configured
from ground.live.playback import read_recorded
from ground.live.server import ConsoleServer
from ground.live.shows import LiveShow, RecordedShow
from ground.live.sources import LinkSource, Simulation, SimulationPlan, Source
from ground.mission_run import plan_mission
from hal.config import config_path, load_settings
from hal.errors import ConfigError
from hal.link.keys import load_key
from hal.link.robot import LinkSettings
from hal.link.streams import SerialLine

console_app = typer.Typer()


@console_app.command("console")
def console_command(
    log: Annotated[Path | None, typer.Argument(help="Flight log (MCAP) to play back.")] = None,
    sim: Annotated[bool, typer.Option("--sim", help="Fly a simulated robot, and show it.")] = False,
    port: Annotated[str | None, typer.Option(help="Serial port of a robot's link.")] = None,
    key: Annotated[Path, typer.Option(help="Key file of the robot's link.")] = Path("link.key"),
    terminal: Annotated[
        bool, typer.Option("--terminal", help="In this terminal, not in the browser.")
    ] = False,
    mission: Annotated[
        str | None, typer.Option(help="Simulated mission: file, or its name in config/missions.")
    ] = None,
    surface: Annotated[str, typer.Option(help="Surface of the simulated hops.")] = "quartz_sand",
    hops: Annotated[int, typer.Option(help="Simulated hops on it, after one off steel.")] = 3,
    energy_j: Annotated[float, typer.Option("--energy-j", help="E_used of each simulated hop.")] = 18.0,
    seed: Annotated[int, typer.Option(help="Seed of the simulation.")] = 1,
    speed: Annotated[float, typer.Option(min=0.1, max=1000, help="Simulated seconds in a second.")] = 1.0,
    stay_s: Annotated[
        float, typer.Option(help="How long the simulated robot waits in SAFE for a reset.")
    ] = 60.0,
    out: Annotated[Path, typer.Option("--out", help="Folder for the simulated mission's results.")] = Path(
        "out/console"
    ),
    serve_port: Annotated[int, typer.Option(help="Port of the page on this computer; 0: any free one.")] = 0,
    browser: Annotated[bool, typer.Option(help="Open the page in the browser.")] = True,
    recover: Annotated[bool, typer.Option(help="Take the whole part of a log that was cut.")] = False,
) -> None:
    """Show a robot, a simulation or a log: state, spring, signals, belief, decisions, events, commands.

    The page is served on this computer only, at an address that carries a token; Ctrl-C ends it.
    """
    with console.clear_errors():
        if sum((sim, port is not None, log is not None)) != 1:
            raise ConfigError("name one thing to show: a log, --sim, or --port PORT with --key FILE")
        if log is not None:
            with console.steps(total=1.0) as progress:
                recorded = read_recorded(log, recover, progress)
            show_recorded(RecordedShow(recorded), terminal, serve_port, browser)
            return
        if port is not None:
            bounds = load_settings(config_path("link.yaml"), LinkSettings)
            line = SerialLine(port, bounds.baud)
            source: Source = LinkSource(line, load_key(key), bounds, f"robot at {port}")
        else:
            plan = _plan(mission, surface, hops, energy_j)
            source = Simulation(SimulationPlan(plan, out, seed, speed, stay_s))
        show_live(source, terminal, serve_port, browser)


def _plan(mission: str | None, surface: str, hops: int, energy_j: float) -> MissionPlan:
    settings = flight_settings.load()
    if mission is not None:
        return load_mission(configured("missions", mission), settings)
    return plan_mission(surface, hops, energy_j, settings)


def show_live(source: Source, terminal: bool, port: int, browser: bool) -> None:
    """Show a source until the person ends it; then say what was kept."""
    show = LiveShow(source, flight_settings.load())
    try:
        if terminal:
            from ground.live.terminal import run_terminal  # only here is its library needed

            run_terminal(show)
        else:
            serve(ConsoleServer(show, port), browser)
    finally:
        kept = show.close()
        if kept:
            console.say(kept)


def show_recorded(show: RecordedShow, terminal: bool, port: int, browser: bool) -> None:
    """Show a recording until the person ends it."""
    if terminal:
        from ground.live.terminal import run_terminal  # only here is its library needed

        run_terminal(show)
    else:
        serve(ConsoleServer(show, port), browser)


def serve(server: ConsoleServer, browser: bool) -> None:
    """Serve until Ctrl-C, whenever it comes."""
    try:
        with server:
            console.say(
                f"console: {server.address}\nWhoever has this address can command the robot. Ctrl-C ends it."
            )
            if browser:
                webbrowser.open(server.address)
            threading.Event().wait()
    except KeyboardInterrupt:
        console.say("closing")
