"""The worked example of docs/add-physics.md, carried out as written: a package outside of ours adds an effect."""

from __future__ import annotations

import re
import runpy
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from sim_hal.plant.simulate import PlantError, catalogue, load_plant

MANUAL = Path(__file__).resolve().parents[2] / "docs" / "add-physics.md"


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", MANUAL.read_text(), re.S)


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder on the path that holds what `pip install .` puts there: the module and its metadata."""
    (tmp_path / "eddy_brake.py").write_text(blocks("python")[0])
    project = tomllib.loads(blocks("toml")[0])["project"]
    metadata = tmp_path / "eddy_brake-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: 1.0\n")
    lines = [
        f"[{group}]\n" + "".join(f"{name} = {where}\n" for name, where in points.items())
        for group, points in project["entry-points"].items()
    ]
    (metadata / "entry_points.txt").write_text("\n".join(lines))
    (tmp_path / "sled.yaml").write_text(blocks("yaml")[0])
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "eddy_brake", raising=False)
    catalogue.cache_clear()
    yield tmp_path
    monkeypatch.undo()
    catalogue.cache_clear()


def test_the_worked_example_prints_what_it_says(installed: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "eddy_current_brake" in catalogue()
    (installed / "try_it.py").write_text(blocks("python")[1])
    runpy.run_path(str(installed / "try_it.py"))
    said = capsys.readouterr().out.strip()
    assert f"`{said}`" in MANUAL.read_text()
    assert f"{3.0 * 2 * 2.5 / (1 + 2.5**2) / 2.0:.3f} m/s²" in said


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "eddy_current_brake",
            "coulomb_friction",
            "entry point eddy_brake: effect 'coulomb_friction' exists already",
        ),
        ("EDDY_BRAKE =", "BRAKE =", "entry point eddy_brake of hopper.effects: .*EDDY_BRAKE"),
        (
            "EDDY_BRAKE =",
            "EDDY_BRAKE = 3 if True else",
            "entry point eddy_brake of hopper.effects names 3, not an Effect",
        ),
        ("v_c", "v_c + ", "entry point eddy_brake of hopper.effects: "),
    ],
)
def test_a_bad_package_is_refused_with_its_entry_point(
    installed: Path, old: str, new: str, words: str
) -> None:
    source = installed / "eddy_brake.py"
    source.write_text(source.read_text().replace(old, new) + ("(" if "+" in new else ""))
    catalogue.cache_clear()
    with pytest.raises(PlantError, match=words):
        catalogue()


def test_without_the_package_the_plant_file_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "sled.yaml").write_text(blocks("yaml")[0])
    with pytest.raises(PlantError, match=r"sled\.yaml: physics_id 'eddy_current_brake' is not known"):
        load_plant(tmp_path / "sled.yaml")
