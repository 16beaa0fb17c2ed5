"""A rig that falls over when run free: a steel ball under a magnet, held there by a controller that is not known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from diagnose_rig import plant, recordings
from hop_rig import hops, nominal

from ground.diagnose.data import prepare
from ground.diagnose.pipeline import diagnose
from ground.diagnose.windows import runs_away
from ground.recordings.model import Recording, SensorSpec
from sim_hal.plant.simulate import Plant, compile_plant, load_plant

STEP_S = 1e-3
PER_STEP = 10
NOISE_M = 1e-5
GRAVITY_M_S2 = 9.81
MASS_KG = 0.068

TEXT = """
format: 1
name: magnet
kind: equations
inputs: {coil_a: {unit: A, interpolation: hold}}
states:
  z: {unit: m, initial: gap_m}
  v: {unit: m/s, initial: fit}
parameters:
  m: {value: 0.068, std: 0.0, unit: kg}
  g: {value: 9.81, std: 0.0, unit: m/s^2}
  k: {value: 6.5e-5, std: 6.0e-6, unit: N*m^2/A^2}
equations:
  kinematics: {state: z, rate: "v"}
  levitation: {state: v, rate: "g - k * (coil_a / z) ** 2 / m", balance: true, per_force: "1 / m",
               velocity: v, position: z}
outputs:
  gap_m: {value: "z"}
"""


def magnet(folder: Path) -> Plant:
    path = folder / "magnet.yaml"
    path.write_text(TEXT, encoding="utf-8")
    return load_plant(path)


def held(seed: int, k: float, offset_m: float = 0.0, samples: int = 600) -> Recording:
    """A run in closed loop, integrated by small steps; the gap's sensor reads `offset_m` too much."""
    generator = np.random.default_rng(seed)
    targets = np.repeat(generator.uniform(0.008, 0.012, samples // 150 + 1), 150)
    z, v, gaps, currents = 0.010, 0.0, [], []
    for target in targets[:samples]:
        wanted = GRAVITY_M_S2 + 900.0 * (z - target) + 45.0 * v
        current = z * np.sqrt(MASS_KG / k * max(wanted, 0.0))
        gaps.append(z)
        currents.append(current)
        for _ in range(PER_STEP):
            v += STEP_S / PER_STEP * (GRAVITY_M_S2 - k / MASS_KG * (current / z) ** 2)
            z += STEP_S / PER_STEP * v
    read = np.array(gaps) + offset_m + NOISE_M * generator.standard_normal(samples)
    return Recording(
        STEP_S * np.arange(samples),
        {"coil_a": np.array(currents), "gap_m": read},
        run=f"run_{seed}",
        rig="magnet",
        kind="bench",
        sensors={"gap_m": SensorSpec(noise_std=NOISE_M)},
    )


def test_a_rig_that_runs_away_is_looked_at_in_short_windows(tmp_path: Path) -> None:
    given = magnet(tmp_path)
    outcome = diagnose([held(seed, k=6.9e-5) for seed in (1, 2, 3)], given).diagnosis
    assert outcome.verdict == "consistent"
    assert any("runs away" in note for note in outcome.notes)
    found = outcome.details["nominal_parameters"]["k"]
    assert abs(found["extended"] - 6.9e-5) < 3.0 * found["std"]
    assert outcome.fit["gap_m"].refit_rms < 5.0 * NOISE_M


def test_its_sensor_that_reads_off_is_found(tmp_path: Path) -> None:
    runs = [held(seed, k=6.9e-5, offset_m=-1.2e-3) for seed in (1, 2, 3)]
    (finding,) = diagnose(runs, magnet(tmp_path)).diagnosis.findings
    assert finding.physics_id == "sensor_bias"
    assert abs(finding.parameters["bias"].value + 1.2e-3) < 3.0 * finding.parameters["bias"].std


def test_a_rig_that_stays_is_not_cut_any_shorter(tmp_path: Path) -> None:
    given = plant(tmp_path)
    runs = recordings(given, seed=3)
    assert not runs_away(runs, given, compile_plant(given))
    assert prepare(runs, given).held_out_whole[0].samples == runs[0].times_s.size


def test_one_hop_judged_at_its_end_is_not_said_to_run_away() -> None:
    """Held out is the end of that one run: its windows are its whole, and it runs from where it was seen to start."""
    outcome = diagnose(hops(nominal(), seed=2)[:1], nominal()).diagnosis
    assert any("There was one recording" in note for note in outcome.notes)
    assert not any("runs away" in note for note in outcome.notes)
