"""Machine code of flight and simulation: the same to the bit as the sources, and none where these have changed."""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

import flight
from ground import compiling
from ground.cli import app
from hal import compiled
from hal.errors import ConfigError

ROOT = Path(flight.__file__).resolve().parents[1]

LOAD = compiled._load
MISSION = """
import sys
from pathlib import Path
import flight, sim_hal, flight.monitors
from flight import settings as flight_settings
from ground.mission_run import plan_mission, run_mission

run_mission(plan_mission("quartz_sand", 1, 6.0, flight_settings.load()), Path(sys.argv[1]), seed=5)
print(flight.COMPILED, sim_hal.COMPILED, "machine_code" in flight.monitors.__file__)
"""

needs_machine_code = pytest.mark.skipif(
    not all(compiled.fits(ROOT / package) for package in ("flight", "sim_hal")),
    reason="there is no machine code of these sources (`hopper compile`)",
)


def fly(switch: str, folder: Path) -> str:
    """Fly in a process of its own; whether that was as machine code."""
    command = [sys.executable, "-c", MISSION, str(folder)]
    environment = {**os.environ, compiled.SWITCH: switch}
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.strip()


@needs_machine_code
def test_a_mission_as_machine_code_is_the_same_to_the_bit(tmp_path: Path) -> None:
    assert fly("1", tmp_path / "code") == "True True True"
    assert fly("0", tmp_path / "sources") == "False False False"
    logs = [(tmp_path / name / "flight.mcap").read_bytes() for name in ("code", "sources")]
    assert len(logs[0]) > 100_000
    assert logs[0] == logs[1]


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package with machine code of its sources, beside a `hal`; its library is no real one, and loads."""
    monkeypatch.setenv(compiled.SWITCH, "1")
    monkeypatch.setattr(compiled, "_load", lambda name, path: path.read_bytes())
    for name in ("leaping", "hal"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("", encoding="utf-8")
    made = compiled.folder_of(tmp_path / "leaping")
    made.mkdir(parents=True)
    (made / f"{compiled.library_of('leaping')}{compiled.SUFFIX}").write_bytes(b"no real one")
    (made / compiled.MANIFEST).write_text(
        json.dumps(compiled.made_of(tmp_path / "leaping")), encoding="utf-8"
    )
    return tmp_path / "leaping"


def preferred(package: Path) -> list[str]:
    """Where the package looks for its modules, in a process that reads its sources anew."""
    compiled._checksum.cache_clear()
    path = [str(package)]
    assert compiled.prefer("leaping", path) == (len(path) == 2)
    return path


def test_machine_code_of_these_sources_is_found_first(package: Path) -> None:
    assert preferred(package) == [str(compiled.folder_of(package)), str(package)]


@pytest.mark.parametrize("changed", ["leaping/__init__.py", "leaping/parts/new.py", "hal/__init__.py"])
def test_a_changed_source_runs_and_not_what_was_made_of_another(package: Path, changed: str) -> None:
    path = package.parent / changed
    path.parent.mkdir(exist_ok=True)
    path.write_text("CHANGED = True\n", encoding="utf-8")
    assert preferred(package) == [str(package)]


def test_the_switch_leaves_machine_code_aside(package: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(compiled.SWITCH, "0")
    assert preferred(package) == [str(package)]


def test_damaged_machine_code_is_left_aside(package: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = compiled.folder_of(package)
    with monkeypatch.context() as real:
        real.setattr(compiled, "_load", LOAD)
        assert preferred(package) == [str(package)]  # the library is none
    (made / compiled.MANIFEST).write_text("{", encoding="utf-8")
    assert preferred(package) == [str(package)]
    shutil.rmtree(made)
    assert preferred(package) == [str(package)]


def test_where_nobody_may_write_beside_the_sources_the_cache_keeps_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "leaping").mkdir()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    kept = compiled.folder_of(tmp_path / "leaping")
    assert kept.is_relative_to(tmp_path / "cache" / "hopper")
    assert kept != compiled.folder_of(tmp_path / "other" / "leaping")


def test_what_is_missing_for_a_translation_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as without:
        without.setattr(importlib.util, "find_spec", lambda name: None)
        with pytest.raises(ConfigError, match=r"pip install 'hopper-flight\[compile\]'"):
            compiling.compile_modules()
    with monkeypatch.context() as without:
        without.setenv("CC", "no-such-compiler -O2")
        with pytest.raises(ConfigError, match=r"no C compiler \('no-such-compiler'\): install gcc"):
            compiling.compile_modules()


@pytest.fixture
def root(package: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where only `leaping` is to be translated."""
    monkeypatch.setattr(compiling, "_ROOT", package.parent)
    monkeypatch.setattr(compiling, "MODULES", {"leaping": ("leap",)})
    return package.parent


def test_a_failed_translation_leaves_what_there_is(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiling, "_SETUP", "raise SystemExit('fatal error: Python.h: no such file')")
    with pytest.raises(ConfigError, match=r"fatal error: Python\.h: no such file; install gcc and Python's"):
        compiling.compile_modules()
    assert len(preferred(root / "leaping")) == 2


_MADE = """
from pathlib import Path
Path("made/leaping").mkdir(parents=True)
Path("made/{library}").write_bytes(b"new")
Path("made/leaping/leap{suffix}").write_bytes(b"new")
"""


def test_a_translation_takes_the_place_of_the_old_one(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package, library = root / "leaping", f"{compiled.library_of('leaping')}{compiled.SUFFIX}"
    monkeypatch.setattr(compiling, "_SETUP", _MADE.format(library=library, suffix=compiled.SUFFIX))
    (package / "leap.py").write_text("HIGH = True\n", encoding="utf-8")
    assert len(preferred(package)) == 1
    (made,) = compiling.compile_modules()
    assert (made.package, made.modules, made.folder) == ("leaping", 1, compiled.folder_of(package))
    assert sorted(path.name for path in made.folder.parent.iterdir()) == [made.folder.name]
    assert (made.folder / library).read_bytes() == b"new"
    assert len(preferred(package)) == 2


def test_the_command_leaves_what_is_up_to_date(root: Path) -> None:
    assert "there is machine code of these sources" in CliRunner().invoke(app, ["compile"]).stdout


def test_the_command_removes_it(root: Path) -> None:
    done = CliRunner().invoke(app, ["compile", "--remove", "--json"])
    assert json.loads(done.stdout) == {str(compiled.folder_of(root / "leaping")): "removed"}
    assert len(preferred(root / "leaping")) == 1
    assert "no machine code" in CliRunner().invoke(app, ["compile", "--remove"]).stdout


def test_every_module_to_translate_is_there() -> None:
    for package, names in compiling.MODULES.items():
        assert [name for name in names if not (ROOT / package / f"{name}.py").is_file()] == []
