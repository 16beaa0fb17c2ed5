"""The simulated rigs whose hidden physics is known: with the true values all channels come within the noise."""

from __future__ import annotations

import csv
import gzip
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from plant_helpers import use_of

from sim_hal.plant.simulate import CompiledPlant, Plant, Run, compile_plant, load_plant

PRACTICE = Path(__file__).resolve().parents[2] / "../shared/practice"
pytestmark = pytest.mark.skipif(not PRACTICE.is_dir(), reason="the practice cases are not at hand")

Values = Mapping[str, float]
SAME: Callable[[Values], Values] = dict
#: Hidden effect → the equation it enters, its channel, and its parameters in this catalogue's terms.
EFFECTS: dict[str, tuple[str, str | None, Callable[[Values], Values]]] = {
    "soil_rate_dependence": ("ground_contact", None, SAME),
    "latch_drag": ("latch", None, SAME),
    "winding_heating": ("electrical", None, SAME),
    "aerodynamic_drag_quadratic": ("ballistic", None, SAME),
    "backlash": ("transmission", None, SAME),
    "sleeve_friction": ("body_momentum", None, SAME),
    "sensor_delay": ("sensor", "spring_compression_m", SAME),
    "torque_constant_saturation": ("electrical", None, lambda p: {"saturation": p["i_s"] ** -2}),
    "warm_up_friction": ("drive_torque", None, lambda p: {"F_w": p["tau_w"], "W_0": p["W_0"]}),
    "position_dependent_friction": (
        "drive_torque",
        None,
        lambda p: {"F_p": p["tau_p"], "x_p": p["x_p"], "w_p": p["w_p"]},
    ),
    "string_creep": ("spring_force", None, lambda p: {"compliance": 1 / p["k_c"], "tau": p["tau"]}),
    "stribeck_friction": ("drive_torque", None, lambda p: {"F_s": p["tau_s"], "v_s": p["omega_s"]}),
    "presliding_hysteresis": ("drive_torque", None, lambda p: {"s_p": p["theta_s"], "share": 1.0}),
}


def true_plant(folder: Path, answer: dict[str, Any]) -> Plant:
    """The rig as it really is."""
    values = {name: entry["true"] for name, entry in answer["parameters_true"].items()}
    for surface, entries in answer.get("surfaces_true", {}).items():
        values |= {f"{surface}.{name}": value for name, value in entries.items()}
    plant = load_plant(folder / "plant.yaml").with_values(values)
    for hidden in answer["hidden"]:
        equation, channel, translate = EFFECTS[hidden["physics_id"]]
        sizes = translate({name: entry["value"] for name, entry in hidden["parameters"].items()})
        plant = plant.with_effect(use_of(plant, hidden["physics_id"], equation, sizes, channel))
    return plant


def recording(path: Path) -> tuple[Run, dict[str, Any]]:
    with gzip.open(path, "rt") as file:
        head, *rows = csv.reader(file)
    columns = dict(zip(head, np.array(rows, dtype=float).T, strict=True))
    side = yaml.safe_load(path.with_name(path.name.replace(".csv.gz", ".yaml")).read_text())
    run = Run(
        times_s=columns.pop("time_s"),
        inputs={name: values for name, values in columns.items() if name == "motor_voltage_v"},
        events={event["name"]: event["time_s"] for event in side.get("events", [])},
        known=side["state"],
        conditions=side["conditions"],
    )
    return run, columns


def reduced_residuals(compiled: CompiledPlant, folder: Path, answer: dict[str, Any]) -> dict[str, float]:
    """Residual over noise, rms over the held-out runs, outside the masks, by channel."""
    found: dict[str, list[Any]] = {name: [] for name in compiled.output_names}
    for name in answer["test"]:
        run, measured = recording(folder / "test" / f"{name}.csv.gz")
        keep = np.ones(len(run.times_s), dtype=bool)
        for low, high in answer.get("masked", {}).get(name, []):
            keep &= (run.times_s < low) | (run.times_s > high)
        predicted = compiled.run(compiled.values, run)
        for column, channel in enumerate(compiled.output_names):
            error = (predicted[:, column] - measured[channel])[keep] / answer["sigma"][channel]
            found[channel].append(error)
    return {name: float(np.sqrt(np.mean(np.concatenate(parts) ** 2))) for name, parts in found.items()}


@pytest.mark.parametrize("case", sorted(path.name for path in PRACTICE.glob("case_*")))
def test_true_values_reach_the_noise(case: str) -> None:
    folder = PRACTICE / case
    answer = yaml.safe_load((folder / "answer.yaml").read_text())
    compiled = compile_plant(true_plant(folder, answer))
    for channel, size in reduced_residuals(compiled, folder, answer).items():
        assert size < 1.1, channel
        # The figure that the cases' own solver reached.
        assert size == pytest.approx(answer["check"]["oracle_test"][channel], rel=0.02, abs=1e-4)
