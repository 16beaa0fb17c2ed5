"""A parameter that differs from run to run is told, and its sigma covers that; where it does not, nothing is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from diagnose_rig import friction, plant, recordings

from ground.diagnose.between_runs import Scatter, beyond_chance, differing, scatter_of, widened
from ground.diagnose.data import Data, prepare
from ground.diagnose.fit import Fit, fit_plant
from ground.diagnose.pipeline import diagnose
from ground.recordings.model import Recording
from sim_hal.plant.simulate import Plant

LEVEL, NAME = "coulomb_friction.F_c", "coulomb_friction.F_c differs from run to run"
FRICTION_N, TRIALS = 0.8, 16


def with_frictions(given: Plant, levels_n: np.ndarray, seed: int) -> list[Recording]:
    """One run of the same rig with each friction."""
    return [
        recordings(given.with_effect(friction(float(level))), seed, count=len(levels_n))[number]
        for number, level in enumerate(levels_n)
    ]


def fitted(given: Plant, between_n: float, seed: int) -> tuple[Data, Fit, tuple[Scatter, ...]]:
    """Four runs whose friction is drawn for each, the fit of three, and what each makes of it."""
    drawn = FRICTION_N + between_n * np.random.default_rng([7, seed]).standard_normal(4)
    data = prepare(with_frictions(given, np.abs(drawn), seed), given)
    model, ranges = given.with_effect(friction(FRICTION_N)), {LEVEL: (0.5, 0.0, 5.0)}
    fit = fit_plant(model, data.windows, data.sigmas, ranges, precise=True)
    return data, fit, scatter_of(fit, [*data.windows, *data.held_out_windows], data.sigmas)


def test_runs_that_agree_are_left_in_peace(tmp_path: Path) -> None:
    given = plant(tmp_path)
    for seed in range(TRIALS):
        data, fit, (one,) = fitted(given, 0.0, seed)
        assert (one.name, one.between, len(one.by_run)) == (LEVEL, 0.0, 4)
        assert widened(fit, (one,), [r.run for r in data.fitted]).std == fit.std
        assert list(differing((one,))) == []


@pytest.mark.parametrize("between_n", [0.05, 0.2])
def test_a_scatter_of_runs_is_told_and_covered(tmp_path: Path, between_n: float) -> None:
    given, off, before, told = plant(tmp_path), [], [], []
    for seed in range(TRIALS):
        data, fit, (one,) = fitted(given, between_n, seed)
        assert next(differing((one,))).startswith(NAME)
        told.append(one.between)
        wide = widened(fit, (one,), [r.run for r in data.fitted])
        off.append(abs(fit.values[LEVEL] - FRICTION_N) / wide.std[LEVEL])
        before.append(abs(fit.values[LEVEL] - FRICTION_N) / fit.std[LEVEL])
    assert 0.7 * between_n < np.sqrt(np.mean(np.square(told))) < 1.4 * between_n
    assert np.mean(np.array(off) < 1.0) >= 0.5  # of 16 at 68 %, below half once in a thousand times
    assert np.mean(np.array(off) < 3.0) >= 0.8
    assert np.mean(np.array(before) < 1.0) < 0.5  # what a fit alone says of itself


def test_the_scatter_is_what_the_sigmas_leave() -> None:
    assert beyond_chance([(1.0, 0.1), (1.1, 0.1), (0.9, 0.1)]) == 0.0
    # DerSimonian and Laird with equal sigmas: the values' variance less that of each
    assert beyond_chance([(1.0, 0.1), (3.0, 0.1), (5.0, 0.1)]) == pytest.approx(np.sqrt(4.0 - 0.01))


def test_of_several_the_farthest_apart_is_named_and_the_others_in_its_place() -> None:
    drag = Scatter("drag.d", "N*s/m", {"a": (1.0, 0.01), "b": (2.0, 0.01)}, 0.7)
    lift = Scatter("lift.B", "N", {"a": (0.1, 0.1), "b": (2.0, 0.1)}, 1.3)
    (told,) = differing((lift, drag))
    assert told.startswith("drag.d differs from run to run: 1 ± 0.01 in a and 2 ± 0.01 in b [N*s/m]")
    assert told.endswith("Told in place of it, lift.B would differ instead.")


def test_one_recording_tells_nothing_of_runs(tmp_path: Path) -> None:
    given = plant(tmp_path)
    data = prepare(recordings(given.with_effect(friction(FRICTION_N)), seed=3, count=1), given)
    model = given.with_effect(friction(FRICTION_N))
    fit = fit_plant(model, data.windows, data.sigmas, {LEVEL: (0.5, 0.0, 5.0)})
    assert scatter_of(fit, data.windows, data.sigmas) == ()


def test_a_diagnosis_says_so(tmp_path: Path) -> None:
    given = plant(tmp_path)
    seen = with_frictions(given, np.array([0.7, 0.9]), seed=4)
    answer = diagnose(seen, given).diagnosis
    assert answer.findings[0].physics_id == "coulomb_friction"
    assert any(note.startswith(NAME) for note in answer.notes)
    assert answer.findings[0].parameters["F_c"].std > 0.1
    (told,) = answer.details["between_runs"]
    assert [one["value"] for one in told["runs"].values()] == pytest.approx([0.7, 0.9], abs=0.03)
