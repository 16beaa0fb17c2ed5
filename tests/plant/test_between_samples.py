"""How inputs run between samples: the spline is the textbook's, and it is the same plant at the samples."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from sim_hal.plant.between import PARTS, cubic, subdivided
from sim_hal.plant.run import bridged
from sim_hal.plant.simulate import Run, compile_plant, load_plant, save_plant

TEXT = """
format: 1
name: integrator
kind: equations
inputs:
  push_n: {unit: N, interpolation: cubic}
states:
  p: {unit: N*s, initial: 0}
equations:
  momentum: {state: p, rate: "push_n"}
outputs:
  impulse_n_s: {value: "p"}
"""


@settings(max_examples=50, deadline=None)
@given(
    samples=st.lists(st.floats(-100.0, 100.0), min_size=3, max_size=60),
    seed=st.integers(0, 1000),
)
def test_the_spline_is_the_natural_one_at_any_spacing(samples: list[float], seed: int) -> None:
    generator = np.random.default_rng(seed)
    times = np.cumsum(generator.uniform(0.2, 2.0, len(samples)))
    at = np.sort(generator.uniform(times[0], times[-1], 200))
    values = np.array(samples)
    theirs = CubicSpline(times, values, bc_type="natural")(at)
    np.testing.assert_allclose(cubic(at, times, values), theirs, atol=1e-9 * (1.0 + np.abs(values).max()))


def test_outside_and_where_too_little_is_there_nothing_is_made_up() -> None:
    times, values = np.array([0.0, 1.0, 3.0]), np.array([1.0, 4.0, -2.0])
    assert cubic(np.array([-5.0, 9.0]), times, values).tolist() == [1.0, -2.0]
    np.testing.assert_array_equal(cubic(np.array([0.5]), times[:2], values[:2]), [2.5])
    np.testing.assert_array_equal(cubic(np.array([0.5]), times[:1], values[:1]), [1.0])


def test_pieces_end_at_every_sample() -> None:
    times = np.array([0.0, 1.0, 1.5, 4.0])
    pieces = subdivided(times)
    np.testing.assert_array_equal(pieces[::PARTS], times)
    assert np.all(np.diff(pieces) > 0.0)


def test_a_rig_follows_a_smooth_input_far_better_than_by_straight_lines(tmp_path: Path) -> None:
    """A sine of five samples a cycle, integrated: straight lines lose sinc squared of it."""
    (tmp_path / "rig.yaml").write_text(TEXT, encoding="utf-8")
    smooth = load_plant(tmp_path / "rig.yaml")
    times, pulse = 0.1 * np.arange(101), 2.0 * np.pi * 2.0
    truth = (1.0 - np.cos(pulse * times)) / pulse
    run = Run(times, {"push_n": np.sin(pulse * times)})
    errors = {}
    for kind in ("hold", "linear", "cubic"):
        compiled = compile_plant(smooth.with_interpolation(kind))
        impulse = compiled.run(compiled.values, run)[:, 0]
        errors[kind] = float(np.std((impulse - truth)[10:-10]))
    assert errors["cubic"] < 0.2 * errors["linear"] < 0.2 * errors["hold"]


@pytest.mark.parametrize("kind", ["hold", "linear", "cubic"])
def test_a_plant_keeps_its_interpolation_in_its_file(tmp_path: Path, kind: str) -> None:
    (tmp_path / "rig.yaml").write_text(TEXT, encoding="utf-8")
    changed = load_plant(tmp_path / "rig.yaml").with_interpolation(kind)
    save_plant(changed, tmp_path / "changed.yaml")
    assert load_plant(tmp_path / "changed.yaml").structure == changed.structure


def test_missing_samples_are_bridged(tmp_path: Path) -> None:
    (tmp_path / "rig.yaml").write_text(TEXT, encoding="utf-8")
    compiled = compile_plant(load_plant(tmp_path / "rig.yaml"))
    times = 0.1 * np.arange(101)
    push = np.sin(times)
    gappy = push.copy()
    gappy[[20, 21, 50, 77]] = np.nan
    whole, bridged = (compiled.run(compiled.values, Run(times, {"push_n": u})) for u in (push, gappy))
    np.testing.assert_allclose(bridged, whole, atol=1e-4)


@pytest.mark.parametrize(("kind", "near"), [("hold", 1e-9), ("linear", 1e-9), ("cubic", 1e-4)])
def test_any_part_of_a_bridged_run_runs_as_the_whole_does(tmp_path: Path, kind: str, near: float) -> None:
    """Also a part that has no reading of its own: the force that is missing is looked for from sample to sample."""
    (tmp_path / "rig.yaml").write_text(TEXT, encoding="utf-8")
    plant = load_plant(tmp_path / "rig.yaml").with_interpolation(kind)
    compiled = compile_plant(plant)
    times = 0.1 * np.arange(101)
    push = np.where(np.isin(np.arange(101), [40, 41, 42]), np.nan, np.sin(times))
    run = Run(times, {"push_n": push})
    whole = bridged(plant.structure, run)
    np.testing.assert_allclose(
        compiled.run(compiled.values, whole), compiled.run(compiled.values, run), atol=near
    )
    part = Run(times[41:42], {"push_n": whole.inputs["push_n"][41:42]})
    assert np.isfinite(compiled.run(compiled.values, part)).all()
