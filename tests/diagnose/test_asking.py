"""The next run: safe, and better at telling two rivals apart than a repeat of what was recorded."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from diagnose_rig import friction, plant, recordings

from ground.diagnose.ask import experiments, propose
from ground.diagnose.data import Data, prepare
from ground.diagnose.fit import Fit, fit_plant
from sim_hal.plant.simulate import EffectUse, Parameter


def rivals(folder: Path) -> tuple[Data, Fit, Fit]:
    """Dry friction as it is, and quadratic friction in its place, both fitted to pushes that tell little."""
    given = plant(folder)
    data = prepare(recordings(given.with_effect(friction(0.3)), seed=3), given)
    quadratic = EffectUse(
        "quadratic_friction", "force_balance", None, {"F_q": Parameter(0.5, np.inf, "N*s^2/m^2")}
    )
    dry = given.with_effect(
        EffectUse("coulomb_friction", "force_balance", None, {"F_c": Parameter(0.3, np.inf, "N")})
    )
    ranges = {"coulomb_friction.F_c": (0.3, 0.0, 10.0), "quadratic_friction.F_q": (0.5, 0.0, 50.0)}
    fits = [
        fit_plant(rival, data.windows, data.sigmas, ranges, tolerance=1e-6)
        for rival in (dry, given.with_effect(quadratic))
    ]
    return data, fits[0], fits[1]


def test_the_proposed_run_tells_more_than_a_repeat(tmp_path: Path) -> None:
    data, chosen, rival = rivals(tmp_path)
    proposal = propose(chosen, rival, data.windows, data.sigmas)
    assert proposal is not None
    assert proposal.separation >= proposal.as_recorded > 0.0


def test_no_proposed_run_exceeds_what_was_recorded(tmp_path: Path) -> None:
    data, _, _ = rivals(tmp_path)
    largest = max(float(np.max(np.abs(s.run.inputs["push_n"]))) for s in data.windows)
    for experiment in experiments(data.windows):
        assert np.max(np.abs(experiment.run.inputs["push_n"])) <= largest, experiment.words


def test_a_model_is_not_told_from_itself(tmp_path: Path) -> None:
    data, chosen, _ = rivals(tmp_path)
    proposal = propose(chosen, chosen, data.windows, data.sigmas)
    assert proposal is not None
    assert proposal.separation < 1e-3
