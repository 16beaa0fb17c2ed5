"""What an effect must do to be claimed: not at the edge of being another law, and better where nothing was fitted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from diagnose_rig import friction, plant, recordings
from pushed_mass import pushed_mass

from ground.diagnose.accept import degenerate
from ground.diagnose.candidates import Candidate, EffectCandidate, effect_candidates, ranges_of
from ground.diagnose.chosen import Chosen, Named
from ground.diagnose.confirm import HeldOutViews, confirmed, failing, holds
from ground.diagnose.data import Data, prepare
from ground.diagnose.findings import told_where
from ground.diagnose.fit import Fit, fit_plant, robust_covariance
from ground.diagnose.name import Search
from ground.diagnose.outlook import Outlook
from ground.diagnose.pipeline import diagnose
from ground.diagnose.released import released_parameters
from ground.diagnose.result import Diagnosis
from ground.diagnose.scales import find_scales
from ground.diagnose.segments import sensor_sigma
from ground.diagnose.workers import Workers
from ground.recordings.model import Recording, SensorSpec
from sim_hal.plant.simulate import EffectUse, Parameter, Plant, Run, compile_plant, load_plant

RIGS = Path(__file__).parents[2] / "benchmarks" / "rigs"


def refitted(given: Plant, truth: Plant, seed: int) -> tuple[Data, Fit]:
    data = prepare(recordings(truth, seed, count=4), given)
    return data, fit_plant(given, data.windows, data.sigmas, {})


def with_effect(physics_id: str, data: Data, refit: Fit, start: int = 0) -> tuple[EffectCandidate, Fit]:
    scales = find_scales(refit, data.windows)
    candidate = next(c for c in effect_candidates(refit.plant, scales) if c.physics_id == physics_id)
    larger = candidate.joined(refit.plant, start)
    ranges = ranges_of(larger, scales)
    return candidate, fit_plant(larger, data.windows, data.sigmas, ranges, tolerance=1e-6, precise=True)


@pytest.mark.parametrize(("build_up_m", "shapes_at_edge"), [(None, 1), (4e-3, 0)])
def test_a_friction_that_builds_up_at_once_is_at_the_edge_of_being_dry_friction(
    tmp_path: Path, build_up_m: float | None, shapes_at_edge: int
) -> None:
    given = plant(tmp_path)
    springy = {"F_d": Parameter(1.0, 0.0, "N"), "s_p": Parameter(build_up_m or 1.0, 0.0, "m")}
    presliding = EffectUse("presliding_hysteresis", "force_balance", None, springy)
    data, refit = refitted(given, given.with_effect(presliding if build_up_m else friction(1.0)), seed=5)
    candidate, fit = with_effect("presliding_hysteresis", data, refit)
    assert degenerate(candidate, fit) == shapes_at_edge


@pytest.mark.parametrize("level_n", [0.0, 0.8])
def test_what_was_held_out_confirms_an_effect_that_is_there_and_no_other(
    tmp_path: Path, level_n: float
) -> None:
    """The search ends with friction, at the strength that was fitted or, where there is none, at a wrong one."""
    given = plant(tmp_path)
    truth = given.with_effect(friction(level_n)) if level_n else given
    data, refit = refitted(given, truth, seed=6)
    candidate, fit = with_effect("coulomb_friction", data, refit)
    if not level_n:  # what an unlucky search may end with
        fit = fit_plant(given.with_effect(friction(0.3)), data.windows, data.sigmas, {})
    with Workers(data.windows, data.sigmas, find_scales(refit, data.windows), 1) as workers:
        search = Search(workers, Outlook(), given, workers.context.scales)
        one = Chosen(candidate, 1.0, (), {}, (), refit.chi2, absent=refit)
        named = Named(fit, (one,), (), ())
        unseen = HeldOutViews(data.held_out_windows, data.held_out_whole)
        kept, failed = confirmed(named, search, unseen)
        assert holds(named, search, unseen) == bool(level_n)
    assert bool(kept.chosen) == bool(level_n)
    assert bool(failed) != bool(level_n)


def test_an_effect_without_which_nothing_can_be_predicted_is_kept(tmp_path: Path) -> None:
    """Dry friction beside a stretch with less of it: without the first, the second would push."""
    given = plant(tmp_path)
    truth = given.with_effect(friction(0.8))
    data, refit = refitted(given, truth, seed=6)
    candidate, fit = with_effect("coulomb_friction", data, refit)
    less = {
        "F_p": Parameter(-0.3, 0.0, "N"),
        "x_p": Parameter(0.0, 0.0, "m"),
        "w_p": Parameter(1.0, 0.0, "m"),
    }
    pushes = EffectUse("position_dependent_friction", "force_balance", None, less)
    absent = replace(refit, plant=refit.plant.with_effect(pushes))
    with Workers(data.windows, data.sigmas, find_scales(refit, data.windows), 1) as workers:
        search = Search(workers, Outlook(), given, workers.context.scales)
        named = Named(fit, (Chosen(candidate, 1.0, (), {}, (), refit.chi2, absent=absent),), (), ())
        assert holds(named, search, HeldOutViews(data.held_out_windows, data.held_out_whole))


@pytest.mark.parametrize("there", [True, False])
def test_what_no_window_feels_must_not_carry_a_whole_recording_away(tmp_path: Path, there: bool) -> None:
    """A force so small that every window, anchored anew, bears with it; it carries a whole recording far away."""
    stiff = plant(tmp_path)
    soft = {"stiffness": Parameter(0.2, 0.01, "N/m"), "damping": Parameter(0.05, 0.01, "N*s/m")}
    given = replace(stiff, parameters={**stiff.parameters, **soft})
    small = EffectUse("asymmetric_friction", "force_balance", None, {"F_o": Parameter(2e-4, 0.0, "N")})
    truth = given.with_effect(small) if there else given
    data = prepare(recordings(truth, seed=8, count=4, samples=900), given)
    refit = fit_plant(given, data.windows, data.sigmas, {})
    candidate, _ = with_effect("asymmetric_friction", data, refit)
    fit = replace(refit, plant=refit.plant.with_effect(small))
    one = Chosen(candidate, 1.0, (), {}, (), refit.chi2, absent=refit)
    views = HeldOutViews(data.held_out_windows, data.held_out_whole).views
    with Workers(data.windows, data.sigmas, find_scales(refit, data.windows), 1) as workers:
        search = Search(workers, Outlook(), given, workers.context.scales)
        found = [failing(Named(fit, (one,), (), ()), search, *view) for view in views]
    assert found == [None, None if there else one]


@pytest.mark.parametrize("processes", [1, 2])
def test_of_rivals_that_fit_alike_the_simple_one_takes_the_place(tmp_path: Path, processes: int) -> None:
    """Dry friction was taken for viscous; laws that hold dry friction as a limit fit as well as that, or by a hair
    better. The rivals know no identity of their own: workers hand back copies."""
    given = plant(tmp_path)
    data, refit = refitted(given, given.with_effect(friction(0.8)), seed=7)
    wrong, fit = with_effect("viscous_friction", data, refit)
    names = ("presliding_hysteresis", "stribeck_friction", "coulomb_friction")
    offered = effect_candidates(refit.plant, find_scales(refit, data.windows))
    rivals = tuple(next(c for c in offered if c.physics_id == name) for name in names)
    with Workers(data.windows, data.sigmas, find_scales(refit, data.windows), processes) as workers:
        search = Search(workers, Outlook(), given, workers.context.scales)
        one = Chosen(wrong, 1.0, rivals, {}, (), refit.chi2, absent=refit)
        _, (first, _) = search.replace_earlier(fit, [one, replace(one, candidate=rivals[0])])
        outdone = search.contest(fit, one).outdone_by(frozenset())
    assert first.candidate.key == rivals[2].key
    assert [c.key for c in first.rivals] == [wrong.key, rivals[0].key, rivals[1].key]
    assert outdone is not None and outdone[0].key == rivals[2].key


@pytest.mark.parametrize("noise_m", [1e-6, 1e-4, 1e-2])
@pytest.mark.parametrize("per_cycle", [12, 50, 400])
def test_the_sensors_noise_is_read_from_the_readings(tmp_path: Path, noise_m: float, per_cycle: int) -> None:
    given = plant(tmp_path)
    bare = Plant(**{**vars(given), "sensors": {}})
    generator = np.random.default_rng(3)
    times = 0.01 * np.arange(6000)
    reading = 0.05 * np.sin(2.0 * np.pi * np.arange(6000) / per_cycle)
    noisy = reading + noise_m * generator.standard_normal(times.size)
    channels = {"push_n": 0.0 * times, "position_m": noisy}
    run = Recording(times, channels, run="run", rig="oscillator", kind="bench")
    assert sensor_sigma([run], bare, "position_m") == pytest.approx(noise_m, rel=0.15)


def test_a_delay_that_is_told_only_to_a_sample_is_found_all_the_same(tmp_path: Path) -> None:
    """A reading that moves at samples only looks the same for any delay below one: its size has no sigma."""
    given = pushed_mass(tmp_path)
    truth = given.with_effect(
        EffectUse("sensor_delay", "sensor", "acceleration_m_s2", {"delay": Parameter(4e-3, 0.0, "s")})
    )
    assert [f.physics_id for f in answer(given, truth).findings] == ["sensor_delay"]
    assert answer(given, given).verdict == "consistent"


def answer(given: Plant, truth: Plant) -> Diagnosis:
    generator = np.random.default_rng(8)
    compiled = compile_plant(truth)
    column = compiled.output_names.index("acceleration_m_s2")
    times = 5e-3 * np.arange(300)
    runs = []
    for number in range(4):
        push = np.repeat(generator.uniform(-6.0, 6.0, 30), 10)
        clean = compiled.run(compiled.values, Run(times, {"push_n": push}))[:, column]
        noisy = clean + 0.05 * generator.standard_normal(times.size)
        channels = {"push_n": push, "acceleration_m_s2": noisy}
        sensors = {"acceleration_m_s2": SensorSpec(noise_std=0.05)}
        runs.append(
            Recording(times, channels, run=f"run_{number}", rig="pushed_mass", kind="bench", sensors=sensors)
        )
    return diagnose(runs, given, lambda *_: None).diagnosis


@pytest.mark.parametrize(
    ("rival", "sure"),
    [("quadratic_friction", True), ("sensor_bias", False), ("parameter_out_of_tolerance", True)],
)
def test_an_open_name_is_a_mismatch_still_and_an_open_kind_is_not(
    tmp_path: Path, rival: str, sure: bool
) -> None:
    """Two laws, or a law and a parameter, say where the plant is wrong; a law and a fault of a sensor do not."""
    given = plant(tmp_path)
    data, refit = refitted(given, given, seed=7)
    candidates: list[Candidate] = [*effect_candidates(given, find_scales(refit, data.windows))]
    candidates += released_parameters(given, given)
    found = {c.physics_id: c for c in candidates}
    weights = ((found["viscous_friction"], 0.45), (found[rival], 0.45))
    one = Chosen(found["viscous_friction"], 1.0, (), {}, weights)
    assert told_where(one, given) == pytest.approx(0.9 if sure else 0.45)


def test_what_the_taxonomy_calls_otherwise_may_enter_the_same_balance() -> None:
    """Drag belongs to the flight, friction to the drive; an axis has one balance for both."""
    axis = load_plant(RIGS / "axis.yaml")
    scales = {"force_balance": {"X": 0.1, "V": 1.0, "F": 1.0, "T": 1.0, "D": 1.0}}
    found = {c.physics_id: c for c in effect_candidates(axis, scales)}
    drag, friction = found["aerodynamic_drag_quadratic"], found["quadratic_friction"]
    assert drag.equation != friction.equation
    assert drag.place(axis) == friction.place(axis) == (None, "force_balance")


@pytest.mark.filterwarnings("error")
def test_no_sigma_is_lost_where_the_information_is_all_but_singular(tmp_path: Path) -> None:
    """Columns that nearly repeat each other, and residuals that rounding lets cancel in the scores."""
    given = plant(tmp_path)
    data, _ = refitted(given, given, seed=9)
    rows = sum(segment.observed.size for segment in data.windows)
    generator = np.random.default_rng(9)
    one = generator.standard_normal(rows)
    for closeness in (1e-6, 1e-9, 1e-12, 0.0):
        jacobian = 1e6 * np.column_stack([one, one + closeness * generator.standard_normal(rows), one])
        for residuals in (generator.standard_normal(rows), np.zeros(rows), 1e8 * one):
            covariance = robust_covariance(jacobian, residuals, np.zeros(3), data.windows)
            assert np.isfinite(np.sqrt(np.diag(covariance))).all()
