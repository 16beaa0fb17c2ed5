"""A law that fits only with parameters out of their tolerances is not taken for the right one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from diagnose_rig import friction, plant, recordings

from ground.diagnose.candidates import effect_candidates
from ground.diagnose.chosen import Chosen, Named
from ground.diagnose.data import prepare
from ground.diagnose.findings import accounted, findings_of, shared_with_twins
from ground.diagnose.fit import Fit, fit_plant
from ground.diagnose.scales import find_scales
from ground.diagnose.tension import chance, departures, listed, strained
from sim_hal.plant.simulate import Plant


def fitted(model: Plant, truth: Plant, seed: int) -> Fit:
    data = prepare(recordings(truth, seed, count=4), model)
    ranges = dict.fromkeys(("coulomb_friction.F_c",), (0.5, 0.0, 5.0)) if model.effects else {}
    return fit_plant(model, data.windows, data.sigmas, ranges, tolerance=1e-6, precise=True)


def test_the_chance_is_right_where_the_law_is(tmp_path: Path) -> None:
    """Parameters are drawn from their tolerances: their chance is as likely to be small as large."""
    given = plant(tmp_path).with_effect(friction(0.8))
    chances = np.sort([chance(fitted(given, given, seed)) for seed in range(12)])
    assert np.abs(chances - (np.arange(12) + 0.5) / 12).max() < 0.4  # Kolmogorov: 1.2 % of fair draws fail
    assert listed(fitted(given, given, seed=5)) > 0.8


def test_a_law_that_needs_parameters_far_off_is_hardly_the_right_one(tmp_path: Path) -> None:
    given = plant(tmp_path)
    stiffer = given.with_values({"stiffness": 60.0, "mass": 1.7}, {"stiffness": 0.0, "mass": 0.0})
    fit = fitted(given.with_effect(friction(0.8)), stiffer, seed=6)
    assert departures(fit)["stiffness"] > 2.5
    assert listed(fit) < 0.05
    (words,) = strained(fit)
    assert "stiffness +" in words


@pytest.mark.parametrize(("stiffness", "sure"), [(50.0, True), (60.0, False)])
def test_what_is_found_is_said_to_be_that_probable(tmp_path: Path, stiffness: float, sure: bool) -> None:
    given = plant(tmp_path)
    truth = given.with_values({"stiffness": stiffness}, {"stiffness": 0.0})
    data = prepare(recordings(truth, seed=6, count=4), given)
    refit = fit_plant(given, data.windows, data.sigmas, {})
    offered = effect_candidates(given, find_scales(refit, data.windows))
    candidate, rival = (
        next(c for c in offered if c.physics_id == name) for name in ("coulomb_friction", "viscous_friction")
    )
    fit = fitted(given.with_effect(friction(0.8)), truth.with_effect(friction(0.8)), seed=6)
    one = Chosen(candidate, 1.0, (), {}, ((candidate, 0.9), (rival, 0.1)), refit.chi2)
    (found,) = findings_of(Named(fit, (one,), (), ()), refit, data.windows, ())
    known = listed(fit) * accounted(fit, refit, data.windows)
    assert found.probability == pytest.approx(0.9 * known)
    assert (found.probability > 0.7) == sure


def test_a_twin_that_its_own_fit_told_apart_takes_no_share(tmp_path: Path) -> None:
    given = plant(tmp_path)
    data = prepare(recordings(given, seed=6, count=4), given)
    offered = effect_candidates(
        given, find_scales(fit_plant(given, data.windows, data.sigmas, {}), data.windows)
    )
    one, told, alike, like_told = offered[:4]
    weights = ((one, 0.98), (told, 0.02))
    twins = {one.key: ((told, 1.0), (alike, 1.0)), told.key: ((like_told, 3.0),)}
    chosen = Chosen(one, 1.0, (told,), twins, weights)
    shares = {candidate.key: share for candidate, share in shared_with_twins(chosen)}
    wanted = {one.key: 0.49, alike.key: 0.49, told.key: 0.005, like_told.key: 0.015}
    assert shares == pytest.approx(wanted)  # a rival shares with what acts like it
