"""A rig without any friction: a free mass, pushed by a force that is held between samples."""

from __future__ import annotations

from pathlib import Path

from sim_hal.plant.simulate import Plant, load_plant

TEXT = """
format: 1
name: pushed_mass
kind: equations
inputs: {push_n: {unit: N, interpolation: hold}}
states:
  q: {unit: m, initial: 0.0}
  v: {unit: m/s, initial: 0.0}
parameters:
  mass: {value: 2.0, std: 0.1, unit: kg}
equations:
  kinematics: {state: q, rate: "v"}
  force_balance: {state: v, rate: "push_n / mass", balance: true, per_force: "1 / mass", velocity: v, position: q}
outputs:
  position_m: {value: "q"}
  acceleration_m_s2: {value: "rate(v)"}
"""


def pushed_mass(folder: Path) -> Plant:
    """The rig as read from a file in that folder; how noisy its sensors are is for the recordings to say."""
    path = folder / "pushed_mass.yaml"
    path.write_text(TEXT, encoding="utf-8")
    return load_plant(path)
