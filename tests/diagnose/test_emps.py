"""A real machine: the EMPS axis, its friction fitted to three quarters of the recording and tried on the rest."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ground.diagnose.data import prepare
from ground.diagnose.fit import fit_plant
from ground.diagnose.verify import windowed_rms
from ground.importing import import_recording
from hal.config import config_path
from sim_hal.plant.simulate import EffectUse, Parameter, load_plant

EMPS = Path(__file__).resolve().parents[2] / "../shared/data/emps/DATA_EMPS.mat"
EFFECTS = (
    ("viscous_friction", "F_v", 100.0, "N*s/m", 1000.0),
    ("coulomb_friction", "F_c", 10.0, "N", 100.0),
    ("asymmetric_friction", "F_o", -1.0, "N", 100.0),
)

pytestmark = pytest.mark.skipif(not EMPS.is_file(), reason=f"the EMPS recording is not at {EMPS}")


def test_friction_of_the_real_axis_is_what_its_authors_published_and_predicts_what_was_not_fitted() -> None:
    mass_only = load_plant(config_path("plant", "emps_mass.yaml"))
    published = load_plant(config_path("plant", "emps_published.yaml"))
    data = prepare([import_recording(EMPS, config_path("imports", "emps.yaml"))], mass_only)
    plant, ranges = mass_only, {}
    for physics_id, name, start, unit, reach in EFFECTS:
        use = EffectUse(physics_id, "force_balance", None, {name: Parameter(start, np.inf, unit)})
        plant = plant.with_effect(use)
        ranges[f"{physics_id}.{name}"] = (start, -reach, reach)
    fit = fit_plant(plant, data.windows, data.sigmas, ranges)
    for name, parameter in published.flat().items():
        apart = fit.values[name] - parameter.value
        assert abs(apart) < 3.0 * np.hypot(fit.std[name], parameter.std), name
        assert fit.std[name] < 0.2 * abs(parameter.value), name
    found = windowed_rms(plant.with_values(fit.values), data.held_out_windows, data.sigmas)["position_m"]
    lacking = windowed_rms(mass_only, data.held_out_windows, data.sigmas)["position_m"]
    theirs = windowed_rms(published, data.held_out_windows, data.sigmas)["position_m"]
    assert np.sqrt(np.mean(found**2)) < 0.05 * np.sqrt(np.mean(lacking**2))
    assert np.sqrt(np.mean(found**2)) < 1.2 * np.sqrt(np.mean(theirs**2))
