"""Flying a mission from the ground's side: open the board, fly, and put all that came of it on file.

The folder of a mission holds `flight.mcap` (all readings, commands and decisions), a recording of the drive and
one of the hop for each hop, `mission.json` and `report.html`. It appears whole or not at all; of a flight that was
stopped the log alone is kept, beside it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import yaml

from flight import settings as flight_settings
from flight.executive import Watcher, fly
from flight.log import McapLog
from flight.mission import HopPlan, MissionPlan, MissionResult
from flight.settings import FlightSettings
from flight.surface.known import load_surfaces
from ground.files import whole_folder, write_atomic
from ground.mission_places import Terrain, first_spot, place_of
from ground.mission_summary import HopOutcome, MissionRun, hop_rows, mission_content
from ground.recordings import RecordingError
from ground.recordings.from_log import HopRecordings, write_hop_recordings
from ground.report.mission_page import write_mission_page
from ground.stopping import StoppableClock, log_kept
from hal.board import Board, open_board
from hal.config import config_path, config_root, read_yaml
from hal.errors import ConfigError
from hal.log import LogSink
from hal.memory import FileMemory
from hal.tap import tap_board
from sim_hal.board import SIMULATED_BOARDS, world_of
from sim_hal.truth import REFERENCE, HopTruth

__all__ = ["hop_rows", "plan_mission", "run_mission"]

LOG_NAME, SUMMARY_NAME, REPORT_NAME = "flight.mcap", "mission.json", "report.html"
SAME_HOP_S = 1e-6


def plan_mission(
    surface: str,
    hops: int,
    energy_j: float,
    settings: FlightSettings,
    *,
    references: int = 1,
    tilt_deg: float = 0.0,
    name: str = "",
) -> MissionPlan:
    """Hops of one energy on one place of a surface, after `references` hops off steel.

    Raises `ConfigError` for a number of hops or an energy that cannot be flown.
    """
    limits = settings.tension
    if hops < 1 or references < 0:
        raise ConfigError(
            f"hops = {hops}, references = {references}: at least one hop is needed, none negative"
        )
    if not limits.min_energy_j <= energy_j <= limits.max_energy_j:
        raise ConfigError(
            f"energy_j = {energy_j:g} is outside the rig's limits [{limits.min_energy_j:g}, {limits.max_energy_j:g}]"
        )
    reference = HopPlan(energy_j, surface=REFERENCE, place="reference", reference=True)
    leap = HopPlan(energy_j, surface=surface, place="A", tilt_deg=tilt_deg)
    return MissionPlan(name or f"{surface}-{hops}-hops", (reference,) * references + (leap,) * hops)


def run_mission(
    plan: MissionPlan,
    folder: Path,
    *,
    board: str = "sim",
    seed: int | None = None,
    changes: Mapping[str, Any] | None = None,
    settings_path: Path | None = None,
    watch: Watcher | None = None,
    ground_memory: Path | None = None,
    fitted: Callable[[Board], Board] = lambda board: board,
    stay_s: float = 0.0,
) -> MissionRun:
    """Fly `plan` on the board of that name and write everything to `folder`.

    `changes` replace keys of the board's settings (`plants`, `faults`, `initial` ... of
    `config/boards/sim.yaml`), mappings key by key; `seed` is short for the seed there. `watch` is called once
    a tick. `ground_memory` is a file that keeps what is learned of the ground from mission to mission. `fitted`
    may put other devices on the opened board (a ground link); `stay_s` is how long the flight waits in SAFE for
    the ground's reset.

    Raises `ConfigError` or `BoardUnavailable` before anything moves. When it is stopped (Ctrl-C) or fails
    later, nothing is left in `folder`, and the log is kept in `FOLDER.stopped`, as the error's notes say.
    """
    settings_path = settings_path or config_path("flight.yaml")
    settings, surfaces = flight_settings.load(settings_path), load_surfaces()
    board_settings = _board_settings(board, plan, settings, changes or {})
    if seed is not None:
        board_settings["seed"] = seed
    metadata = {
        "board": board,
        "seed": str(board_settings.get("seed", "")),
        "settings": settings_path.read_text(encoding="utf-8"),
        "surfaces": config_path("surfaces.yaml").read_text(encoding="utf-8"),
        "mission": yaml.safe_dump(asdict(plan), sort_keys=False),
        "board_settings": yaml.safe_dump(board_settings, sort_keys=False),
        "stay_s": repr(stay_s),
    }
    limits = None if board in SIMULATED_BOARDS else settings.log  # only on board is memory short
    with whole_folder(folder, SUMMARY_NAME) as work, log_kept(work / LOG_NAME, folder):
        with (
            open_board(board, board_settings) as opened,
            McapLog(work / LOG_NAME, metadata, limits) as log,
        ):
            sink: LogSink = log
            if plan.goals and board in SIMULATED_BOARDS:
                sink = Terrain(log, world_of(opened), plan, settings.rig.foot, board_settings.get("seed", 0))
            clock = StoppableClock(opened.clock)
            whole = fitted(replace(_remembering(opened, ground_memory), clock=clock))
            with clock.listening():
                result = fly(
                    tap_board(whole, sink), settings, plan, sink, watch, surfaces=surfaces, stay_s=stay_s
                )
        found, notes = _recordings(work, folder)
        hops = _outcomes(result, _truths(opened), found)
        run = MissionRun(folder, board, board_settings.get("seed"), settings, result, hops, notes)
        content = json.dumps(mission_content(run), indent=1, ensure_ascii=False, allow_nan=False)
        write_atomic(work / SUMMARY_NAME, content + "\n")
        write_mission_page(run, work / REPORT_NAME)
    return run


def _remembering(board: Board, path: Path | None) -> Board:
    return board if path is None else replace(board, ground_memory=FileMemory(path))


def _board_settings(
    board: str, plan: MissionPlan, settings: FlightSettings, changes: Mapping[str, Any]
) -> dict[str, Any]:
    """Settings of the board's file with changes; for a simulated one with the mission's ground under each hop."""
    path = config_root() / "boards" / f"{board}.yaml"
    found: dict[str, Any] = read_yaml(path) if path.is_file() else {}
    if board in SIMULATED_BOARDS:
        found["spots"] = [_spot(index, hop, settings) for index, hop in enumerate(plan.hops)]
        for goal in plan.goals:
            place_of(goal)  # refused before anything moves
        if not plan.hops:
            found["spots"] = [first_spot(plan, settings.rig.foot)]
        changes = {**(plan.simulated or {}), **changes}
    for key, value in changes.items():
        merged = isinstance(value, Mapping) and isinstance(found.get(key), Mapping)
        found[key] = {**found[key], **value} if merged else value
    return found


def _spot(index: int, hop: HopPlan, settings: FlightSettings) -> dict[str, Any]:
    surface = hop.surface or (REFERENCE if hop.reference else None)
    if surface is None:
        raise ConfigError(f"hops[{index}].surface is missing: a simulation must know the ground")
    return {"surface": surface, "foot": int(settings.rig.foot), "tilt_deg": hop.tilt_deg}


def _truths(board: Board) -> list[HopTruth]:
    return world_of(board).hops if board.name in SIMULATED_BOARDS else []


def _outcomes(
    result: MissionResult, truths: list[HopTruth], found: Mapping[int, HopRecordings]
) -> tuple[HopOutcome, ...]:
    """Each hop's report with its truth (the one of the same fire command) and its recordings."""
    outcomes = []
    for report in result.hops:
        truth = next((truth for truth in truths if abs(truth.fire_s - report.fire_s) < SAME_HOP_S), None)
        recordings = found.get(report.hop_index)
        outcomes.append(
            HopOutcome(report, truth, recordings.drive, recordings.hop)
            if recordings
            else HopOutcome(report, truth)
        )
    return tuple(outcomes)


def _recordings(work: Path, folder: Path) -> tuple[dict[int, HopRecordings], tuple[str, ...]]:
    """Recordings by hop, their files named as they will be in `folder`; and what could not be recorded, in words.

    A log that makes no recordings is worth keeping all the same.
    """
    try:
        written = write_hop_recordings(work / LOG_NAME, work)
    except RecordingError as error:
        return {}, (f"No recordings could be made of the log: {error}",)
    return {each.hop_index: _moved(each, folder) for each in written}, ()


def _moved(recordings: HopRecordings, folder: Path) -> HopRecordings:
    drive, hop = (
        replace(part, source=folder / part.source.name if part.source else None)
        for part in (recordings.drive, recordings.hop)
    )
    return HopRecordings(recordings.hop_index, drive, hop)
