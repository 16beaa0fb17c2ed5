"""A small rig with a known truth: a driven mass on a spring, its position measured."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ground.recordings.model import Recording, SensorSpec
from sim_hal.plant.simulate import EffectUse, Parameter, Plant, Run, compile_plant, load_plant

NOISE_M = 2e-4

TEXT = """
format: 1
name: oscillator
kind: equations
inputs: {push_n: N}
states:
  q: {unit: m, initial: position_m}
  v: {unit: m/s, initial: fit}
parameters:
  mass: {value: 2.0, std: 0.1, unit: kg}
  stiffness: {value: 50.0, std: 2.5, unit: N/m}
  damping: {value: 1.5, std: 0.3, unit: N*s/m}
equations:
  kinematics: {state: q, rate: "v"}
  force_balance: {state: v, rate: "(push_n - stiffness * q - damping * v) / mass", balance: true,
                  per_force: "1 / mass", velocity: v, position: q}
outputs:
  position_m: {value: "q"}
sensors:
  position_m: {noise_std: 2.0e-4}
"""


def plant(folder: Path) -> Plant:
    path = folder / "oscillator.yaml"
    path.write_text(TEXT, encoding="utf-8")
    return load_plant(path)


def friction(level_n: float) -> EffectUse:
    return EffectUse("coulomb_friction", "force_balance", None, {"F_c": Parameter(level_n, 0.0, "N")})


def recordings(truth: Plant, seed: int, count: int = 3, samples: int = 300) -> list[Recording]:
    """Runs of the true rig under different pushes, its parameters drawn within their tolerances."""
    generator = np.random.default_rng(seed)
    drawn = {n: generator.normal(p.value, p.std) for n, p in truth.parameters.items()}
    compiled = compile_plant(truth.with_values(drawn))
    times = 0.01 * np.arange(samples)
    found = []
    for number in range(count):
        push = sum(
            generator.uniform(2.0, 5.0) * np.sin(2 * np.pi * f * times + generator.uniform(0, 6.28))
            for f in (0.3, 0.7, 1.1)
        )
        run = Run(times, {"push_n": push}, first_samples={"position_m": np.zeros(20)})
        position = compiled.run(compiled.values, run, {"q": 0.0, "v": 0.0})[:, 0]
        measured = position + NOISE_M * generator.standard_normal(samples)
        found.append(
            Recording(
                times,
                {"push_n": push, "position_m": measured},
                run=f"run_{number}",
                rig="oscillator",
                kind="bench",
                sensors={"position_m": SensorSpec(noise_std=NOISE_M)},
            )
        )
    return found


def swinging(truth: Plant, like: list[Recording]) -> list[Recording]:
    """The same rig let go from rest, without any push."""
    compiled = compile_plant(truth)
    found = []
    for number, recording in enumerate(like):
        run = Run(
            recording.times_s, {"push_n": 0.0 * recording.times_s}, first_samples={"position_m": np.zeros(20)}
        )
        start = {"q": 0.1 + 0.05 * number, "v": 0.0}
        noise = NOISE_M * np.random.default_rng(number).standard_normal(recording.times_s.size)
        position = compiled.run(compiled.values, run, start)[:, 0] + noise
        found.append(replace(recording, channels={**recording.channels, "position_m": position}))
    return found
