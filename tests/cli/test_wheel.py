"""The wheel carries all that a robot or a ground station needs, and nothing of the tests."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from email.parser import Parser
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[2]
PACKAGES = ("flight", "hal", "sim_hal", "ground")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Iterator[zipfile.ZipFile]:
    """The wheel of this checkout, built without a network by the backend that pyproject.toml names."""
    builders = pytest.importorskip(
        "hatchling.builders.wheel", reason="hatchling, which builds the wheel, is absent"
    )
    builder = builders.WheelBuilder(str(CHECKOUT))
    (path,) = builder.build(directory=str(tmp_path_factory.mktemp("wheel")), versions=["standard"])
    with zipfile.ZipFile(path) as opened:
        yield opened


def files_below(folder: Path, pattern: str) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob(pattern)}


def test_the_configuration_is_inside_to_the_byte(wheel: zipfile.ZipFile) -> None:
    config = CHECKOUT / "config"
    expected = {name for name in files_below(config, "*") if (config / name).is_file()}
    assert {"flight.yaml", "surfaces.yaml", "boards/sim.yaml", "plant/bb0b_hop.yaml"} <= expected
    packed = {name for name in wheel.namelist() if name.startswith("hal/_config/")}
    assert packed == {f"hal/_config/{name}" for name in expected}
    for name in expected:
        assert wheel.read(f"hal/_config/{name}") == (config / name).read_bytes()


@pytest.mark.parametrize("package", PACKAGES)
def test_each_package_is_whole_and_typed(wheel: zipfile.ZipFile, package: str) -> None:
    packed = {name for name in wheel.namelist() if name.startswith(f"{package}/") and name.endswith(".py")}
    assert packed == {f"{package}/{name}" for name in files_below(CHECKOUT / package, "*.py")}
    assert f"{package}/py.typed" in wheel.namelist()


def test_the_consoles_page_is_inside(wheel: zipfile.ZipFile) -> None:
    folder = CHECKOUT / "ground" / "live" / "static"
    packed = {name for name in wheel.namelist() if name.startswith("ground/live/static/")}
    assert packed == {f"ground/live/static/{path.name}" for path in folder.iterdir()}


def test_nothing_else_is_inside(wheel: zipfile.ZipFile) -> None:
    tops = {name.partition("/")[0] for name in wheel.namelist()}
    (metadata,) = tops - set(PACKAGES)
    assert metadata.endswith(".dist-info")
    assert not [name for name in wheel.namelist() if "__pycache__" in name or name.endswith(".pyc")]


def test_the_command_the_boards_and_the_extras_are_declared(wheel: zipfile.ZipFile) -> None:
    (folder,) = {name.partition("/")[0] for name in wheel.namelist()} - set(PACKAGES)
    points = wheel.read(f"{folder}/entry_points.txt").decode()
    for line in (
        "hopper = ground.entry:main",
        "sim = sim_hal.board:open_sim",
        "raspberry_pi = hal.raspberry_pi:",
    ):
        assert line in points
    metadata = Parser().parsestr(wheel.read(f"{folder}/METADATA").decode())
    assert {"ground", "rpi", "dev"} <= set(metadata.get_all("Provides-Extra") or [])
    flown = [line for line in metadata.get_all("Requires-Dist") or [] if "extra ==" not in line]
    assert sorted(line.partition(">")[0].lower() for line in flown) == [
        "mcap",
        "numpy",
        "pyserial",
        "pyyaml",
        "smbus2",
    ]
    assert metadata["Requires-Python"] == ">=3.11"
