"""Plant files as labs write them: numbers whose unit nothing states; and a spring that hardens much."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from diagnose_rig import TEXT, plant, recordings

from ground.diagnose.pipeline import diagnose
from ground.diagnose.unlike_units import unstated_units
from sim_hal.plant.simulate import EffectUse, Parameter, load_plant


def test_numbers_without_a_unit_are_taken_and_told(tmp_path: Path) -> None:
    assert unstated_units(plant(tmp_path)) == ()
    path = tmp_path / "numbers.yaml"
    path.write_text(TEXT.replace("stiffness * q", "(stiffness * q + 12.5 * tanh(v / 0.01) * 0)"), "utf-8")
    (note,) = unstated_units(load_plant(path))
    assert "equations: rate of v" in note
    assert "v / 0.01" in note


def test_a_spring_that_hardens_to_many_times_its_stiffness_is_named(tmp_path: Path) -> None:
    given = plant(tmp_path)
    own = given.with_values({"damping": given.parameters["damping"].value})
    cube = EffectUse("progressive_spring", "force_balance", None, {"k_3": Parameter(3.0e3, 0.0, "N/m^3")})
    outcome = diagnose(recordings(own.with_effect(cube), seed=5, samples=400), given).diagnosis
    first = outcome.findings[0]
    assert (first.physics_id, first.equation) == ("progressive_spring", "force_balance")
    assert abs(first.parameters["k_3"].value - 3.0e3) < 3.0 * first.parameters["k_3"].std
    assert len(outcome.findings) == 1


def test_a_spring_that_does_not_harden_is_no_finding(tmp_path: Path) -> None:
    given = plant(tmp_path)
    assert diagnose(recordings(replace(given), seed=5, samples=400), given).diagnosis.verdict == "consistent"
