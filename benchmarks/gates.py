"""Gates of `make check` that need more than a tool's own exit code.

python -m benchmarks.gates coverage FILE     branch coverage by package, from coverage's JSON
python -m benchmarks.gates licences          licences of what is installed for flight and ground
python -m benchmarks.gates wheel             build the wheel, install it in a clean environment, fly a mission
python -m benchmarks.gates mutants           the mutants that no test kills, each with its reason, if it has one
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import tomllib
from collections import defaultdict
from collections.abc import Callable, Mapping
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, requires
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[1]
EXPLAINED = ROOT / "tests" / "mutants.yaml"
PERMISSIVE = (
    *(
        "MIT",
        "BSD",
        "Apache",
        "ISC",
        "PSF",
        "Python Software Foundation",
        "HPND",
        "Zlib",
        "Unlicense",
        "0BSD",
    ),
    *("Public Domain", "MIT-CMU"),
)
"""What a licence's name begins with or holds, so that hopper may be given away with it."""
WEAK_COPYLEFT = ("MPL", "Mozilla Public License", "LGPL", "Lesser General Public")
"""May be used as it is; told apart, because changes to it would have to be given away."""


def coverage(file: str) -> int:
    """Lines and branches by package."""
    content = json.loads(Path(file).read_text(encoding="utf-8"))
    sums: dict[str, list[int]] = defaultdict(lambda: [0, 0, 0, 0])
    for name, one in content["files"].items():
        parts, found = Path(name).parts, one["summary"]
        keys = ("covered_lines", "num_statements", "covered_branches", "num_branches")
        for package in ("/".join(parts[: min(2, len(parts) - 1)]), "all"):
            sums[package] = [a + found[key] for a, key in zip(sums[package], keys, strict=True)]
    print(f"{'package':28s} {'lines':>16s} {'branches':>16s}")
    for package, (lines, of, branches, ways) in sorted(sums.items()):
        print(f"{package:28s} {_share(lines, of):>16s} {_share(branches, ways):>16s}")
    return 0


def _share(part: int, whole: int) -> str:
    return f"{100.0 * part / whole:.1f} % of {whole}" if whole else "–"


def licences() -> int:
    """Packages of the flight software and of the ground extra, with all that these bring; 1 for one not permitted."""
    wanted = needed("ground", "rpi", "cluster")
    command = [sys.executable, "-m", "piplicenses", "--format=json", "--from=mixed"]
    rows = json.loads(subprocess.check_output(command, text=True))
    bad = 0
    for row in rows:
        if row["Name"].lower().replace("_", "-") not in wanted:
            continue
        name = row["License"]
        kind = "permissive" if any(each in name for each in PERMISSIVE) else ""
        kind = "weak copyleft, used unchanged" if any(each in name for each in WEAK_COPYLEFT) else kind
        bad += not kind
        print(f"{row['Name']:28s} {row['Version']:14s} {name[:50]:50s} {kind or 'NOT PERMITTED'}")
    return int(bad > 0)


def needed(*extras: str) -> set[str]:
    """Names of all that this project needs with these extras, and what these need, as far as they are installed."""
    from packaging.requirements import Requirement

    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    own = [project["dependencies"], *(project["optional-dependencies"][extra] for extra in extras)]
    found, todo = set[str](), [(Requirement(line), {""}) for lines in own for line in lines]
    while todo:
        requirement, asked = todo.pop()
        marker, key = requirement.marker, requirement.name.lower().replace("_", "-")
        if key in found or (marker and not any(marker.evaluate({"extra": extra}) for extra in asked)):
            continue
        found.add(key)
        with suppress(PackageNotFoundError):
            todo += [(Requirement(line), {*requirement.extras, ""}) for line in requires(key) or []]
    return found


def wheel() -> int:
    """Build, install beside nothing else, and fly one hop by the installed command."""
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        run = subprocess.check_call
        run(
            [sys.executable, "-m", "build", "--wheel", "--outdir", made, str(ROOT)], stdout=subprocess.DEVNULL
        )
        (path,) = folder.glob("*.whl")
        run([sys.executable, "-m", "venv", str(folder / "env")])
        program = folder / "env" / "bin"
        run([str(program / "python"), "-m", "pip", "install", "--quiet", f"{path}[ground]"])
        mission = ["run", "--hops", "1", "--energy-j", "4", "--out", str(folder / "run")]
        run([str(program / "hopper"), *mission], cwd=made)
    print("the wheel flies a mission in a clean environment")
    return 0


def mutants() -> int:
    """Survivors of the last `mutmut run`; 1 when there is one without a reason in `tests/mutants.yaml`."""
    command = [str(Path(sys.executable).with_name("mutmut")), "results", "--all", "true"]
    text = subprocess.check_output(command, text=True)
    states: dict[str, list[str]] = defaultdict(list)
    for line in text.splitlines():
        name, _, state = line.strip().partition(": ")
        states[state].append(name)
    print(", ".join(f"{len(names)} {state}" for state, names in sorted(states.items())))
    reasons: Mapping[str, str] = yaml.safe_load(EXPLAINED.read_text(encoding="utf-8")) or {}
    alive = [*states["survived"], *states["no tests"]]
    for name in alive:
        print(f"{name}: {reasons.get(name, 'NOT EXPLAINED')}")
    return int(any(name not in reasons for name in alive))


GATES: Mapping[str, Callable[..., int]] = {
    "coverage": coverage,
    "licences": licences,
    "wheel": wheel,
    "mutants": mutants,
}


def main() -> None:
    """Run the gate that was named."""
    words = sys.argv[1:]
    if not words or words[0] not in GATES:
        raise SystemExit(__doc__)
    raise SystemExit(GATES[words[0]](*words[1:]))


if __name__ == "__main__":
    main()
