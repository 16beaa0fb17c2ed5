"""Flies one case with the real flight software on the simulated robot, and has it judged."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from flight import settings as flight_settings
from flight.executive import fly
from flight.log import McapLog, parts_of
from flight.mcap_stream import read_mcap
from flight.mission import HopPlan, MissionPlan
from flight.settings import FlightSettings
from flight.surface.known import SurfaceSettings, load_surfaces
from ground.fault_campaign.drawing import CampaignSettings, FaultCase, PlantedFault
from ground.fault_campaign.hazards import Witness, judge_releases, judge_reports
from hal.board import open_board
from hal.config import config_path, read_yaml
from hal.log import LogError
from hal.tap import tap_board
from sim_hal.board import SimBoard
from sim_hal.faults import Faults

OUTSIDE = ("log", "ground_link")  # devices whose faults are not the simulated board's


@dataclass(frozen=True)
class CaseResult:
    """What became of one case.

    `case.faults` are those that have made a difference; one that came to nothing leaves the mission to the bit as it
    would have been without it, so it is taken out and only counted in `came_to_nothing`.
    """

    case: FaultCase
    effects_s: tuple[float, ...]  # when each fault first made a difference
    came_to_nothing: int
    end_reason: str
    releases: int
    hazards: tuple[str, ...]
    simulated_s: float

    def as_row(self) -> dict[str, Any]:
        """As JSON-able data."""
        return asdict(self)


class CampaignLog:
    """Writes to a real log, keeps what the judge needs, and runs out of disc when that is planted."""

    def __init__(self, log: McapLog, full: PlantedFault | None) -> None:
        self._log, self._full = log, full
        self.problem, self.problem_s = "", float("inf")
        self.written = 0
        self.accepted: list[tuple[float, str]] = []
        self.reports: list[Mapping[str, Any]] = []

    def write(self, topic: str, time_s: float, payload: Mapping[str, Any]) -> None:
        """Record one message, unless the disc is full by now (for good)."""
        if topic == "event" and payload["name"] == "command_accepted":
            self.accepted.append((time_s, payload["command"]))
        elif topic == "hop":
            self.reports.append(payload)
        if self._full is not None and time_s >= self._full.from_s:
            self.problem = self.problem or "no space left on the disc"
            self.problem_s = min(self.problem_s, time_s)
        if not self.problem:
            self._log.write(topic, time_s, payload)
            self.written += 1


@cache
def _given() -> tuple[FlightSettings, SurfaceSettings, dict[str, Any]]:
    return flight_settings.load(), load_surfaces(), read_yaml(config_path("boards", "sim.yaml"))


def fly_case(settings: CampaignSettings, case: FaultCase) -> CaseResult:
    """Fly a case and have it judged."""
    flight, surfaces, found = _given()
    flight = _impatient(flight, settings.patience_s)
    plan = MissionPlan("faults", (HopPlan(case.energy_j, case.surface),))
    by_device = {fault.device: fault for fault in case.faults}
    with (
        tempfile.TemporaryDirectory(dir=_memory_folder()) as folder,
        open_board("sim", _board_settings(found, case)) as board,
    ):
        assert isinstance(board, SimBoard)
        witness = _witness(board, settings)
        board.rig.witnesses.append(witness)
        forged: list[float] = []
        if "ground_link" in by_device:
            board.rig.witnesses.append(lambda now_s: _forge(board, by_device["ground_link"], now_s, forged))
        path = Path(folder) / "flight.mcap"
        mcap = McapLog(path, {"board": "sim"}, flight.log)
        log = CampaignLog(mcap, by_device.get("log"))
        result = fly(tap_board(board, log), flight, plan, log, surfaces=surfaces)
        ended_s = board.world.now_s
        effects_s = _effects_s(board.faults, log, forged)
        _rest(board, settings.limits.after_s)
        witness.after_the_end()
        mcap.close()
        _judge_log(witness, path, log)
        judge_releases(witness, log.accepted, [case.energy_j])
        judge_reports(witness, log.reports)
    hazards = tuple(sorted(witness.hazards))
    felt = tuple(fault for fault in case.faults if (fault.device, fault.kind) in effects_s)
    return CaseResult(
        case=replace(case, faults=felt),
        effects_s=tuple(effects_s[fault.device, fault.kind] for fault in felt),
        came_to_nothing=len(case.faults) - len(felt),
        end_reason=result.end_reason,
        releases=len(witness.releases),
        hazards=hazards,
        simulated_s=ended_s,
    )


def _memory_folder() -> str | None:
    """A file system in memory where there is one: thousands of logs would wear a disc."""
    return "/dev/shm" if Path("/dev/shm").is_dir() else None


def _impatient(flight: FlightSettings, patience_s: float) -> FlightSettings:
    """The settings with shorter limits for phases in which nothing happens but waiting."""
    waiting = ("ready_timeout", "hold_timeout", "safe_hold_timeout")
    rules = {
        name: replace(rule, above=patience_s) for name, rule in flight.monitors.items() if name in waiting
    }
    return replace(flight, monitors=flight.monitors | rules)


def _board_settings(found: dict[str, Any], case: FaultCase) -> dict[str, Any]:
    planted = [asdict(fault) for fault in case.faults if fault.device not in OUTSIDE]
    return {
        **found,
        "seed": case.seed,
        "spots": [{"surface": case.surface, "foot": 1, "tilt_deg": 0.0}],
        "initial": {"nut_position_m": case.nut_m, "latch_closed": case.loaded},
        "faults": planted,
    }


def _witness(board: SimBoard, settings: CampaignSettings) -> Witness:
    plant = board.world.hop_plant.parameters
    return Witness(
        board,
        settings.limits,
        stiffness_n_m=plant["k"].value,
        body_weight_n=plant["m_b"].value * plant["g"].value,
        stop_m=board.rig.stop_high_m,
    )


def _forge(board: SimBoard, fault: PlantedFault, now_s: float, sent: list[float]) -> None:
    """Somebody without the key commands everything that is dangerous."""
    if fault.from_s <= now_s < (fault.until_s or float("inf")):
        for name in ("arm", "fire", "reset"):
            board.link.command(name, authenticated=False)
        sent.append(now_s)


def _rest(board: SimBoard, for_s: float) -> None:
    """Let time pass after the software has ended, as it would, and at least until the robot stands still."""
    end_s = board.world.now_s + for_s
    while board.world.now_s < end_s or board.world.hopping:
        board.rig.advance(board.world.now_s + 0.005)


def _judge_log(witness: Witness, path: Path, log: CampaignLog) -> None:
    """The log must be whole, with every message that was handed to it before its disc was full."""
    try:
        if sum(len(read_mcap(part).messages) for part in parts_of(path)) == log.written:
            return
    except LogError:
        pass
    witness.hazards.add("log_lost")


def _effects_s(faults: Faults, log: CampaignLog, forged: list[float]) -> dict[tuple[str, str], float]:
    """When each fault first made a difference to the flight, by device and kind; one that made none is not there."""
    found = {(fault.device, fault.kind): time_s for fault, time_s in faults.effects_s.items()}
    if log.problem:
        found["log", "full"] = log.problem_s
    if forged:
        found["ground_link", "forge"] = forged[0]
    return found
