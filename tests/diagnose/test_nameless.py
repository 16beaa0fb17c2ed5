"""A force that no name fits gets a formula with its unit, and none is made up where nothing is missing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from diagnose_rig import NOISE_M, plant, recordings

from ground.diagnose.evidence import LocatedForce
from ground.diagnose.formula import formula_candidate, sparse_law
from ground.diagnose.pipeline import diagnose
from sim_hal.plant.simulate import EffectUse, Parameter, Run, compile_plant, load_plant, save_plant


def located(force: np.ndarray, std: float, speed: np.ndarray, position: np.ndarray) -> LocatedForce:
    times = np.linspace(0.0, 10.0, force.size)
    noise = std * np.random.default_rng(4).standard_normal(force.size)
    causes = {"velocity": speed, "position": position, "time": times}
    return LocatedForce(
        "force_balance", "run", "N", times, force + noise, np.full(force.size, std), None, causes, {}, 100.0
    )


def motion() -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(7)
    return generator.uniform(-2.0, 2.0, 300), generator.uniform(-0.5, 0.5, 300)


def test_a_planted_law_is_found_with_its_coefficients_and_units(tmp_path: Path) -> None:
    speed, position = motion()
    force = located(-0.7 * speed**3 + 5.0 * position**2, 0.05, speed, position)
    law = sparse_law(force)
    assert law is not None
    candidate = formula_candidate(plant(tmp_path), force.equation, law)
    use = candidate.uses[0]
    found = dict(zip((use.law or "").split(" + "), use.parameters.values(), strict=True))
    terms = {text.split(" * ", 1)[1]: parameter for text, parameter in found.items()}
    assert terms.keys() == {"v ** 3", "x ** 2"}
    assert abs(terms["v ** 3"].value + 0.7) < 0.02
    assert abs(terms["x ** 2"].value - 5.0) < 0.2


def test_no_law_is_made_up_for_noise(tmp_path: Path) -> None:
    speed, position = motion()
    assert sparse_law(located(np.zeros(300), 0.05, speed, position)) is None


def test_a_law_of_its_own_is_simulated_and_kept_in_the_plant_file(tmp_path: Path) -> None:
    given = plant(tmp_path)
    damping = {"a_1": Parameter(-0.4, 0.01, "N*s/m")}
    extended = given.with_effect(EffectUse("unlisted", "force_balance", None, damping, "a_1 * v"))
    save_plant(extended, tmp_path / "extended.yaml")
    assert load_plant(tmp_path / "extended.yaml").effects == extended.effects
    stiffer = given.with_values({"damping": given.parameters["damping"].value + 0.4})
    run = Run(np.array([0.0, 0.1]), {"push_n": np.zeros(2)}, first_samples={"position_m": np.zeros(20)})
    rates = []
    for changed in (extended, stiffer):
        compiled = compile_plant(changed)
        rates.append(compiled.rates(compiled.values, run, 0.0, np.array([0.1, 0.3])))
    assert rates[0] == pytest.approx(rates[1], rel=1e-12)


def test_a_law_that_is_in_no_catalogue_is_told_by_a_formula_alone(tmp_path: Path) -> None:
    """A name that is near to it takes a part of it first; the formula then stands in its stead."""
    given = plant(tmp_path)
    law, strength = "a_1 * x ** 2 * v", -60.0
    hidden = EffectUse("unlisted", "force_balance", None, {"a_1": Parameter(strength, 0.0, "N*s/m^3")}, law)
    found = diagnose(recordings(given.with_effect(hidden), seed=3), given).diagnosis
    assert found.verdict == "mismatch"
    (finding,) = found.findings
    assert (finding.physics_id, finding.formula) == ("unlisted", law)
    size = finding.parameters["a_1"]
    assert abs(size.value - strength) < 3.0 * size.std < 0.02 * abs(strength)
    assert finding.probability > 0.8
    assert f"follows {law}, with a_1 = -59." in finding.statement
    assert finding.statement.endswith("N*s/m^3.")
    errors = found.details["windowed_rms"]["position_m"]
    assert errors["extended"] < 1.3 * NOISE_M < 0.1 * errors["refit"]
