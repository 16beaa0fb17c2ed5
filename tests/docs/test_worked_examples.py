"""The worked examples of the documentation do what the pages say, and the pages are true to the code."""

from __future__ import annotations

import importlib
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from typer.testing import CliRunner

from flight.surface.known import load_surfaces
from ground.cli import app
from ground.physics_table import PAGE, with_table
from hal.board import open_board
from hal.config import config_path

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"


def blocks(page: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", (DOCS / page).read_text(encoding="utf-8"), re.DOTALL)


def printed(page: str, after: str) -> str:
    """The untagged block that follows some words."""
    text = (DOCS / page).read_text(encoding="utf-8")
    found = re.search(r"```\n(.*?)```", text[text.index(after) :], re.DOTALL)
    assert found is not None
    return found.group(1)


def run(code: str, folder: Path) -> str:
    environment = {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{folder}"}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_surface_of_your_own(tmp_path: Path) -> None:
    assert run(blocks("add-surface.md", "python")[0], tmp_path) == printed("add-surface.md", "prints")
    row = blocks("add-surface.md", "yaml")[0]
    table = config_path("surfaces.yaml").read_text(encoding="utf-8")
    (tmp_path / "surfaces.yaml").write_text(
        table.replace("unknown_probability", f"  {row}unknown_probability")
    )
    assert load_surfaces(tmp_path / "surfaces.yaml").surfaces[-1].name == "gravel"


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """What `pip install .` of the sensor's example leaves on the path."""
    sensor, board, _ = blocks("add-board.md", "python")
    (tmp_path / "potentiometer.py").write_text(f"{sensor}\n\n{board}")
    metadata = tmp_path / "sim_potentiometer-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: sim-potentiometer\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(
        "[hopper.boards]\nsim_potentiometer = potentiometer:open_board_with_potentiometer\n"
    )
    (tmp_path / "wiring.yaml").write_text(blocks("add-board.md", "yaml")[0])
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "potentiometer", raising=False)
    importlib.invalidate_caches()
    yield tmp_path


def test_a_sensor_and_a_board_of_your_own(installed: Path) -> None:
    with open_board("sim_potentiometer", {"potentiometer": {"zero_v": 0.5, "m_per_v": 0.016}}) as board:
        board.clock.sleep_until_s(0.05)
        position_m = board.nut_encoder.read().position_m
    steps = (position_m / 0.016 + 0.5) / (5.0 / 4096)
    assert abs(steps - round(steps)) < 1e-6  # of the converter
    page = (DOCS / "add-board.md").read_text(encoding="utf-8")
    fly = blocks("add-board.md", "python")[2]
    assert f"prints `{run(fly, installed).strip()}`" in page
    module = (installed / "potentiometer.py").read_text()
    (installed / "potentiometer.py").write_text(module.replace("5.0 / 4096", "5.0 / 65536"))
    assert f"it prints `{run(fly, installed).strip()}`" in page


def test_a_rig_of_your_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    plant, sidecar = blocks("add-rig.md", "yaml")
    (tmp_path / "pendulum.yaml").write_text(plant)
    (tmp_path / "swing.yaml").write_text(sidecar)
    times_s = np.arange(0.0, 10.0, 0.01)
    angle_rad = solve_ivp(
        lambda _, x: [x[1], -9.81 / 0.5 * np.sin(x[0]) - 0.02 * x[1] / 0.5**2],
        (0.0, 10.0),
        [0.3, 0.0],
        t_eval=times_s,
        rtol=1e-10,
        atol=1e-12,
    ).y[0]
    measured = angle_rad + np.random.default_rng(1).normal(0.0, 2e-4, times_s.size)
    rows = "".join(f"{t!r},{a!r}\n" for t, a in zip(times_s.tolist(), measured.tolist(), strict=True))
    (tmp_path / "swing.csv").write_text(f"time_s,angle_rad\n{rows}")
    for line in blocks("add-rig.md", "sh")[0].splitlines():
        done = CliRunner().invoke(app, line.split()[1:])
        assert done.exit_code == 0, done.output
    (finding,) = json.loads((tmp_path / "out/pendulum/diagnosis.json").read_text())["findings"]
    assert finding["physics_id"] == printed("add-rig.md", "calls it by name").strip()


def test_the_notebook_finds_what_was_hidden(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, str(DOCS / "examples" / "notebook.py"), str(tmp_path)],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    said = done.stdout.splitlines()
    assert said[1].startswith("coulomb_friction: Dry friction of 1.5 ±")
    assert said[-1] == "with it, the simulation is 0.1 mm off (rms)"
    assert said[0] in (DOCS / "notebook.md").read_text() and said[1] in (DOCS / "notebook.md").read_text()
    assert (tmp_path / "after.html").stat().st_size > 1_000_000
    assert (tmp_path / "diagnosis" / "report.html").is_file()


def test_the_catalogue_on_the_page_is_that_of_the_code() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert page == with_table(page), "bring it up to date: python -m ground.physics_table"


@pytest.mark.parametrize("page", ["safety-case.md", "safety.md", "architecture.md", "tour.md", "flight.md"])
def test_files_that_the_pages_name_are_there(page: str) -> None:
    text = (DOCS / page).read_text(encoding="utf-8")
    paths = re.findall(r"`((?:tests|flight|ground|hal|sim_hal|config)/[\w/.*]+\.(?:py|yaml))`", text)
    assert paths
    missing = [path for path in paths if not list(ROOT.glob(path))]
    assert missing == []


def test_the_site_builds_with_every_link(tmp_path: Path) -> None:
    pytest.importorskip("material", reason="mkdocs-material is not installed (extra 'docs')")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")],
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "site" / "index.html").read_text(encoding="utf-8")
    fetched = re.findall(r'(?:src|href)="(https?://[^"]+)"', page)
    assert [each for each in fetched if "squidfunk" not in each] == []
