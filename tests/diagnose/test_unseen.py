"""What no fit saw, predicted from its first samples, weighs rivals; where they predict alike it says nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnose_rig import friction, plant, recordings

import ground.diagnose.unseen as unseen
from ground.diagnose.data import prepare
from ground.diagnose.fit import fit_plant
from ground.diagnose.unseen import pooled, weights_on
from sim_hal.plant.simulate import SimulationError


@pytest.fixture(scope="module")
def trial(tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, Any, Any]:
    """Prepared recordings of a rig with dry friction, and its fits without and with it."""
    given = plant(tmp_path_factory.mktemp("rig"))
    data = prepare(recordings(given.with_effect(friction(0.8)), seed=2, count=4), given)
    without, with_friction = (
        fit_plant(each, data.windows, data.sigmas, {}) for each in (given, given.with_effect(friction(0.8)))
    )
    return data, without, with_friction


def test_the_better_prediction_has_the_weight(trial: tuple[Any, Any, Any]) -> None:
    data, without, with_friction = trial
    weights = weights_on(data.held_out_windows, [without, with_friction], data.sigmas)
    assert weights.sum() == pytest.approx(1.0)
    assert weights[1] > 0.99


def test_what_predicts_alike_weighs_alike(trial: tuple[Any, Any, Any]) -> None:
    data, _, with_friction = trial
    weights = weights_on(data.held_out_windows, [with_friction] * 3, data.sigmas)
    assert list(weights) == pytest.approx([1.0 / 3.0] * 3)


def test_where_one_cannot_be_run_nothing_is_said(
    trial: tuple[Any, Any, Any], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    data, without, with_friction = trial

    def stuck(model: Any, *_: Any) -> None:
        raise SimulationError(f"{model.name}: cannot go on")

    monkeypatch.setattr(unseen, "predict", stuck)
    weights = weights_on(data.held_out_windows, [without, with_friction], data.sigmas)
    assert list(weights) == [0.5, 0.5]


def test_both_lots_of_data_count_and_contradiction_makes_no_number_that_is_none() -> None:
    assert list(pooled(np.array([0.8, 0.2]), np.array([0.2, 0.8]))) == pytest.approx([0.5, 0.5])
    assert list(pooled(np.array([1.0, 0.0]), np.array([0.0, 1.0]))) == [1.0, 0.0]
