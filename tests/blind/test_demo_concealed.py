"""The demonstration in small: what hides inside a normal C3 is found, flown with, and predicts hops better."""

from __future__ import annotations

import html
from dataclasses import replace
from pathlib import Path

import pytest

from ground.demo_concealed import NOTHING, WAYS, demonstrate, load_scenario
from ground.report.concealed_page import write_concealed_page
from ground.report.concealed_tables import content_of, rehearsed_rows, sentence
from hal.errors import ConfigError


def test_physics_inside_a_normal_c3_is_found_and_predicts_the_next_hops_better(tmp_path: Path) -> None:
    scenario = replace(load_scenario(), learning_energies_j=(7.0, 16.0, 11.0), next_energies_j=(13.5,))
    result = demonstrate(tmp_path, "soil_rate_dependence", seed=2, scenario=scenario)
    assert result.looks_normal
    assert max(abs(gap) for gap in result.closes_by) < 0.05
    assert result.found
    assert result.error("plant found", "height_m") < 0.3 * result.error("refitted nominal plant", "height_m")
    assert result.error("plant found", "height_m") < 0.3 * result.error("lumped C2 and C3", "height_m")
    ((robot, simulated),) = zip(result.later, result.rehearsed, strict=True)
    assert robot.report.c3 is not None
    assert simulated.report.c3 is not None
    assert simulated.report.c3.value == pytest.approx(robot.report.c3.value, abs=0.01)
    page = write_concealed_page(result, tmp_path / "concealed.html").read_text(encoding="utf-8")
    assert html.escape(sentence(result)) in page
    assert len(rehearsed_rows(result)[1]) == len(content_of(result)["c3_rehearsed"]) == 1


def test_what_the_demonstration_cannot_hide_is_refused_with_what_it_can(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=f"can hide is .*{NOTHING}"):
        demonstrate(tmp_path, "gremlins")
    assert set(WAYS) == {"lumped C2 and C3", "refitted nominal plant", "plant found"}
