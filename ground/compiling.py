"""Translation to machine code, by mypyc, of the modules that each tick runs through (`hopper compile`)."""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from ground.files import write_atomic
from hal import compiled
from hal.errors import ConfigError

MODULES = {
    "flight": (
        "executive",
        "hop_machine",
        "machine_tick",
        "monitors",
        "phases",
        "quantities",
        "record",
        "sensing",
        "sensor_clock",
        "states",
        "tensioning",
    ),
    "sim_hal": ("clock", "coil", "devices", "drive", "sensors", "world"),
}
"""What is translated of each package: what a tick spends its time in. Numpy's work would gain nothing."""

_ROOT = Path(compiled.__file__).resolve().parents[1]
_SETUP = """
from setuptools import setup
from mypyc.build import mypycify

separate = {groups!r}
options = ["--config-file=mypy.ini", *(path for paths, _ in separate for path in paths)]
setup(name="machine_code", ext_modules=mypycify(options, separate=separate, opt_level="2", debug_level="0"))
"""
_MYPY = "[mypy]\nfollow_imports = silent\nignore_missing_imports = True\n"
_SAME_TO_THE_BIT = "-ffp-contract=off"  # no fused multiply-add, which rounds once where Python rounds twice
_ADVICE = "install gcc and Python's headers (Debian: apt install gcc python3-dev)"


@dataclass(frozen=True)
class MachineCode:
    """What was made: how many modules of a package, and where they are kept."""

    package: str
    modules: int
    folder: Path


def up_to_date() -> bool:
    """Whether there is machine code of all present sources."""
    return all(compiled.fits(_ROOT / package) for package in MODULES)


def compile_modules() -> list[MachineCode]:
    """Translate; takes about a minute. Raises `ConfigError` where mypyc or a C compiler is missing."""
    if importlib.util.find_spec("mypyc") is None or importlib.util.find_spec("setuptools") is None:
        raise ConfigError("mypyc is not installed; install it with: pip install 'hopper-flight[compile]'")
    compiler = (os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc").split()[0]
    if shutil.which(compiler) is None:
        raise ConfigError(f"no C compiler ({compiler!r}): {_ADVICE}")
    with TemporaryDirectory(prefix="hopper-compile-") as name:
        work = Path(name)
        for package in ("hal", *MODULES):
            shutil.copytree(_ROOT / package, work / package, ignore=shutil.ignore_patterns("__pycache__"))
        _build(work)
        return [_keep(package, work) for package in MODULES]


def forget() -> list[Path]:
    """Remove all machine code, for any Python; where it was."""
    removed = []
    for package in MODULES:
        for folder in compiled.folder_of(_ROOT / package).parent.glob("machine_code*"):
            shutil.rmtree(folder)
            removed.append(folder)
    return removed


def _build(work: Path) -> None:
    groups = [
        ([f"{package}/{name}.py" for name in names], compiled.group_of(package))
        for package, names in MODULES.items()
    ]
    (work / "setup.py").write_text(_SETUP.format(groups=groups), encoding="utf-8")
    (work / "mypy.ini").write_text(_MYPY, encoding="utf-8")
    command = [sys.executable, "setup.py", "build_ext", "--build-lib", "made", "--build-temp", "made_of"]
    environment = {**os.environ, "CFLAGS": _SAME_TO_THE_BIT, compiled.SWITCH: "0"}
    done = subprocess.run(command, cwd=work, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        said = [line for line in (done.stdout + done.stderr).splitlines() if "error" in line.lower()]
        reason = said[0].strip() if said else f"exit code {done.returncode}"
        raise ConfigError(f"the translation to machine code failed: {reason}; {_ADVICE}")


def _keep(package: str, work: Path) -> MachineCode:
    """Put what was made of a package in its place, all at once."""
    library = f"{compiled.library_of(package)}{compiled.SUFFIX}"
    modules = list((work / "made" / package).glob(f"*{compiled.SUFFIX}"))
    with _replacing(compiled.folder_of(_ROOT / package)) as draft:
        for made in (work / "made" / library, *modules):
            shutil.copy2(made, draft)
        write_atomic(draft / compiled.MANIFEST, json.dumps(compiled.made_of(work / package)))
    return MachineCode(package, len(modules), compiled.folder_of(_ROOT / package))


@contextmanager
def _replacing(folder: Path) -> Iterator[Path]:
    """A folder to fill that then takes another's place; what runs from that one goes on."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=folder.parent, prefix="draft-") as name:
        draft = Path(name) / "new"
        draft.mkdir()
        yield draft
        if folder.exists():
            folder.rename(Path(name) / "old")
        draft.rename(folder)
