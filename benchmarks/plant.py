"""How fast the plant engine is, beside its peers on the same hops.

    python -m benchmarks.plant [--json FILE] [--repeats N]

`hops_per_s_*`: hops to their highest point off dissipative soils, in a batch: nominal (exact pieces), and with
friction in the guide, drag of the air and soil that resists speed (integrated). `apex_relative_error`: the
worst of the nominal hops' heights against SciPy's DOP853 at 1e-12; `…_three_effects`: against the engine at a
tolerance of 1e-11. `scipy_hops_per_s` and `mujoco_hops_per_s`: the peers at the loosest setting that brings a
height within 1e-6; `mujoco_hops_per_s_at_1e_3`: within 1e-3.

`drive_ms_*`: 30 s of tensioning at 200 Hz, crawling and easing off, with Stribeck friction, heating of the
winding and a creeping string: alone, and each of 64 parameter sets at once. `drive_sticks`: how often the motor
comes to a stand. `drive_relative_error`: outputs against a tolerance of 1e-11, relative to their ranges.

`sil_realtime_factor`: flight code and plant, one mission of a hop off sand, simulated over processor time,
without the log, and without the hop's truth, which is worked out when it is asked for; the best of some missions,
and `…_median` of them. `sil_machine_code`: 1 where it ran as machine code (`hopper compile`), 0 by the sources;
`sil_sources_factor`: the best of as many missions by the sources. `cold_start_s`: what the first simulation on a
machine costs more than a later one; `warm_start_s`: a fresh Python that loads a plant and simulates a hop. Times are
processor time, but for the starts.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import flight
import sim_hal
from benchmarks.figures import write_figures
from benchmarks.hop_peers import MuJoCoHop, Rig, by_scipy
from benchmarks.real_time import open_on_sand, plan
from flight import settings as flight_settings
from flight.executive import fly
from hal.compiled import SWITCH
from hal.config import config_path
from hal.log import NullLog
from sim_hal.plant.hops import Hops
from sim_hal.plant.simulate import EffectUse, Parameter, Plant, Run, compile_plant, load_plant

Float = NDArray[np.float64]

NOMINAL_HOPS, INTEGRATED_HOPS, CHECKED_HOPS, BATCH = 20_000, 2_000, 24, 64
SOILS = ("syar", "quartz_sand", "expanded_clay", "quartz_aggregate")
CLOSE = 1e-6
UNITS = {
    "hops": "1/s",
    "drive_ms": "ms",
    "_error": "1",
    "_factor": "1",
    "_start_s": "s",
    "drive_sticks": "1",
    "sil_machine_code": "1",
}

HOP_EFFECTS = (
    ("sleeve_friction", "body_momentum", {"F_f": (3.0, "N")}),
    ("aerodynamic_drag_quadratic", "ballistic", {"cd_a": (0.05, "m^2"), "rho": (1.2, "kg/m^3")}),
    ("soil_rate_dependence", "ground_contact", {"c_g": (60.0, "N*s/m")}),
)
DRIVE_EFFECTS = (
    ("stribeck_friction", "drive_torque", {"F_s": (1.5e-3, "N*m"), "v_s": (20.0, "rad/s")}),
    (
        "winding_heating",
        "electrical",
        {"alpha": (0.0039, "1/K"), "R_th": (15.0, "K/W"), "C_th": (20.0, "J/K")},
    ),
    ("string_creep", "spring_force", {"compliance": (5e-7, "m/N"), "tau": (5.0, "s")}),
)
STARTING = """
import sys, time
start = time.perf_counter()
from pathlib import Path
import numpy as np
from sim_hal.plant.native import build
if sys.argv[1]:
    build._SOURCES = Path("/nowhere")  # as if the package were read-only: machine code is kept for the user
from sim_hal.plant.simulate import Run, compile_plant, load_plant
plant = compile_plant(load_plant(Path(sys.argv[2])))
plant.run(plant.values, Run(
    np.arange(0.0, 1.0, 1e-3), events={"fire_command": 0.05}, known={"spring_compression_m": 0.034},
    conditions={"surface": "quartz_sand"},
))
print(time.perf_counter() - start)
"""


def cost_s(job: Callable[[], object], repeats: int) -> float:
    """Least processor time of a job, after one run to warm up: what it costs undisturbed by others."""
    job()
    times = []
    for _ in range(repeats):
        start = time.process_time()
        job()
        times.append(time.process_time() - start)
    return min(times)


def with_effects(plant: Plant, effects: tuple[tuple[str, str, dict[str, tuple[float, str]]], ...]) -> Plant:
    """The plant with effects, by name, place and values with units."""
    for physics_id, place, values in effects:
        own = {name: Parameter(value, 0.0, unit) for name, (value, unit) in values.items()}
        plant = plant.with_effect(EffectUse(physics_id, place, None, own))
    return plant


def drawn_hops(plant: Plant, count: int) -> tuple[Hops, Float, Float]:
    """Hops, their compressions [m] and their rows of values: all dissipative soils, whole range of energies."""
    rng = np.random.default_rng(1)
    hops = Hops(plant, "quartz_sand")
    rows = np.tile(hops.values, (count, 1))
    for name in ("k_l", "chi"):
        known = np.array([plant.surfaces[soil][name].value for soil in SOILS])
        rows[:, hops.parameter_names.index(f"quartz_sand.{name}")] = known[np.arange(count) % len(SOILS)]
    return hops, rng.uniform(0.022, 0.038, count), rows


def hop_figures(repeats: int) -> dict[str, float]:
    """Hops to their highest point."""
    plant = load_plant(config_path("plant", "bb0b_hop.yaml"))
    hops, compressions, rows = drawn_hops(plant, NOMINAL_HOPS)
    found = {"hops_per_s_nominal": NOMINAL_HOPS / cost_s(lambda: hops.heights_m(compressions, rows), repeats)}
    heights = hops.heights_m(compressions, rows)
    rigs = [_rig(hops, compressions[i], rows[i]) for i in range(CHECKED_HOPS)]
    exact = [by_scipy(rig, 1e-12) for rig in rigs]
    found["apex_relative_error"] = float(np.abs(heights[:CHECKED_HOPS] / exact - 1.0).max())
    hard = with_effects(plant, HOP_EFFECTS)
    hops, compressions, rows = drawn_hops(hard, INTEGRATED_HOPS)
    spent = cost_s(lambda: hops.heights_m(compressions, rows), repeats)
    found["hops_per_s_three_effects"] = INTEGRATED_HOPS / spent
    some = slice(0, 4 * CHECKED_HOPS)
    tight = Hops(hard, "quartz_sand", 1e-11).heights_m(compressions[some], rows[some])
    ours = hops.heights_m(compressions[some], rows[some])
    found["apex_relative_error_three_effects"] = float(np.abs(ours / tight - 1.0).max())
    return found | _peers(rigs[1], exact[1])


def _rig(hops: Hops, compression_m: float, row: Float) -> Rig:
    value = dict(zip(hops.parameter_names, row.tolist(), strict=True))
    own = {name: value[name] for name in ("m_b", "m_l", "g", "k", "c")}
    return Rig(**own, k_l=value["quartz_sand.k_l"], chi=value["quartz_sand.chi"], s=float(compression_m))


def _peers(rig: Rig, height_m: float) -> dict[str, float]:
    """The peers at the loosest setting that comes close enough."""

    def hops_per_s(jobs: list[Callable[[], float]], close: float) -> float:
        job = next(job for job in jobs if abs(job() / height_m - 1.0) <= close)
        return 1.0 / cost_s(job, 5)

    found = {"scipy_hops_per_s": hops_per_s([partial(by_scipy, rig, 10.0**-n) for n in range(4, 12)], CLOSE)}
    try:
        steps = [MuJoCoHop(rig, 2e-3 * 0.5**n).rise_m for n in range(14)]
    except ImportError:
        print("MuJoCo is not installed (pip install 'hopper-flight[bench]'): left out")
        return found
    for name, close in (("mujoco_hops_per_s_at_1e_3", 1e-3), ("mujoco_hops_per_s", CLOSE)):
        found[name] = hops_per_s(list(steps), close)
    return found


def drive_figures(repeats: int) -> dict[str, float]:
    """30 s of the tensioning drive."""
    plant = with_effects(load_plant(config_path("plant", "bb0b_drive.yaml")), DRIVE_EFFECTS)
    compiled = compile_plant(plant)
    times: Float = np.arange(6000) * np.float64(0.005)
    crawl = 1.7 + 0.5 * np.sin(2.0 * np.pi * 1.5 * times)  # about what the load takes
    volts = np.where(times < 16.0, 9.0, np.where(times < 22.0, crawl, np.where(times < 24.0, 0.0, -6.0)))
    run = Run(times, {"motor_voltage_v": np.asarray(np.round(volts, 2), dtype=np.float64)})
    rng = np.random.default_rng(2)
    rows = compiled.values * (1.0 + 0.02 * rng.normal(size=(BATCH, compiled.values.size)))
    outputs, states = compiled.run_with_states(compiled.values, run)
    tight = compile_plant(plant, relative_tolerance=1e-11).run(compiled.values, run)
    still = states[:, compiled.state_names.index("omega")] == 0.0
    return {
        "drive_ms_three_effects": 1e3 * cost_s(lambda: compiled.run(compiled.values, run), repeats),
        "drive_ms_batch64": 1e3 * cost_s(lambda: compiled.run_batch(rows, run), repeats) / BATCH,
        "drive_sticks": float(np.count_nonzero(np.diff(still.astype(int)) == 1)),
        "drive_relative_error": float(np.max(np.abs(outputs - tight).max(axis=0) / np.ptp(tight, axis=0))),
    }


def sil_factors(repeats: int) -> list[float]:
    """Simulated over processor time of missions of one hop, the same each time."""
    settings, factors = flight_settings.load(), []
    for _ in range(repeats):
        with open_on_sand() as board:
            start = time.process_time()
            result = fly(board, settings, plan(1), NullLog())
            factors.append(board.clock.now_s() / (time.process_time() - start))
        if not result.completed:
            raise RuntimeError(f"the mission ended early: {result.end_reason}")
    return factors


def sil_by_sources(repeats: int) -> list[float]:
    """As `sil_factors`, in a process that leaves machine code of flight and simulation aside."""
    program = (
        f"import json; from benchmarks.plant import sil_factors; print(json.dumps(sil_factors({repeats})))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {SWITCH: "0"},
    )
    found: list[float] = json.loads(done.stdout)
    return found


def sil_figures(repeats: int) -> dict[str, float]:
    """Software in the loop, as it is installed and by the sources."""
    factors = sil_factors(repeats)
    return {
        "sil_realtime_factor": max(factors),
        "sil_realtime_factor_median": float(np.median(factors)),
        "sil_machine_code": float(flight.COMPILED and sim_hal.COMPILED),
        "sil_sources_factor": max(sil_by_sources(repeats)),
    }


def start_figures() -> dict[str, float]:
    """Fresh interpreters, without and with kept machine code."""
    plant = str(config_path("plant", "bb0b_hop.yaml"))
    with tempfile.TemporaryDirectory() as home:
        taken = [
            float(
                subprocess.run(
                    [sys.executable, "-c", STARTING, "cold", plant],
                    capture_output=True,
                    text=True,
                    check=True,
                    env=os.environ | {"XDG_CACHE_HOME": home},
                ).stdout
            )
            for _ in range(4)
        ]
    warm = min(taken[1:])
    return {"cold_start_s": taken[0] - warm, "warm_start_s": warm}


def main() -> None:
    """Measure, print, and write the figures where asked."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", type=Path, help="write the figures here")
    parser.add_argument("--repeats", type=int, default=21, help="runs of which the least is taken")
    arguments = parser.parse_args()
    figures = (
        start_figures()
        | hop_figures(arguments.repeats)
        | drive_figures(arguments.repeats)
        | sil_figures(2 * arguments.repeats)
    )
    units = {name: next(unit for part, unit in UNITS.items() if part in name) for name in figures}
    for name, value in figures.items():
        print(f"{name:34s} {value:.4g} {units[name]}")
    if arguments.json:
        write_figures(arguments.json, {name: (value, units[name]) for name, value in figures.items()})


if __name__ == "__main__":
    main()
