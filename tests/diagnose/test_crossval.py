"""Cross-validation by sensitivities: they may be wrong, and then it is the simulation that counts."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from diagnose_rig import friction, plant, recordings, swinging

from ground.diagnose.crossval import cross_validate, in_sample
from ground.diagnose.data import prepare
from ground.diagnose.fit import fit_plant


def test_a_wrong_sensitivity_makes_no_good_model_bad(tmp_path: Path) -> None:
    """A swing without a push tells ratios of mass, stiffness and damping; what they are is told by tolerances alone.

    Where one stretch's sensitivity to the mass is wrong, the fit ends two sigmas from what was stated: the others,
    which know no more than that, seem to predict this stretch badly.
    """
    given = plant(tmp_path)
    driven = recordings(given, seed=3, count=6)
    still = [replace(one, channels=one.channels | {"push_n": 0.0 * one.times_s}) for one in driven]
    data = prepare(swinging(given, still), given)
    fit = fit_plant(given, data.windows, data.sigmas, {}, tolerance=1e-7, precise=True)
    honest = cross_validate(fit, data.windows, data.sigmas).mean_square
    edges = np.cumsum([segment.observed.size for segment in data.windows])
    names = [one.name for one in fit.free]
    jacobian, z = fit.jacobian.copy(), fit.z.copy()
    jacobian[edges[1] : edges[2], names.index("mass")] *= 2.0
    for name, share in (
        ("mass", 1.0),
        ("stiffness", 1.0),
        ("damping", 0.25),
    ):  # of tolerances: all scaled alike
        z[names.index(name)] += 2.0 * share
    fooled = cross_validate(replace(fit, jacobian=jacobian, z=z), data.windows, data.sigmas)
    assert honest < 1.2 * in_sample(fit, data.windows).mean_square
    assert fooled.mean_square < 1.3 * honest


def test_a_model_that_lacks_something_is_not_flattered(tmp_path: Path) -> None:
    """Dry friction that the plant lacks: left out, each recording is predicted worse than it was fitted."""
    given = plant(tmp_path)
    data = prepare(recordings(replace(given, effects=(friction(1.0),)), seed=3, count=6), given)
    fit = fit_plant(given, data.windows, data.sigmas, {}, tolerance=1e-7)
    assert (
        cross_validate(fit, data.windows, data.sigmas).mean_square
        > in_sample(fit, data.windows).mean_square
        > 4.0
    )
