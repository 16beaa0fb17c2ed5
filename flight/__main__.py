"""The entry on the robot: `python -m flight --board NAME --mission FILE`."""

from __future__ import annotations

import argparse
import gc
import secrets
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path

import yaml

from flight import settings as flight_settings
from flight.background_log import BackgroundLog
from flight.executive import fly
from flight.log import McapLog
from flight.mission import MissionResult, load_mission
from hal.board import Board, board_names, open_board
from hal.config import config_path, load_settings, read_yaml
from hal.errors import BoardUnavailable, ConfigError, HalError
from hal.link.keys import Key, load_key
from hal.link.messages import SESSION_BYTES
from hal.link.robot import LinkSettings, RobotLink
from hal.link.streams import SerialLine
from hal.memory import FileMemory
from hal.tap import tap_board

KEPT_REPORTS = 32
"""Hops whose reports are held in memory, to be printed at the end: some ten minutes' worth."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly one mission. Exit code 0: completed; 1: ended otherwise; 2: refused before anything moved."""
    options = _parser().parse_args(arguments)
    try:
        result = _fly(options)
    except (HalError, OSError) as error:
        print(f"flight: {error}", file=sys.stderr)
        return 2
    if result.made > len(result.hops):
        print(f"the newest {len(result.hops)} of {result.made} hops (the log has them all):")
    for report in result.hops:
        print(_line(report.as_payload()))
    print(f"mission {result.plan.name!r}: ended in {result.end_reason!r}")
    return 0 if result.completed else 1


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m flight", description="Fly a mission on a board.")
    # No default: nobody shall fly a board that was not asked for by name.
    parser.add_argument("--board", required=True, help=f"one of: {', '.join(board_names())}")
    parser.add_argument("--mission", required=True, type=Path, help="mission file (YAML)")
    parser.add_argument("--settings", type=Path, help="flight settings instead of config/flight.yaml")
    parser.add_argument(
        "--board-settings", type=Path, help="board settings instead of config/boards/NAME.yaml"
    )
    parser.add_argument(
        "--memory", type=Path, help="file that keeps the state of the spring over a power cut"
    )
    parser.add_argument(
        "--ground-memory", type=Path, help="file that keeps what was learned of the ground over a restart"
    )
    parser.add_argument("--link", metavar="PORT", help="serial port of the ground link; needs --link-key")
    parser.add_argument("--link-key", type=Path, help="file with the key that signs commands")
    parser.add_argument(
        "--stay-s", type=float, default=0.0, help="how long to wait in SAFE for the ground's reset"
    )
    parser.add_argument("--log", required=True, type=Path, help="MCAP file to write; must not exist")
    return parser


def _fly(options: argparse.Namespace) -> MissionResult:
    if bool(options.link) != bool(options.link_key):
        raise ConfigError("--link and --link-key go together: no command is taken without a key")
    if options.board not in board_names():
        raise BoardUnavailable(
            f"no board is called {options.board!r}; known here: {', '.join(board_names())}"
        )
    key = load_key(options.link_key) if options.link_key else None
    settings = flight_settings.load(options.settings)
    mission = load_mission(options.mission, settings)
    where = options.board_settings or config_path("boards", f"{options.board}.yaml")
    metadata = {
        "board": options.board,
        "settings": (options.settings or config_path("flight.yaml")).read_text(encoding="utf-8"),
        "surfaces": config_path("surfaces.yaml").read_text(encoding="utf-8"),
        "mission": yaml.safe_dump(asdict(mission), sort_keys=False),
        "board_settings": where.read_text(encoding="utf-8"),
        "stay_s": repr(options.stay_s),
    }
    with (
        open_board(options.board, read_yaml(where)) as opened,
        BackgroundLog(
            McapLog(options.log, metadata, settings.log),
            settings.log.waiting_messages,
            simulated_time=opened.simulated_time,
        ) as log,
    ):
        flown = tap_board(_fitted(opened, options, key), log)
        with _quiet_collector():
            result = fly(flown, settings, mission, log, stay_s=options.stay_s, kept_reports=KEPT_REPORTS)

    if log.problem:
        print(f"flight: the log is not whole: {log.problem}", file=sys.stderr)
    return result


def _fitted(board: Board, options: argparse.Namespace, key: Key | None) -> Board:
    """The board with the memory and the link that were asked for."""
    if options.memory:
        board = replace(board, memory=FileMemory(options.memory))
    if options.ground_memory:
        board = replace(board, ground_memory=FileMemory(options.ground_memory))
    if key is not None:
        bounds = load_settings(config_path("link.yaml"), LinkSettings)
        line, session = SerialLine(options.link, bounds.baud), secrets.token_bytes(SESSION_BYTES)
        board = replace(board, ground_link=RobotLink(line, key, session, board.clock, bounds))
    return board


@contextmanager
def _quiet_collector() -> Iterator[None]:
    """No pause for garbage collection in flight; a tick leaves no cycles behind (benchmarks/onboard.py)."""
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        gc.unfreeze()


def _line(report: dict[str, object]) -> str:
    def said(key: str, unit: str) -> str:
        quantity = report[key]
        if not isinstance(quantity, dict):
            return f"{key} unknown"
        return f"{key} {quantity['value']:.4g} +- {quantity['sigma']:.2g}{unit}"

    seen = ", ".join((said("energy_used_j", " J"), said("height_m", " m"), said("c3", "")))
    return f"hop {report['hop_index']}: {report['verdict']}, {seen}"


if __name__ == "__main__":
    raise SystemExit(main())
