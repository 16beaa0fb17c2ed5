"""The real drivers on emulated chips beside the simulated board: the same hops, and each fault of the wire in flight.

    python -m benchmarks.boards [--json FILE] [--seed N]

A mission of two hops, off steel and off sand, is flown on `sim` and on `raspberry_pi_emulated` from one seed. What
each board's flight software measured is held against that board's own truth; `*_apart` is by how much the two errors
differ, in the resolution of the sensor that the quantity rests on: a digit of the spring's converter for E_used, a
sample of the accelerometer for the time of flight, both for the height. `e_used_stored_apart` is the same for the
truths: what each board stored in the spring when asked for the same.

`wire_faults`: faults of the wire, each kind at each place, from the middle of tensioning (for good, but a brown-out,
which strikes once); `wire_faults_survived`: missions that went on to a hop with what was asked for and ended stowed;
`wire_faults_unsafe`: those that made a hop otherwise, ended without a named fault, or left an output on.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.figures import write_figures
from flight import settings as flight_settings
from flight.executive import fly
from flight.mission import HopPlan, HopReport, MissionPlan, MissionResult
from flight.settings import FlightSettings
from flight.states import STOWED
from hal.board import open_board
from hal.config import config_path, read_yaml
from hal.log import NullLog
from sim_hal.board import world_of
from sim_hal.chips.ports import PLACES
from sim_hal.truth import HopTruth

EMULATED = "raspberry_pi_emulated"
ENERGY_J = 6.0
SURFACES = ("steel", "quartz_sand")
BROKEN_S = 4.5
"""A robot that starts at 2 mm from home tensions by then."""

DIGITS = 2048  # of the ADS1015, to one side
REST_S = 0.5


@dataclass(frozen=True)
class Flown:
    """A mission, its truths, and whether power was left on some time after its end."""

    result: MissionResult
    truths: list[HopTruth]
    power_on: bool


def flown(board: str, surfaces: tuple[str, ...], seed: int, **changes: Any) -> Flown:
    """Fly a hop off each surface on a board."""
    plan = MissionPlan(
        "boards", tuple(HopPlan(ENERGY_J, name, name, reference=name == "steel") for name in surfaces)
    )
    settings = read_yaml(config_path("boards", f"{board}.yaml"))
    settings["spots"] = [{"surface": name, "foot": 1, "tilt_deg": 0.0} for name in surfaces]
    with open_board(board, {**settings, "seed": seed, **changes}) as opened:
        result = fly(opened, flight_settings.load(), plan, NullLog())
        opened.clock.sleep_until_s(opened.clock.now_s() + REST_S)
        world = world_of(opened)
        return Flown(result, world.hops, world.magnet_on or world.voltage_v != 0.0)


@dataclass(frozen=True)
class Resolution:
    """Of the sensors that a hop's quantities rest on."""

    energy_j: float
    time_s: float
    height_m: float

    @staticmethod
    def of(truth: HopTruth, settings: FlightSettings) -> Resolution:
        """At one hop: a digit of the spring's converter, a sample of the accelerometer, and both together."""
        spring = read_yaml(config_path("boards", "raspberry_pi.yaml"))["spring"]
        digit_m = spring["m_per_v"] * spring["full_scale_v"] / DIGITS
        stiffness, gravity = settings.rig.spring_stiffness_n_m, settings.rig.gravity_m_s2
        energy_j = math.sqrt(2.0 * stiffness * truth.energy_used_j) * digit_m
        time_s = 1.0 / settings.sensors.accelerometer_rate_hz
        assert truth.time_of_flight_s is not None
        by_time_m = gravity * truth.time_of_flight_s / 4.0 * time_s
        return Resolution(energy_j, time_s, by_time_m + truth.hop_height_m * energy_j / truth.energy_used_j)


def errors(report: HopReport, truth: HopTruth) -> dict[str, float]:
    """What was measured minus what was so."""
    seen = report.energies
    assert seen.used_j is not None
    assert seen.time_of_flight_s is not None
    assert seen.height_m is not None
    assert truth.time_of_flight_s is not None
    return {
        "e_used": seen.used_j.value - truth.energy_used_j,
        "time_of_flight": seen.time_of_flight_s.value - truth.time_of_flight_s,
        "height": seen.height_m.value - truth.hop_height_m,
    }


def compare(seed: int) -> dict[str, float]:
    """Fly on both boards and print each hop; the largest differences in resolutions."""
    settings = flight_settings.load()
    sim, drivers = (flown(board, SURFACES, seed) for board in ("sim", EMULATED))
    largest = dict.fromkeys(
        ("e_used_apart", "time_of_flight_apart", "height_apart", "e_used_stored_apart"), 0.0
    )
    units = {"e_used": (1e3, "mJ"), "time_of_flight": (1e3, "ms"), "height": (1e3, "mm")}
    print("hop          quantity            sim error  drivers' error  resolution")
    for index, surface in enumerate(SURFACES):
        one, other = sim.truths[index], drivers.truths[index]
        size = Resolution.of(one, settings)
        sizes = {"e_used": size.energy_j, "time_of_flight": size.time_s, "height": size.height_m}
        by_sim, by_drivers = errors(sim.result.hops[index], one), errors(drivers.result.hops[index], other)
        for name, (scale, unit) in units.items():
            apart = abs(by_sim[name] - by_drivers[name]) / sizes[name]
            largest[f"{name}_apart"] = max(largest[f"{name}_apart"], apart)
            figures = (scale * by_sim[name], scale * by_drivers[name], scale * sizes[name])
            print(f"{surface:12s} {name:18s} {figures[0]:8.3f} {figures[1]:13.3f} {figures[2]:12.3f} {unit}")
        stored = abs(one.energy_used_j - other.energy_used_j) / size.energy_j
        largest["e_used_stored_apart"] = max(largest["e_used_stored_apart"], stored)
        verdicts = [result.hops[index].verdict for result in (sim.result, drivers.result)]
        print(f"{surface:12s} verdicts: {', '.join(verdicts)}")
    print(f"ends: {sim.result.end_reason}, {drivers.result.end_reason}")
    return largest


def break_wires(seed: int) -> dict[str, float]:
    """Fly with each fault of each wire."""
    settings = flight_settings.load()
    wires = [(place, kind) for place, kinds in PLACES.items() for kind in kinds]
    unsafe = survived = 0
    for place, kind in wires:
        fault = {"device": place, "kind": kind, "from_s": BROKEN_S}
        came = flown(EMULATED, ("quartz_sand",), seed, wire_faults=[fault])
        reason = came.result.end_reason
        stopped = not came.truths and reason not in ("", STOWED)
        went_on = came.result.completed and all(
            abs(truth.energy_used_j / ENERGY_J - 1.0) < settings.safety.firing_energy_tolerance
            for truth in came.truths
        )
        safe = (stopped or went_on) and not came.power_on
        unsafe, survived = unsafe + (not safe), survived + (safe and went_on)
        spring = "spring loaded" if came.result.spring_loaded else "spring relaxed"
        print(f"{place:18s} {kind:10s} {reason:32s} {spring}{'' if safe else '  UNSAFE'}")
    names = ("wire_faults", "wire_faults_survived", "wire_faults_unsafe")
    return dict(zip(names, map(float, (len(wires), survived, unsafe)), strict=True))


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    figures = compare(options.seed) | break_wires(options.seed)
    for name, value in figures.items():
        print(f"{name}: {value:.3g}")
    if options.json:
        write_figures(options.json, {name: (value, "1") for name, value in figures.items()})
    raise SystemExit(1 if figures["wire_faults_unsafe"] else 0)


if __name__ == "__main__":
    main()
