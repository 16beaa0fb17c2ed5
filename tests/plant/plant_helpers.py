"""Small plants and short cuts that the tests of the plant engine share."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from hal.config import StrictLoader
from sim_hal.plant.compose import place_units
from sim_hal.plant.plant import check_use
from sim_hal.plant.simulate import EffectUse, Parameter, Plant, Run, compile_plant, load_plant, read_plant

CONFIG = Path(__file__).resolve().parents[2] / "config" / "plant"


def plant_of(text: str) -> Plant:
    """A plant from YAML text."""
    return read_plant(yaml.load(text, Loader=StrictLoader), "test.yaml")


def shipped(name: str) -> Plant:
    """A plant of config/plant."""
    return load_plant(CONFIG / f"{name}.yaml")


def use_of(
    plant: Plant, physics_id: str, equation: str, values: Mapping[str, float], channel: str | None = None
) -> EffectUse:
    """An effect with the given values, its units as the place asks."""
    blank = EffectUse(physics_id, equation, channel, {name: Parameter(0.0, 0.0, "1") for name in values})
    units = place_units(plant, blank, check_use(plant, blank))
    return EffectUse(
        physics_id,
        equation,
        channel,
        {name: Parameter(value, 0.0, units[name]) for name, value in values.items()},
    )


def simulate(plant: Plant, run: Run, initial: Mapping[str, float] | None = None) -> dict[str, Any]:
    """Outputs by channel."""
    compiled = compile_plant(plant)
    found = compiled.run(compiled.values, run, initial)
    return dict(zip(compiled.output_names, found.T, strict=True))


def states(plant: Plant, run: Run, initial: Mapping[str, float] | None = None) -> dict[str, Any]:
    """States by name."""
    compiled = compile_plant(plant)
    found = compiled.states(compiled.values, run, initial)
    return dict(zip(compiled.state_names, found.T, strict=True))


def block(force: str = "push_n", extra: str = "", parameters: str = "") -> str:
    """A mass on a floor under a force; `extra` are further sections, `parameters` further entries."""
    return f"""
format: 1
name: block
kind: equations
inputs: {{push_n: {{unit: N, interpolation: linear}}}}
states:
  q: {{unit: m, initial: 0}}
  v: {{unit: m/s, initial: 0}}
parameters:
  m: {{value: 2.0, std: 0.1, unit: kg}}
  k: {{value: 50.0, std: 1.0, unit: N/m}}
  {parameters}
equations:
  kinematics: {{state: q, rate: v}}
  force_balance: {{state: v, rate: "({force}) / m", balance: true, per_force: 1 / m, velocity: v, position: q}}
outputs:
  position_m: {{value: q}}
  speed_m_s: {{value: v}}
  acceleration_m_s2: {{value: rate(v)}}
{extra}
"""


def pushed(times: np.ndarray, push: np.ndarray | float) -> Run:
    """A run of the block."""
    return Run(times_s=times, inputs={"push_n": np.broadcast_to(push, times.shape).astype(float)})


def hop_run(
    times: np.ndarray, surface: str = "quartz_sand", compression: float = 0.036, **conditions: float
) -> Run:
    """A hop fired at 50 ms."""
    return Run(
        times_s=times,
        events={"fire_command": 0.05},
        known={"spring_compression_m": compression},
        conditions={"surface": surface, **conditions},
    )
