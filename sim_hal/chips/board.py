"""The emulated board: the real drivers of `hal.raspberry_pi` on models of the robot's chips.

Opened by the name `raspberry_pi_emulated`. The drivers get the robot's own settings file; the simulated robot behind
the chips is the one of board `sim`.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

from hal.config import Limits, build_settings, config_path, read_yaml
from hal.errors import ConfigError
from hal.raspberry_pi.board import PiBoard, assemble
from hal.raspberry_pi.settings import PiSettings, check_wiring
from sim_hal.board import world_from
from sim_hal.chips.faults import WireFaults
from sim_hal.chips.ports import PLACES, EmulatedPorts
from sim_hal.chips.rig import ChipRig
from sim_hal.settings import FaultSettings, Mode, SensorSettings, SimSettings, check_contradictions

NAME = "raspberry_pi_emulated"
SOURCE = f"settings of board {NAME!r}"


@dataclass(frozen=True)
class EmulatedSettings:
    """Files of drivers and simulation, below the configuration folder or absolute; and what is changed of them.

    `wiring` changes the drivers' settings, `simulation` those of the simulated robot, mappings key by key.
    """

    drivers_file: str
    simulation_file: str
    supply_v: Annotated[float, Limits(0.1, 100.0)]
    reply_timeout_s: Annotated[float, Limits(0.001, 10.0)]
    wiring: dict[str, Any] = field(default_factory=dict)
    simulation: dict[str, Any] = field(default_factory=dict)
    wire_faults: tuple[FaultSettings, ...] = ()


@dataclass(frozen=True, kw_only=True)
class EmulatedBoard(PiBoard):
    """A board that can be looked behind: the simulated rig, the chips, and the faults of their wires."""

    rig: ChipRig
    chips: EmulatedPorts

    @property
    def wire(self) -> WireFaults:
        """The planted faults of the wires; more may be planted at any time."""
        return self.chips.faults


def open_emulated(settings: Mapping[str, Any]) -> EmulatedBoard:
    """Open the real drivers on emulated chips. Raises `ConfigError` naming key, value and limit.

    `seed`, `spots` and the other keys of the simulated robot may stand beside those of `EmulatedSettings`, as for
    the board `sim`.
    """
    own, of_simulation = _split(settings)
    checked = build_settings(own, EmulatedSettings, SOURCE)
    simulated = _merged(read_yaml(_path(checked.simulation_file)), {**checked.simulation, **of_simulation})
    simulation = build_settings(simulated, SimSettings, SOURCE)
    check_contradictions(simulation, SOURCE)
    wired = _merged(read_yaml(_path(checked.drivers_file)), checked.wiring)
    wiring = build_settings(wired, PiSettings, f"{SOURCE}, wiring")
    check_wiring(wiring, f"{SOURCE}, wiring")
    if wiring.watchdog.timeout_s != simulation.watchdog.timeout_s:
        raise ConfigError(
            f"{SOURCE}: watchdog.timeout_s = {wiring.watchdog.timeout_s:g} of the drivers is not "
            f"{simulation.watchdog.timeout_s:g}, that of the simulation"
        )
    wiring = _patient(wiring, checked.reply_timeout_s)
    analogue = _analogue(simulation)
    rig = ChipRig(analogue, world_from(analogue, SOURCE))
    faults = WireFaults(PLACES)
    for fault in checked.wire_faults:
        faults.plant(fault.device, fault.kind, fault.from_s, fault.until_s)
    folder = Path(tempfile.mkdtemp(prefix="hopper-sysfs-"))
    try:
        ports = EmulatedPorts(rig, wiring, faults, folder, checked.supply_v)
        board = assemble(NAME, wiring, ports)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    return EmulatedBoard(**{**vars(board), "simulated_time": True}, rig=rig, chips=ports)


def _split(settings: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    known = EmulatedSettings.__dataclass_fields__
    of_simulation = SimSettings.__dataclass_fields__
    return (
        {key: value for key, value in settings.items() if key in known or key not in of_simulation},
        {key: value for key, value in settings.items() if key in of_simulation},
    )


def _merged(base: Any, changes: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for key, value in changes.items():
        both = isinstance(value, Mapping) and isinstance(merged.get(key), Mapping)
        merged[key] = _merged(merged[key], value) if both else value
    return merged


def _path(name: str) -> Path:
    return Path(name) if Path(name).is_absolute() else config_path(name)


def _patient(wiring: PiSettings, reply_timeout_s: float) -> PiSettings:
    """An emulated line has no speed: what is not answered at once never is, but this computer may be busy."""
    motor = wiring.motor
    if motor.roboclaw is None:
        return wiring
    return replace(
        wiring, motor=replace(motor, roboclaw=replace(motor.roboclaw, reply_timeout_s=reply_timeout_s))
    )


def _analogue(settings: SimSettings) -> SimSettings:
    """Sensors before their converters: no digital step, and noise of one density at all rates of the part."""
    rates = {"accelerometer": (52.0, 104.0, 416.0, 833.0, 100.0, 200.0, 400.0, 800.0)}
    sensors = {
        name: _without_step(sensor, rates.get(name, ())) for name, sensor in vars(settings.sensors).items()
    }
    return replace(settings, sensors=replace(settings.sensors, **sensors))


def _without_step(sensor: SensorSettings, rates_hz: tuple[float, ...]) -> SensorSettings:
    first = sensor.modes[0]
    known = {mode.rate_hz for mode in sensor.modes}
    more = tuple(
        Mode(rate, first.noise_std * (rate / first.rate_hz) ** 0.5, first.low, first.high)
        for rate in rates_hz
        if rate not in known
    )
    return replace(sensor, step=0.0, depth=4096, modes=sensor.modes + more)
