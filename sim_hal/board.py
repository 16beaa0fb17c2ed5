"""The simulated board: the devices of one simulated robot, opened by the name `sim`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hal.board import Board
from hal.config import build_settings, config_path
from hal.errors import BoardUnavailable, ConfigError
from sim_hal.clock import SimClock
from sim_hal.devices import (
    LoopbackLink,
    SimAccelerometer,
    SimMagnet,
    SimMagnetCurrentSensor,
    SimMotor,
    SimMotorCurrentSensor,
    SimNutEncoder,
    SimSpringSensor,
    SimSwitches,
    SimWatchdog,
)
from sim_hal.faults import Faults
from sim_hal.plant.simulate import Plant, PlantError, load_plant
from sim_hal.rig import Rig
from sim_hal.settings import SimSettings, check_contradictions
from sim_hal.truth import REFERENCE
from sim_hal.world import World, plant_at

SOURCE = "settings of board 'sim'"
SIMULATED_BOARDS = ("sim", "raspberry_pi_emulated")
"""Boards with a simulated world behind them, whose settings say what ground that has."""


@dataclass(frozen=True)
class SimBoard(Board):
    """A board that can be looked behind: the world and its truth, faults, the ground's side of the link."""

    rig: Rig
    link: LoopbackLink

    @property
    def world(self) -> World:
        """The physical robot."""
        return self.rig.world

    @property
    def faults(self) -> Faults:
        """The planted faults; more may be planted at any time."""
        return self.rig.faults


def open_sim(settings: Mapping[str, Any]) -> SimBoard:
    """Open the simulated robot. Raises `ConfigError` naming key, value and limit."""
    checked = build_settings(settings, SimSettings, SOURCE)
    check_contradictions(checked, SOURCE)
    rig = Rig(checked, world_from(checked, SOURCE))
    link = LoopbackLink("ground_link", rig, checked.ground_link.depth)
    return SimBoard(
        name="sim",
        clock=SimClock(rig),
        motor=SimMotor("motor", rig, checked.motor.max_voltage_v),
        magnet=SimMagnet("magnet", rig),
        nut_encoder=SimNutEncoder("nut_encoder", rig),
        motor_current=SimMotorCurrentSensor("motor_current", rig),
        magnet_current=SimMagnetCurrentSensor("magnet_current", rig),
        spring=SimSpringSensor("spring", rig),
        accelerometer=SimAccelerometer("accelerometer", rig),
        switches=SimSwitches("switches", rig),
        watchdog=SimWatchdog("watchdog", rig),
        ground_link=link,
        simulated_time=True,
        rig=rig,
        link=link,
    )


def world_from(settings: SimSettings, source: str) -> World:
    """The physical robot that checked settings describe. Raises `ConfigError` for its plant files."""
    drive, hop = (_load(getattr(settings.plants, kind), kind, source) for kind in ("drive", "hop"))
    _check_surfaces(settings, hop, source)
    return World(settings, drive, hop)


def world_of(board: Board) -> World:
    """The world behind a simulated board. Raises `BoardUnavailable` for a board that is none."""
    rig = getattr(board, "rig", None)
    if not isinstance(rig, Rig):
        raise BoardUnavailable(f"board {board.name!r} is not simulated: nobody knows the truth behind it")
    return rig.world


def _check_surfaces(settings: SimSettings, hop: Plant, source: str) -> None:
    """Every spot, and the reference that C3 is measured against, must be a surface of the plant."""
    known = ", ".join(hop.surfaces)
    for index, spot in enumerate(settings.spots):
        if spot.surface not in hop.surfaces:
            raise ConfigError(
                f"{source}: spots[{index}].surface = {spot.surface!r} is not in plants.hop = "
                f"{settings.plants.hop!r}; known there: {known}"
            )
        try:
            plant_at(hop, spot)
        except PlantError as error:
            raise ConfigError(f"{SOURCE}: spots[{index}].values: {error}") from error
    if REFERENCE not in hop.surfaces:
        raise ConfigError(
            f"{source}: plants.hop = {settings.plants.hop!r} lacks the reference surface {REFERENCE!r}"
        )


def _load(name: str, kind: str, source: str) -> Plant:
    path = Path(name) if Path(name).is_absolute() else config_path(name)
    plant = load_plant(path)
    if plant.kind != kind:
        raise ConfigError(f"{source}: plants.{kind} = {name!r} is a plant of kind {plant.kind!r}")
    return plant
