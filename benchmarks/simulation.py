"""How long the plant engine takes for a run, beside SciPy's solver on the same equations.

    python -m benchmarks.simulation [--json FILE] [--repeats N]

The axis is a mass under a known force with Coulomb and viscous friction, 10 s at 1 kHz. SciPy's RK45, at the same
relative tolerance of 1e-8, gets the friction smoothed (tanh over 0.1 mm/s), as it knows no sticking. How far the two
end up apart is printed too, and is that smoothing's doing.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from hal.config import config_path
from sim_hal.plant.simulate import EffectUse, Parameter, Plant, Run, compile_plant, load_plant

Float = NDArray[np.float64]

FRICTION_N, DAMPING_N_S_M, SMOOTH_M_S = 20.0, 200.0, 1e-4


def median_ms(job: Callable[[], object], repeats: int) -> float:
    """Median wall time of a job in milliseconds, after one run to warm up."""
    job()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        job()
        times.append(1e3 * (time.perf_counter() - start))
    return float(np.median(times))


def axis() -> tuple[Plant, Run]:
    """The axis with friction, and a run that reverses often."""
    plant = load_plant(config_path("plant", "emps_mass.yaml"))
    for physics_id, name, value, unit in (
        ("coulomb_friction", "F_c", FRICTION_N, "N"),
        ("viscous_friction", "F_v", DAMPING_N_S_M, "N*s/m"),
    ):
        use = EffectUse(physics_id, "force_balance", None, {name: Parameter(value, 0.0, unit)})
        plant = plant.with_effect(use)
    times: Float = np.arange(10_001) * np.float64(1e-3)
    force = 60.0 * np.sin(2 * np.pi * 0.5 * times) + 20.0 * np.sin(2 * np.pi * 1.7 * times)
    return plant, Run(times, {"motor_force_n": force}, first_samples={"position_m": np.zeros(20)})


def by_scipy(run: Run, mass_kg: float) -> Float:
    """Position (samples,) by SciPy's RK45 with smoothed friction."""
    force = run.inputs["motor_force_n"]

    def rates(t: float, state: Float) -> list[float]:
        v = float(state[1])
        resisting = FRICTION_N * np.tanh(v / SMOOTH_M_S) + DAMPING_N_S_M * v
        return [v, float((np.interp(t, run.times_s, force) - resisting) / mass_kg)]

    span = (float(run.times_s[0]), float(run.times_s[-1]))
    found = solve_ivp(rates, span, [0.0, 0.0], t_eval=run.times_s, rtol=1e-8, atol=1e-12)
    return np.asarray(found.y[0], dtype=np.float64)


def measure(repeats: int) -> dict[str, float]:
    """All figures, by name."""
    figures: dict[str, float] = {}
    plant, run = axis()
    start = {"q": 0.0, "v": 0.0}
    engine = compile_plant(plant)
    position = engine.run(engine.values, run, start)[:, 0]
    mass = plant.parameters["mass"].value
    figures["axis_10s_ms"] = median_ms(lambda: engine.run(engine.values, run, start), repeats)
    figures["axis_10s_scipy_ms"] = median_ms(lambda: by_scipy(run, mass), 1)
    figures["axis_10s_apart_m"] = float(np.abs(by_scipy(run, mass) - position).max())
    drive = compile_plant(load_plant(config_path("plant", "bb0b_drive.yaml")))
    times = np.arange(0.0, 20.0, 0.005)
    tension = Run(times, {"motor_voltage_v": np.full(times.size, 9.0)})
    figures["drive_20s_ms"] = median_ms(lambda: drive.run(drive.values, tension), repeats)
    hop = compile_plant(load_plant(config_path("plant", "bb0b_hop.yaml")))
    leap = Run(
        np.arange(0.0, 1.0, 1 / 1666),
        events={"fire_command": 0.05},
        known={"spring_compression_m": 0.034},
        conditions={"surface": "quartz_sand"},
    )
    figures["hop_1s_ms"] = median_ms(lambda: hop.run(hop.values, leap), repeats)
    return figures


def main() -> None:
    """Measure, print, and write the figures where asked."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", type=Path, help="write the figures here")
    parser.add_argument("--repeats", type=int, default=15, help="runs of which the median is taken")
    arguments = parser.parse_args()
    figures = measure(arguments.repeats)
    for name, value in figures.items():
        print(f"{name:26s} {value:.4g}")
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
