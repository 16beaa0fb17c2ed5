"""One short mission on the simulated robot, flown once for all tests that need a real flight log."""

from __future__ import annotations

from pathlib import Path

from flight.executive import fly
from flight.log import McapLog
from flight.mission import HopPlan, MissionPlan
from flight.settings import load
from flight.surface.known import load_surfaces
from hal.board import open_board
from hal.config import config_path, read_yaml, to_yaml
from hal.tap import tap_board
from sim_hal.board import world_of
from sim_hal.truth import HopTruth

PLAN = MissionPlan("short", (HopPlan(1.0, surface="quartz_sand"),))


def fly_short_mission(path: Path, surfaces: Path | None = None) -> list[HopTruth]:
    """Fly one hop of 1 J on sand with the log at `path`; returns the truth of the hop.

    `surfaces` is a file of known surfaces to fly with in place of the shipped one.
    """
    settings, surfaces = load(), surfaces or config_path("surfaces.yaml")
    board_settings = read_yaml(config_path("boards", "sim.yaml"))
    board_settings |= {"seed": 11, "spots": [{"surface": "quartz_sand", "foot": 1, "tilt_deg": 0.0}]}
    metadata = {
        "board": "sim",
        "seed": "11",
        "settings": to_yaml(settings),
        "surfaces": surfaces.read_text(encoding="utf-8"),
        "mission": to_yaml(PLAN),
    }
    with open_board("sim", board_settings) as board, McapLog(path, metadata) as log:
        fly(tap_board(board, log), settings, PLAN, log, surfaces=load_surfaces(surfaces))
        return world_of(board).hops
