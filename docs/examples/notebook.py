"""A notebook, cell by cell: record a cart, doubt its simulation, let the diagnosis say what it lacks.

Run it as `python docs/examples/notebook.py FOLDER`, or paste the cells (from `# %%` to `# %%`) into a notebook.
"""

# %% What you would have: a simulation of a cart, a mass under a known force, and a recording of the real one.
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from ground.api import Recording, diagnose, load, plant, plot, save_recording, simulate

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/notebook")
folder.mkdir(parents=True, exist_ok=True)

CART = """
format: 1
plant: cart
kind: axis
parameters:
  m: {value: 2.0, std: 0.05, unit: kg}
"""
(folder / "cart.yaml").write_text(CART)
cart = plant(folder / "cart.yaml")

# %% No cart at hand: another plant plays the real one. It is a bit heavier and has dry friction.
REAL = """
format: 1
plant: real_cart
kind: axis
parameters:
  m: {value: 2.05, std: 0.0, unit: kg}
effects:
- physics_id: coulomb_friction
  equation: force_balance
  parameters:
    F_c: {value: 1.5, std: 0.0, unit: N}
"""
(folder / "real_cart.yaml").write_text(REAL)
rng = np.random.default_rng(1)
times_s = np.arange(0.0, 8.0, 0.005)
force_n = 6.0 * np.cos(2.0 * np.pi * (0.3 + 0.1 * times_s) * times_s)
planned = Recording(
    times_s,
    {"force_n": force_n, "position_m": np.zeros_like(times_s)},
    run="cart_1",
    rig="cart",
    kind="axis",
    state={"position_m": 0.0, "velocity_m_s": 0.0},
)
really_m = simulate(plant(folder / "real_cart.yaml"), planned).channels["position_m"]
measured = replace(
    planned,
    channels={"force_n": force_n, "position_m": really_m + rng.normal(0.0, 1e-4, times_s.size)},
    notes="measured",
)
save_recording(measured, folder / "cart_1.csv")

# %% Load it back as you would load your own, simulate the same run, and look at both.
(recording,) = load(folder / "cart_1.csv")
predicted = simulate(cart, recording)
plot(recording, predicted, channels=["position_m"]).write_html(folder / "before.html", include_plotlyjs=True)
error_m = recording.channels["position_m"] - predicted.channels["position_m"]
print(f"the simulation is {np.sqrt(np.mean(error_m**2)):.2f} m off (rms)")

# %% What does it lack?
outcome = diagnose([recording], cart, out=folder / "diagnosis")
for finding in outcome.diagnosis.findings:
    print(f"{finding.physics_id}: {finding.statement} (probability {finding.probability:.2f})")
    for rival in finding.alternatives[:3]:
        print(f"  or {rival.physics_id} (probability {rival.probability:.2f})")

# %% The extended plant is a plant like any other.
better = simulate(outcome.plant, recording)
error_m = recording.channels["position_m"] - better.channels["position_m"]
print(f"with it, the simulation is {1e3 * np.sqrt(np.mean(error_m**2)):.1f} mm off (rms)")
plot(recording, predicted, better, channels=["position_m"]).write_html(
    folder / "after.html", include_plotlyjs=True
)
