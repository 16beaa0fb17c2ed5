"""Recordings of each hop from a flight log: the tensioning drive, and the hop itself.

Conventions of the built-in plants. The drive's recording starts at the instant at which the nut stood still,
or turned, at its lowest before tensioning (string slack) and ends when the hop is armed; positions count from
string-taut, which a line through spring compression over nut position finds. The hop's recording starts
shortly before the fire command and ends a while after the touchdown; the magnet's current is kept while the
magnet is on. Times count from the recording's start. Readings are kept as they were sampled: sensors that
sample at different instants leave each other's cells empty.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flight.log import FlightLog, read_log
from flight.mission import HopPlan, MissionPlan
from flight.settings import FlightSettings
from ground.recordings.csv_pair import write_csv_pair
from ground.recordings.log_channels import POLLED, STREAMED, VOLTAGE, Channels, Stretch, gather, table_of
from ground.recordings.model import Event, Floats, Recording, RecordingError, SensorSpec
from hal.config import config_path
from sim_hal.plant.simulate import load_plant

FIRE_COMMAND = "fire_command"
BEFORE_FIRE_S = 0.05
AFTER_TOUCHDOWN_S = 0.5
REFERENCE_SURFACE = "steel"
LEAST_TAUT_M = 0.0003  # spring compression well above the sensor's noise and its end at zero
TAUT_SHARE = 1 / 3  # of the largest compression: the line is fitted below, where springs are straightest
LEAST_TAUT_SAMPLES = 20
RESTING_WITHIN_M = 2e-7  # nut travel that bends the spring by far less than its sensor sees

DRIVE_CHANNELS = (*(name for name, _ in POLLED.values()), "spring_compression_m")
HOP_CHANNELS = tuple(name for name, _ in STREAMED.values())
MAGNET = "magnet_current_a"

Sensors = Mapping[str, Mapping[str, SensorSpec]]


@dataclass(frozen=True)
class HopRecordings:
    """The recordings of one hop: `drive` and `hop`, as the plants of these kinds take them."""

    hop_index: int
    drive: Recording
    hop: Recording


def sensors_of_rig(rig: str) -> Sensors:
    """What the plant files of a rig (`config/plant/RIG_drive.yaml`, `RIG_hop.yaml`) know of its sensors."""
    return {kind: _specs(config_path("plant", f"{rig}_{kind}.yaml")) for kind in ("drive", "hop")}


def _specs(path: Path) -> dict[str, SensorSpec]:
    sensors = load_plant(path).sensors
    return {name: SensorSpec(spec.noise_std, spec.resolution, spec.range) for name, spec in sensors.items()}


def write_hop_recordings(log_path: Path, folder: Path, recover: bool = False) -> tuple[HopRecordings, ...]:
    """Write `hop_NN.drive.csv.gz` and `hop_NN.hop.csv.gz`, each with its sidecar, for each hop of a log.

    Returns the recordings; their `source` is the file written. Errors as `recordings_from_log`.
    """
    written = []
    for each in recordings_from_log(read_log(log_path, recover)):
        stem = folder / f"hop_{each.hop_index:02d}"
        drive, hop = (
            replace(part, source=write_csv_pair(part, stem.with_name(f"{stem.name}.{part.kind}.csv.gz")))
            for part in (each.drive, each.hop)
        )
        written.append(HopRecordings(each.hop_index, drive, hop))
    return tuple(written)


def recordings_from_log(log: FlightLog, sensors: Sensors | None = None) -> tuple[HopRecordings, ...]:
    """The recordings of each hop in which the robot left the ground.

    `sensors` by kind and channel; None takes them from the rig's plant files. Raises `RecordingError` naming
    log and hop when readings are lacking, `LogError` or `ConfigError` when settings or mission are.
    """
    settings, mission = log.part("settings", FlightSettings), log.part("mission", MissionPlan)
    plans = (*mission.hops, *_chosen(log)[len(mission.hops) :])
    specs = sensors_of_rig(settings.rig.name) if sensors is None else sensors
    channels = gather(log.messages)
    seed = log.metadata.get("seed")
    flown = f"{mission.name}-{log.path.stem}" + (f"-seed{seed}" if seed else "")
    found = []
    for index, stretch in enumerate(channels.hops):
        conditions = _conditions(settings, plans, index)
        name = f"{flown}-hop{index:02d}"
        common: dict[str, Any] = {"rig": settings.rig.name, "source": log.path}
        try:
            drive = _drive(channels, stretch, f"{name}-drive", specs["drive"], common)
            hop = _hop(channels, stretch, f"{name}-hop", specs["hop"], common | {"conditions": conditions})
        except RecordingError as error:
            raise RecordingError(f"{log.path}: hop {index}: {error}") from error
        gravity = {"gravity_m_s2": conditions["gravity_m_s2"]}
        found.append(HopRecordings(index, replace(drive, conditions=gravity), hop))
    return tuple(found)


def _chosen(log: FlightLog) -> list[HopPlan]:
    """The hops as they were made, by their reports: also those that the robot chose itself."""
    reports = (message.payload for message in log.messages if message.topic == "hop")
    return [
        HopPlan(
            each["wanted_energy_j"],
            each["surface"],
            each["place"],
            each["reference"],
            each.get("tilt_deg", 0.0),
        )
        for each in reports
    ]


def _conditions(settings: FlightSettings, plans: Sequence[HopPlan], index: int) -> dict[str, float | str]:
    # a hop without a report counts as one like the last
    plan = plans[min(index, len(plans) - 1)] if plans else HopPlan(1.0)
    earlier = [hop for hop in plans[:index] if hop.place == plan.place]
    return {
        "surface": plan.surface or (REFERENCE_SURFACE if plan.reference else "unknown"),
        "foot": int(settings.rig.foot),
        "tilt_deg": plan.tilt_deg,
        "gravity_m_s2": settings.rig.gravity_m_s2,
        "hop_index": len(earlier),
        "place": plan.place,
    }


def _drive(
    channels: Channels, stretch: Stretch, run: str, specs: Mapping[str, SensorSpec], common: Mapping[str, Any]
) -> Recording:
    start_s, start_m = _standstill(channels, stretch)
    samples = {name: channels.between(name, start_s, stretch.armed_s) for name in DRIVE_CHANNELS}
    table = table_of(
        samples | {VOLTAGE: channels.held(VOLTAGE, start_s, stretch.armed_s)}, start_s, held=VOLTAGE
    )
    spring_s, compression_m = samples["spring_compression_m"]
    # on the robot the two are not sampled at the same instants
    taut = string_taut(np.interp(spring_s, *samples["nut_position_m"]), compression_m)
    current_a = table.channels["motor_current_a"].copy()
    # a plant starts without current, the motor turned with one: the winding settles within the first period
    current_a[np.flatnonzero(np.isfinite(current_a))[0]] = np.nan
    position_m = table.channels["nut_position_m"] - taut.position_m
    return Recording(
        table.times_s,
        {**table.channels, "motor_current_a": current_a, "nut_position_m": position_m},
        run=run,
        kind="drive",
        sensors=specs,
        state={
            "spring_compression_m": max(0.0, (start_m - taut.position_m) * taut.slope),
            "nut_position_m": start_m - taut.position_m,
        },
        notes=(
            f"Nut positions count from string-taut, which is at {taut.position_m:.7f} m of the encoder, known "
            f"to {taut.sigma_m * 1e6:.2g} um (1 sigma). The first sample of the current is left out."
        ),
        **common,
    )


def _standstill(channels: Channels, stretch: Stretch) -> tuple[float, float]:
    """Time and position [s, m] at which the nut stood still, or turned, at its lowest before tensioning.

    Between samples the speed is taken to change evenly, so that a recording starts at rest to within it.
    """
    t, x = channels.between("nut_position_m", stretch.latch_check_s, stretch.tensioning_s)
    lowest = x.size - 1 - int(np.argmin(x[::-1]))  # the last of equal ones
    if lowest in (0, x.size - 1):
        raise RecordingError("the nut does not turn or stand still before tensioning")
    before, after = np.diff(x[lowest - 1 : lowest + 2]) / np.diff(t[lowest - 1 : lowest + 2])
    if before == 0.0:
        return float(t[lowest]), float(x[lowest])
    middle_s = 0.5 * (t[lowest - 1] + t[lowest])
    rate = (after - before) / (0.5 * (t[lowest + 1] - t[lowest - 1]))
    turn_s = float(middle_s - before / rate)
    return turn_s, float(x[lowest] - 0.5 * rate * (t[lowest] - turn_s) ** 2)


@dataclass(frozen=True)
class Taut:
    """Encoder position at which the string is just taut, with its standard uncertainty, and ds/dx from there."""

    position_m: float
    sigma_m: float
    slope: float


def string_taut(position_m: Floats, compression_m: Floats) -> Taut:
    """Where the line through (nut position, spring compression) of the taut string meets zero compression.

    Arrays (n,), NaN where missing. Raises `RecordingError` when nut or spring do not move as they must.
    """
    seen = np.isfinite(position_m) & np.isfinite(compression_m)
    x, s = position_m[seen], compression_m[seen]
    low_m, high_m = LEAST_TAUT_M, max(TAUT_SHARE * float(np.max(s, initial=0.0)), 2.0 * LEAST_TAUT_M)
    rough = _line(x, s, (s > low_m) & (s < high_m))
    # chosen again by position: choosing by a noisy reading would bend the line at the ends
    s_line = rough.slope * (x - rough.position_m)
    return _line(x, s, (s_line > low_m) & (s_line < high_m))


def _line(position_m: Floats, compression_m: Floats, keep: NDArray[np.bool_]) -> Taut:
    if keep.sum() < LEAST_TAUT_SAMPLES:
        raise RecordingError(f"only {keep.sum()} samples of the taut string; {LEAST_TAUT_SAMPLES} are needed")
    x, s = position_m[keep], compression_m[keep]
    centre_m, spread_m2 = float(x.mean()), float(((x - x.mean()) ** 2).sum())
    if spread_m2 == 0.0:
        raise RecordingError("the nut does not move, so string-taut cannot be found")
    slope = float(((x - centre_m) * s).sum()) / spread_m2
    if slope <= 0.0:
        raise RecordingError("the spring does not follow the nut, so string-taut cannot be found")
    scatter_m = float(np.std(s - s.mean() - slope * (x - centre_m), ddof=2))
    taut_m = centre_m - float(s.mean()) / slope
    sigma_m = scatter_m / slope * float(np.sqrt(1.0 / x.size + (taut_m - centre_m) ** 2 / spread_m2))
    return Taut(taut_m, sigma_m, slope)


def _hop(
    channels: Channels, stretch: Stretch, run: str, specs: Mapping[str, SensorSpec], common: Mapping[str, Any]
) -> Recording:
    start_s = max(stretch.armed_s, stretch.fire_s - BEFORE_FIRE_S)
    end_s = stretch.end_s
    if stretch.touchdown_s is not None:
        end_s = min(end_s, stretch.touchdown_s + AFTER_TOUCHDOWN_S)
    samples = {name: channels.between(name, start_s, end_s) for name in HOP_CHANNELS}
    samples[MAGNET] = channels.between(MAGNET, start_s, min(end_s, stretch.magnet_off_s))
    table = table_of(samples, start_s)
    held_m, sigma_m = held_compression_m(channels, stretch)
    return Recording(
        table.times_s,
        table.channels,
        run=run,
        kind="hop",
        sensors=specs,
        events=(Event(FIRE_COMMAND, stretch.fire_s - start_s),),
        state={"spring_compression_m": held_m},
        notes=(
            f"The spring's compression at the fire command is known to {sigma_m * 1e6:.2g} um (1 sigma). The "
            f"magnet is off from {stretch.magnet_off_s - start_s:.6f} s on; its current is kept until then."
        ),
        **common,
    )


def held_compression_m(channels: Channels, stretch: Stretch) -> tuple[float, float]:
    """Spring compression while the nut rests before the fire command, and its standard uncertainty [m].

    Readings before and after the hop was armed differ in rate and noise: each group weighs by its own scatter.
    """
    t, x = channels.between("nut_position_m", stretch.tensioning_s, stretch.armed_s)
    moving = np.flatnonzero(np.abs(x - x[-1]) > RESTING_WITHIN_M)
    rest_s = float(t[moving[-1] + 1]) if moving.size else float(t[0])
    means, weights = [], []
    for start_s, end_s in ((rest_s, stretch.armed_s), (stretch.armed_s, stretch.fire_s)):
        values = channels.between("spring_compression_m", start_s, end_s)[1]
        if values.size > 2 and np.ptp(values) > 0.0:
            means.append(float(values.mean()))
            weights.append(values.size / float(values.var(ddof=1)))
    if not means:
        raise RecordingError("there are not enough readings of the spring at rest before the fire command")
    return float(np.average(means, weights=weights)), float(1.0 / np.sqrt(np.sum(weights)))
