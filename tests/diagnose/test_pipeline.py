"""Diagnosis of a rig whose truth is known: what was planted is found, and nothing is found where nothing is."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from diagnose_rig import NOISE_M, friction, plant, recordings, swinging

from ground.diagnose.data import DiagnosisError, prepare
from ground.diagnose.fit import fit_plant
from ground.diagnose.notes import absent_channels
from ground.diagnose.pipeline import Outcome, diagnose, write_outcome
from ground.diagnose.segments import cut_recording
from ground.recordings.model import SensorSpec
from sim_hal.plant.simulate import load_plant


@pytest.fixture(scope="module")
def planted(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    given = plant(tmp_path_factory.mktemp("rig"))
    return diagnose(recordings(given.with_effect(friction(1.0)), seed=11), given)


def test_planted_friction_is_named_first(planted: Outcome) -> None:
    found = planted.diagnosis
    assert found.verdict == "mismatch"
    assert found.findings[0].physics_id == "coulomb_friction"
    assert found.findings[0].equation == "force_balance"
    assert found.findings[0].probability > 0.5


def test_planted_friction_has_its_size_within_its_sigma(planted: Outcome) -> None:
    level = planted.diagnosis.findings[0].parameters["F_c"]
    assert level.unit == "N"
    assert abs(level.value - 1.0) < 4.0 * level.std
    assert level.std < 0.2


def test_the_extended_plant_predicts_what_was_held_out_down_to_the_noise(planted: Outcome) -> None:
    fit = planted.diagnosis.fit["position_m"]
    assert fit.extended_rms < 1.3 * NOISE_M
    assert fit.refit_rms > 3.0 * fit.extended_rms


def test_the_missing_force_follows_speed(planted: Outcome) -> None:
    force = planted.evidence.forces[0]
    assert force.equation == "force_balance"
    assert max(force.explained, key=lambda cause: force.explained[cause]) == "velocity"
    assert force.log_likelihood_gain > 100.0


def test_nothing_is_found_where_nothing_is_missing(tmp_path: Path) -> None:
    given = plant(tmp_path)
    found = diagnose(recordings(given, seed=12), given).diagnosis
    assert found.verdict == "consistent"
    assert found.findings == ()
    fit = found.fit["position_m"]
    assert fit.extended_rms == pytest.approx(fit.refit_rms)


def test_an_effect_that_the_plant_has_already_is_no_finding(tmp_path: Path) -> None:
    given = plant(tmp_path).with_effect(friction(1.0))
    found = diagnose(recordings(given, seed=13), given).diagnosis
    assert "coulomb_friction" not in {finding.physics_id for finding in found.findings}


def test_results_are_written_and_the_plant_reads_back(planted: Outcome, tmp_path: Path) -> None:
    write_outcome(planted, tmp_path / "out")
    content = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert content["format"] == 1
    assert content["recordings"] == {"fitted": ["run_0", "run_1"], "held_out": ["run_2"]}
    again = load_plant(tmp_path / "out" / "plant.yaml")
    assert [use.physics_id for use in again.effects] == [use.physics_id for use in planted.plant.effects]
    assert again.flat()["coulomb_friction.F_c"] == planted.plant.flat()["coulomb_friction.F_c"]
    page = (tmp_path / "out" / "report.html").read_text()
    assert "coulomb friction" in page


def test_refit_sigmas_cover_the_truth(tmp_path: Path) -> None:
    """Parameters drawn within their tolerances: the fit's z-scores are those of a unit normal, by and large."""
    given = plant(tmp_path)
    scores = []
    for seed in range(12):
        drawn = np.random.default_rng(seed)
        truth = {n: drawn.normal(p.value, p.std) for n, p in given.parameters.items()}
        data = prepare(recordings(given, seed=seed, count=2, samples=300), given)
        fit = fit_plant(given, data.windows, data.sigmas, {})
        scores += [(fit.values[name] - truth[name]) / fit.std[name] for name in truth]
    inside = np.mean(np.abs(scores) < 1.96)
    assert 0.85 <= inside <= 1.0
    assert 0.5 < np.std(scores) < 1.4


def test_too_short_a_recording_is_refused_in_words(tmp_path: Path) -> None:
    given = plant(tmp_path)
    short = cut_recording(recordings(given, seed=1, count=1)[0], 0, 20)
    with pytest.raises(DiagnosisError, match="20 samples; a diagnosis needs at least 30"):
        diagnose([short], given)


def test_what_only_tolerances_tell_keeps_its_tolerance(tmp_path: Path) -> None:
    """With the push unknown in size, all forces and the mass scale alike: only the priors know the scale."""
    given = plant(tmp_path)
    free = recordings(given, seed=3, count=2)
    unpushed = [replace(r, channels={**r.channels, "push_n": 0.0 * r.times_s}) for r in swinging(given, free)]
    data = prepare(unpushed, given)
    fit = fit_plant(given, data.windows, data.sigmas, {}, tolerance=1e-7, precise=True)
    relative = {name: p.std / p.value for name, p in given.parameters.items()}
    pooled = sum(share**-2 for share in relative.values()) ** -0.5
    assert fit.std["mass"] / given.parameters["mass"].value == pytest.approx(pooled, rel=0.3)


@pytest.mark.parametrize(("stated", "meant"), [("positon_m", " (is position_m meant?)"), ("tilt_rad", "")])
def test_a_sensor_without_its_channel_is_mentioned(tmp_path: Path, stated: str, meant: str) -> None:
    given = plant(tmp_path)
    found = [replace(r, sensors={stated: SensorSpec(noise_std=NOISE_M)}) for r in recordings(given, seed=12)]
    (note,) = absent_channels(prepare(found, given))
    assert note == f"The sidecars' sensors tell of {stated}, but no recording has such a channel{meant}."
    assert not list(absent_channels(prepare(recordings(given, seed=12), given)))
