"""What a person gets wrong is answered in words, with exit code 2, and leaves nothing half-written."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from desk_files import SIDECAR, TABLE
from hopper_command import hopper, refused

import ground.files
import ground.mission_run
import hal.config
from hal.config import config_root


def alter(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert text.count(old) == 1
    path.write_text(text.replace(old, new), encoding="utf-8")


@pytest.mark.parametrize(
    ("file", "old", "new", "says"),
    [
        ("a.csv", "0.1,1.0,0.5", "0.1,1.0,0.5x", "a.csv:3:3: column 'position_m': '0.5x' is no number"),
        ("a.csv", "0.2,1.0", "0.05,1.0", "a.csv:4:1: column 'time_s': time goes back from 0.1 s to 0.05 s"),
        ("a.csv", "position_m", "position", "a.csv:1:3: channel 'position' does not end in a unit"),
        ("a.csv", "0.5\n", "nan\n", "a.csv:3:3: column 'position_m': 'nan' is not finite"),
        ("a.yaml", "run: a", "run: [a]", "a.yaml:2:1: key run must be text"),
    ],
)
@pytest.mark.parametrize(
    "command",
    [
        ("simulate", "--plant", "cart.yaml", "--like", "a.csv", "--out", "out.csv"),
        ("diagnose", "a.csv", "--plant", "cart.yaml", "--out", "out"),
        ("convert", "a.csv", "out.mcap"),
    ],
)
def test_a_malformed_recording(
    desk: Path, command: tuple[str, ...], file: str, old: str, new: str, says: str
) -> None:
    alter(desk / file, old, new)
    assert refused(*command).startswith(says)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('"force_n / mass"', '"force_n / (mass + * 2)"', "equations.balance.rate: not a formula"),
        ('"force_n / mass"', '"force_n / massa"', "'massa' is not known here; did you mean 'mass'?"),
        ('"force_n / mass"', "\"open('a.csv')\"", "open"),
        ("value: 2.0", "value: .nan", "cart.yaml: parameters.mass.value = nan must be finite"),
        (", unit: kg", "", "cart.yaml: key parameters.mass.unit is missing"),
        ("kg", "kgg", "cart.yaml: parameters.mass.unit: 'kgg' is not a unit"),
        ("inputs: {", "inputs: {{", "cart.yaml:5:1: "),
    ],
)
def test_a_malformed_plant(desk: Path, old: str, new: str, says: str) -> None:
    text = (desk / "cart.yaml").read_text(encoding="utf-8")
    assert old in text
    (desk / "cart.yaml").write_text(text.replace(old, new, 1), encoding="utf-8")
    message = refused_with_place("plant", "check", "cart.yaml")
    assert message.startswith("cart.yaml")
    assert says in message
    assert (
        refused_with_place("simulate", "--plant", "cart.yaml", "--like", "a.csv", "--out", "out.csv")
        == message
    )


def refused_with_place(*arguments: str) -> str:
    """A refusal of several lines: beneath the message stands the formula, marked where it goes wrong."""
    result = hopper(*arguments)
    assert result.exit_code == 2, result.output
    assert isinstance(result.exception, SystemExit)
    return result.stderr.removeprefix("error: ")


def test_the_place_in_a_formula_is_marked(desk: Path) -> None:
    alter(desk / "cart.yaml", '"force_n / mass"', '"force_n / (mass + * 2)"')
    _, formula, mark = refused_with_place("plant", "check", "cart.yaml").splitlines()
    assert formula[mark.index("^")] == "*"


@pytest.fixture
def settings_copy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the configuration, which is then what the command reads."""
    copy = tmp_path / "config"
    shutil.copytree(config_root(), copy)
    for module in (hal.config, ground.files, ground.mission_run):
        monkeypatch.setattr(module, "config_root", lambda: copy)
    return copy


@pytest.mark.parametrize(
    ("file", "old", "new", "says"),
    [
        (
            "boards/sim.yaml",
            "timeout_s: 0.1}",
            "timeout_s: -0.1}",
            "watchdog.timeout_s = -0.1 is outside its",
        ),
        (
            "boards/sim.yaml",
            "depth: 20000",
            "depth: many",
            "ground_link.depth = 'many' must be a whole number",
        ),
        ("boards/sim.yaml", "watchdog:", "watchdogs:", "unknown key watchdogs"),
        (
            "surfaces.yaml",
            "unknown_probability: 0.2",
            "unknown_probability: 25",
            "unknown_probability = 25 is outside its limits",
        ),
        (
            "flight.yaml",
            "power_limit_w: 5.0",
            "power_limit_w: -5.0",
            "power_limit_w = -5.0 is outside its limits [",
        ),
    ],
)
def test_a_malformed_configuration(
    desk: Path, settings_copy: Path, file: str, old: str, new: str, says: str
) -> None:
    alter(settings_copy / file, old, new)
    message = refused("run", "--hops", "1", "--energy-j", "1", "--out", "out")
    assert says in message
    assert Path(file).stem in message


@pytest.mark.parametrize(
    ("command", "says"),
    [
        (
            ("run", "--board", "mars"),
            "no board is called 'mars'; known here: raspberry_pi, raspberry_pi_emulated, sim",
        ),
        (("run", "--board", "raspberry_pi"), "board 'raspberry_pi': this computer is not the robot"),
        (("run", "--surface", "mud"), "'mud'"),
        (("run", "--energy-j", "900"), "energy_j = 900 is outside the rig's limits ["),
        (("run", "--energy-j", "nan"), "energy_j = nan is outside the rig's limits ["),
        (("run", "--hops", "0"), "hops = 0"),
        (("run", "--seed", "-1"), "seed = -1 is outside its limits [0, "),
    ],
)
def test_a_mission_that_cannot_be_flown(desk: Path, command: tuple[str, ...], says: str) -> None:
    assert says in refused(*command, "--out", "out")


def test_a_refused_mission_leaves_no_folder_on_the_way_to_its_own(desk: Path) -> None:
    before = sorted(desk.rglob("*"))
    refused("run", "--board", "raspberry_pi", "--out", Path("out") / "of" / "today")
    assert sorted(desk.rglob("*")) == before


def test_a_folder_of_other_things_is_not_overwritten(desk: Path) -> None:
    before = sorted(desk.iterdir())
    assert "holds something else than an earlier result" in refused("run", "--hops", "1", "--out", desk)
    assert sorted(desk.iterdir()) == before


@pytest.mark.parametrize(
    ("command", "kind"),
    [
        (("plant", "check", "nope"), "plant"),
        (("simulate", "--plant", "nope", "--like", "a.csv", "--out", "out.csv"), "plant"),
        (("diagnose", "a.csv", "--plant", "nope", "--out", "out"), "plant"),
        (("import", "a.csv", "--map", "nope", "--out", "out.csv"), "imports"),
    ],
)
def test_an_unknown_name_is_answered_with_the_known_ones(
    desk: Path, command: tuple[str, ...], kind: str
) -> None:
    names = ", ".join(sorted(path.stem for path in (config_root() / kind).glob("*.yaml")))
    assert refused(*command) == f"nope: no such file, and no name in config/{kind}; names there: {names}"


@pytest.mark.parametrize(
    ("command", "says"),
    [
        (("replay", "none.mcap"), "none.mcap: cannot be read (No such file or directory)"),
        (("replay", "a.csv"), "a.csv: is no MCAP file"),
        (("convert", "none.csv", "out.csv"), "none.csv: no such file"),
        (("convert", "a.csv", "out.txt"), "out.txt: a recording is written to .csv, .csv.gz, .mcap"),
        (
            ("convert", "a.csv", "cart.yaml/out.csv"),
            "cart.yaml/out.csv: cannot be written (cart.yaml is no folder)",
        ),
        (
            ("simulate", "--plant", "bb0b_drive", "--like", "a.csv", "--out", "out.csv"),
            "a.csv: kind is 'axis', the plant 'bb0b' is of kind 'drive'",
        ),
    ],
)
def test_a_file_that_is_not_what_is_needed(desk: Path, command: tuple[str, ...], says: str) -> None:
    assert refused(*command).startswith(says)


def test_one_recording_is_simulated_at_a_time(desk: Path) -> None:
    (desk / "b.csv").write_text(TABLE, encoding="utf-8")
    (desk / "b.yaml").write_text(SIDECAR.replace("run: a", "run: b"), encoding="utf-8")
    (desk / "cart.yaml").rename(desk / "plant.yml")
    message = refused("simulate", "--plant", "plant.yml", "--like", "[ab].csv", "--out", "out.csv")
    assert message == "[ab].csv: holds 2 recordings; name the one to simulate"


Start = Callable[[str], "subprocess.CompletedProcess[str]"]


@pytest.fixture
def start(tmp_path: Path) -> Start:
    """Start the command as the shell does, after some lines of Python."""

    def run(before: str) -> subprocess.CompletedProcess[str]:
        code = f"import sys; sys.argv = ['hopper', 'plant', 'check', 'nope']; {before}; import ground.entry; "
        return subprocess.run(
            [sys.executable, "-c", code + "ground.entry.main()"],
            cwd=tmp_path,
            env={**os.environ, "COLUMNS": "80"},
            capture_output=True,
            text=True,
            check=False,
        )

    return run


def test_a_refusal_leaves_the_process_with_code_2_and_no_traceback(start: Start) -> None:
    ended = start("pass")
    assert (ended.returncode, ended.stdout) == (2, "")
    assert ended.stderr.startswith("error: nope: no such file")
    assert "Traceback" not in ended.stderr


def test_without_the_ground_libraries_it_says_what_to_install(start: Start) -> None:
    ended = start("sys.modules['typer'] = None")
    assert ended.returncode == 1
    assert "need 'typer'; install them with: pip install 'hopper-flight[ground]'" in ended.stderr
    assert "Traceback" not in ended.stderr


def test_ctrl_c_while_the_libraries_are_read_ends_in_words(start: Start) -> None:
    """They take seconds: an import that is interrupted stands here for all of them."""
    finder = "type('Finder', (), {'find_spec': lambda name, *_: signal.raise_signal(2) if name == 'typer' else None})"
    ended = start(f"import signal; sys.meta_path.insert(0, {finder})")
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, "", "stopped; nothing was written\n")
