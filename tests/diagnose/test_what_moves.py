"""In an equation in which nothing moves, a finding says what it means by speed."""

from __future__ import annotations

import pytest
import yaml
from diagnose_rig import TEXT

from ground.diagnose.candidates import effect_candidates
from ground.diagnose.findings import what_moves
from sim_hal.plant.plantfile import read_plant
from sim_hal.plant.simulate import Plant

TANK = """
format: 1
name: tank
kind: equations
inputs: {inflow_1: "1"}
states:
  h: {unit: m, initial: level_m}
parameters:
  area: {value: 0.0154, std: 1.0e-4, unit: m**2}
  pump: {value: 1.0e-4, std: 1.0e-6, unit: m**3/s}
equations:
  volume: {state: h, rate: pump * inflow_1 / area, balance: true, per_force: 1 / area, position: h}
outputs:
  level_m: {value: h}
"""
SCALES = {
    "F": 1.0,
    "A_sin": 0.02,
    "A_cos": 0.02,
    "V": 1.0,
    "X": 1.0,
    "X_low": 0.0,
    "X_mid": 0.5,
    "X_high": 1.0,
    "P": 0.05,
    "T": 9.0,
    "M": 1.0,
}


def said(plant: Plant, balance: str, physics_id: str) -> str:
    found = effect_candidates(plant, {balance: SCALES})
    (candidate,) = [c for c in found if c.physics_id == physics_id and c.equation == balance]
    return what_moves(candidate, plant)


@pytest.mark.parametrize(
    ("text", "balance", "says"),
    [(TANK, "volume", " Here speed is h and position is h; nothing moves, "), (TEXT, "force_balance", "")],
)
def test_speed_is_explained_where_it_is_none(text: str, balance: str, says: str) -> None:
    plant = read_plant(yaml.safe_load(text), "plant.yaml")
    words = said(plant, balance, "viscous_friction")
    assert words.startswith(says)
    assert words.endswith("is a loss by the same law, as of a leak." if says else "")
    assert bool(words) == bool(says)


def test_what_is_called_no_friction_is_not_called_a_loss() -> None:
    plant = read_plant(yaml.safe_load(TANK), "plant.yaml")
    assert said(plant, "volume", "progressive_spring") == " Here speed is h and position is h."


def test_heat_that_is_lost_is_told_in_watts() -> None:
    warm = TANK.replace("unit: m, initial: level_m", "unit: K, initial: body_k").replace("level_m", "body_k")
    warm = warm.replace("m**2", "J/K").replace("m**3/s", "W")
    (balance,) = read_plant(yaml.safe_load(warm), "plant.yaml").structure.balances.values()
    assert balance.unit == "W"
