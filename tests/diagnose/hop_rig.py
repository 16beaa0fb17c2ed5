"""Simulated hops of the BB-0B with a known truth, measured with its sensors' noise."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ground.recordings.model import Event, Recording, SensorSpec
from sim_hal.plant.simulate import EffectUse, Parameter, Plant, Run, compile_plant, load_plant

CONFIG = Path(__file__).resolve().parents[2] / "config" / "plant"
FIRE_S = 0.05
HOPS = (("quartz_sand", 0.031), ("quartz_sand", 0.034), ("quartz_sand", 0.0325))


def nominal() -> Plant:
    return load_plant(CONFIG / "bb0b_hop.yaml")


def effect(
    physics_id: str, equation: str, channel: str | None = None, **parameters: tuple[float, str]
) -> EffectUse:
    values = {name: Parameter(value, 0.0, unit) for name, (value, unit) in parameters.items()}
    return EffectUse(physics_id, equation, channel, values)


def drawn(plant: Plant, generator: np.random.Generator) -> Plant:
    """The plant with every parameter drawn within its tolerance."""
    values = {n: float(p.value + p.std * np.clip(generator.normal(), -2, 2)) for n, p in plant.flat().items()}
    return plant.with_values({n: min(v, 0.97) if n.endswith(".chi") else v for n, v in values.items()})


def hops(truth: Plant, seed: int, runs: tuple[tuple[str, float], ...] = HOPS) -> list[Recording]:
    """One recording for each surface and compression, the true parameters drawn once."""
    generator = np.random.default_rng(seed)
    actual = drawn(truth, generator)
    compiled = compile_plant(actual)
    times = np.round(np.arange(1000) / 1666.0, 6)
    found = []
    for number, (surface, compression) in enumerate(runs):
        conditions: Mapping[str, float | str] = {"surface": surface, "gravity_m_s2": 8.874}
        state = {"spring_compression_m": compression}
        run = Run(times, {}, {"fire_command": FIRE_S}, state, conditions)
        outputs = compiled.run(compiled.values, run)
        channels = {}
        for i, name in enumerate(compiled.output_names):
            sensor = truth.sensors[name]
            read = outputs[:, i] + sensor.noise_std * generator.standard_normal(times.size)
            step = sensor.resolution or 0.0
            channels[name] = np.round(read / step) * step if step else read
        specs = {n: SensorSpec(s.noise_std, s.resolution, s.range) for n, s in truth.sensors.items()}
        found.append(
            Recording(
                times,
                channels,
                run=f"hop_{number}",
                rig="bb0b",
                kind="hop",
                sensors=specs,
                conditions=conditions,
                events=(Event("fire_command", FIRE_S),),
                state=state,
            )
        )
    return found
