"""Every command of the README runs. Those that take minutes run with HOPPER_SLOW=1."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
HOPPER = (sys.executable, "-c", "from ground.entry import main; main()")
EMPS = ROOT / "../shared/data/emps/DATA_EMPS.mat"
SMALL_RUN = "hopper run --surface quartz_sand --hops 1 --references 0 --energy-j 2 --out out/run"


@dataclass(frozen=True)
class Decision:
    """How a command of the README is tested: as it stands, or as `instead`; and what it must end with."""

    instead: str = ""
    slow: bool = False
    code: int = 0
    says: str = ""
    needs: tuple[str, ...] = field(default=())  # a program, or a file
    elsewhere: str = ""  # the test that runs it, when not this one


DECISIONS = {
    "make demo": Decision(elsewhere="test_make_demo_is_the_command_of_the_readme"),
    "make test": Decision(elsewhere="test_make_test_is_there"),
    "hopper run --surface quartz_sand --hops 3 --energy-j 18 --out out/run": Decision(
        SMALL_RUN, says="the robot is stowed"
    ),
    "hopper replay out/run/flight.mcap": Decision(says="the same, bit for bit"),
    "hopper console out/run/flight.mcap": Decision(elsewhere="test_browser.test_a_log_is_played_back"),
    "hopper export out/run/flight.mcap --to csv --out out/tables": Decision(says="accelerometer.csv"),
    "hopper figures out/run/report.html --out out/figures": Decision(says="files", needs=("chromium",)),
    "hopper run --mission five_grounds --out out/five": Decision(
        slow=True, says="page: out/five/report.html"
    ),
    "hopper diagnose DATA_EMPS.mat --map emps --plant emps_mass --compare emps_published --out out/emps": Decision(
        f"hopper diagnose {EMPS} --map emps --plant emps_mass --compare emps_published --out out/emps",
        slow=True,
        says="viscous friction",
        needs=(str(EMPS),),
    ),
    "hopper demo concealed --out out/concealed": Decision(
        slow=True, says="page: out/concealed/concealed.html"
    ),
    "hopper run --board raspberry_pi_emulated --hops 1 --energy-j 5 --out out/emulated": Decision(
        slow=True, says="the robot is stowed"
    ),
    "pip install 'hopper_flight-0.1.0-py3-none-any.whl[rpi]'": Decision(elsewhere="test_wheel"),
    "hopper setup": Decision(code=1, says="of 14 checks are wrong"),
    "hopper key link.key": Decision(says="link.key: written"),
    "python -m flight --board raspberry_pi --mission mission.yaml --log flight.mcap": Decision(
        code=2, says="this computer is not the robot"
    ),
}


def commands() -> Iterator[str]:
    """The lines of the README's sh blocks, without their comments."""
    for block in re.findall(r"```sh\n(.*?)```", README, re.DOTALL):
        for line in block.splitlines():
            command = re.sub(r"\s+#.*", "", line).strip()
            if command:
                yield command


def test_there_is_a_decision_for_every_command_and_no_other() -> None:
    assert list(commands()) == list(DECISIONS)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where a person would stand: one folder for all commands, in the README's order."""
    folder = tmp_path_factory.mktemp("readme")
    (mission,) = re.findall(r"```yaml\n(.*?)```", README, re.DOTALL)
    (folder / "mission.yaml").write_text(mission)
    return folder


def run(command: str, place: Path) -> subprocess.CompletedProcess[str]:
    words = shlex.split(command)
    called = [*HOPPER, *words[1:]] if words[0] == "hopper" else [sys.executable, *words[1:]]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "200"}
    return subprocess.run(
        called, cwd=place, env=environment, capture_output=True, text=True, check=False, timeout=1800
    )


def test_commands_do_what_the_readme_says(place: Path) -> None:
    """In their order, because later ones take what earlier ones left."""
    ran = 0
    for command, decision in DECISIONS.items():
        slow = decision.slow and os.environ.get("HOPPER_SLOW") != "1"
        missing = any(not shutil.which(need) and not Path(need).exists() for need in decision.needs)
        if decision.elsewhere or slow or missing:
            continue
        done = run(decision.instead or command, place)
        assert done.returncode == decision.code, f"{command}\n{done.stdout}{done.stderr}"
        assert decision.says in done.stdout + done.stderr, f"{command}\n{done.stdout}{done.stderr}"
        ran += 1
    assert ran >= 6


def test_make_demo_is_the_command_of_the_readme() -> None:
    made = subprocess.run(["make", "-n", "demo"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    (flown,) = [line for line in made.splitlines() if "hopper run" in line]
    wanted = next(line for line in commands() if line.startswith("hopper run"))
    assert shlex.split(flown)[1:] == shlex.split(wanted.replace("out/run", "out/demo"))[1:]


def test_make_test_is_there() -> None:
    made = subprocess.run(["make", "-n", "test"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert "pytest" in made and "ruff" in made and "mypy" in made


def test_files_that_the_readme_names_are_there() -> None:
    named = re.findall(r"`((?:docs|config)/[\w./-]+)`|\]\(((?:docs|config)/[\w./-]+)\)", README)
    assert len(named) > 10
    missing = [path for pair in named for path in pair if path and not (ROOT / path).exists()]
    assert missing == []


def test_every_command_of_hopper_is_in_the_table() -> None:
    import typer

    from ground.cli import app

    group = typer.main.get_command(app)
    table = README[README.index("## The commands") :]
    missing = [name for name in group.commands if f"`hopper {name}" not in table]  # type: ignore[attr-defined]
    assert missing == []
