"""The studies of missions and diagnoses: drawn alike each time, true to what was drawn, told by the command."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from ground.campaign import diagnosis, missions, summary
from ground.campaign.drawing import as_built, generator, nominal_hop_plant
from ground.campaign.study import answer, stamp_of
from ground.cli import app
from hal.errors import ConfigError


def test_a_mission_is_the_same_each_time_and_its_estimates_lie_near_the_truth() -> None:
    found = missions.load_missions(1)
    study = replace(found, ranges=replace(found.ranges, hops=(1, 1), energies_j=(4.0, 5.0)))
    row = answer(study, 3, stamp_of(study)).row
    assert row["failed"] is None
    assert row == answer(study, 3, stamp_of(study)).row
    assert row["completed"] and not study.suspicious(row)
    reference, hop = row["hops"]
    assert (reference["c3"], hop["surface"]) == (None, row["surface"])
    assert abs(hop["height_m"] / hop["height_m_true"] - 1.0) < 0.05
    assert study.run(4)["board_seed"] != row["board_seed"]


def test_a_rig_as_built_lies_within_its_tolerances() -> None:
    nominal = nominal_hop_plant()
    away = []
    for index in range(20):
        drawn = as_built(nominal, 1.5, generator(1, index)).flat()
        for name, parameter in nominal.flat().items():
            if parameter.std and not name.endswith(".chi"):
                away.append((drawn[name].value - parameter.value) / parameter.std)
    assert 1.2 < np.max(np.abs(away)) <= 1.5 + 1e-9
    assert abs(np.mean(away)) < 0.15


def test_what_is_hidden_is_in_the_flown_plant_with_the_drawn_strength(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen: list[Any] = []

    def flown(ranges: object, plant: Any, *rest: object) -> list[Any]:
        seen.append(plant)
        return []

    class Nothing:
        diagnosis = type("Diagnosis", (), {"findings": (), "verdict": "consistent"})

    monkeypatch.setattr(diagnosis, "_flown", flown)
    monkeypatch.setattr(diagnosis, "diagnose", lambda *given, **named: Nothing)
    study = diagnosis.load_diagnosis(1)
    rows = [study.run(index) for index in range(40)]
    kinds = {row["hidden"] for row in rows}
    assert kinds == {"nothing", "soil_rate_dependence", "sleeve_friction", "latch_drag"}
    strengths = {
        "soil_rate_dependence": ("c_g", 45.0),
        "sleeve_friction": ("F_f", 2.5),
        "latch_drag": ("F_d", 25.0),
    }
    for row, plant in zip(rows, seen, strict=True):
        assert row["right"] == (row["hidden"] == "nothing")
        hidden = [use for use in plant.effects if use.physics_id == row["hidden"]]
        assert len(hidden) == (row["hidden"] != "nothing")
        for use in hidden:
            name, value = strengths[row["hidden"]]
            assert use.parameters[name].value == pytest.approx(value * row["size"])
            assert 0.5 <= row["size"] <= 2.0


def test_a_bad_file_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "trials.yaml"
    good = Path(diagnosis.config_path("campaigns", "diagnosis.yaml")).read_text(encoding="utf-8")
    path.write_text(good.replace("strength: c_g", "strength: c_x"), encoding="utf-8")
    with pytest.raises(ConfigError, match=r"hidden\[0\].strength = 'c_x' is none of c_g"):
        diagnosis.load_diagnosis(1, path)
    path.write_text("surfaces: [steel]\n", encoding="utf-8")
    with pytest.raises(ConfigError, match="key hops is missing"):
        missions.load_missions(1, path)


def hop(error: float, verdict: str = "valid") -> dict[str, Any]:
    row: dict[str, Any] = {"hop": 0, "surface": "steel", "energy_j": 5.0, "verdict": verdict}
    for name in missions.QUANTITIES:
        row |= {name: 1.0 + 0.1 * error, f"{name}_sigma": 0.1, f"{name}_true": 1.0}
    return row


def test_the_table_of_missions_counts_what_lies_inside() -> None:
    common = {"failed": None, "surface": "steel", "completed": True}
    hops = [hop(0.0), hop(1.0), hop(-1.0), hop(4.0), hop(90.0, "rejected")]
    rows = [{"index": 0, **common, "hops": hops}, {"index": 1, **common, "completed": False, "hops": []}]
    made = summary.of_missions(rows)
    values = {name: entry["value"] for name, entry in made.figures.items()}
    assert (values["c3_coverage95"], values["c3_mean_error_sigmas"]) == (0.75, pytest.approx(1.0))
    assert (values["missions"], values["completed"], values["hops"], values["valid"]) == (2, 1, 5, 4)
    study = missions.load_missions(1)
    assert [study.suspicious(row) for row in rows] == [False, True]
    assert study.suspicious({**rows[0], "hops": [hop(6.0)]})


def test_the_table_of_diagnoses_counts_what_is_right_and_false_alarms() -> None:
    def row(hidden: str, *said: str) -> dict[str, Any]:
        right = (said[0] if said else "nothing") == hidden
        return {"hidden": hidden, "findings": [{"physics": each} for each in said], "right": right}

    rows = [row("a", "a"), row("a", "b", "a"), row("nothing"), row("nothing", "b")]
    made = summary.of_diagnoses(rows)
    assert {name: entry["value"] for name, entry in made.figures.items() if name.startswith("right")} == {
        "right_a": 0.5,
        "right_nothing": 0.5,
        "right_all": 0.5,
    }
    assert "1 of 2" in made.sentence
    assert made.rows[0][:3] == ("a", "b", "2")


def test_the_command_flies_tells_its_throughput_and_replays(tmp_path: Path) -> None:
    runner, out = CliRunner(), str(tmp_path / "out")
    arguments = ["campaign", "missions", "--count", "1", "--seed", "4", "--out", out, "--processes", "1"]
    done = runner.invoke(app, [*arguments, "--json", str(tmp_path / "f.json")])
    assert done.exit_code == 0, done.output
    assert "1 cases in" in done.stdout and "by 1 workers" in done.stdout
    assert json.loads((tmp_path / "f.json").read_text())["figures"]["missions"] == {"value": 1, "unit": "1"}
    again = runner.invoke(app, arguments)
    assert "all cases were there already" in again.stdout
    replayed = runner.invoke(app, ["campaign", "replay", out, "0"])
    assert replayed.exit_code == 0, replayed.output
    assert json.loads(replayed.stdout)["index"] == 0
    assert "the same as it was kept" in replayed.stderr
    refused = runner.invoke(app, ["campaign", "replay", str(tmp_path / "nowhere"), "0"])
    assert refused.exit_code == 2
    assert "there is no campaign of faults, missions, diagnosis" in refused.stderr
