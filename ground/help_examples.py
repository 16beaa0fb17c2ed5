"""The examples at the end of each command's --help. A test reads each of them as the command line would."""

from __future__ import annotations

from typer import Typer

EXAMPLES: dict[str, tuple[str, ...]] = {
    "run": (
        "hopper run --surface quartz_sand --hops 3 --energy-j 18 --out out/run",
        "hopper run --mission five_grounds --out out/five",
        "hopper run --board raspberry_pi_emulated --hops 1 --json",
    ),
    "console": (
        "hopper console --sim",
        "hopper console --port /dev/ttyUSB0 --key link.key",
        "hopper console out/run/flight.mcap",
        "hopper console --sim --terminal",
    ),
    "diagnose": (
        "hopper diagnose DATA_EMPS.mat --map emps --plant emps_mass --compare emps_published --out out/emps",
        "hopper diagnose out/run --plant bb0b_hop --out out/diagnosis --figures out/figures",
    ),
    "demo concealed": ("hopper demo concealed --hide soil_rate_dependence --out out/concealed",),
    "simulate": (
        "hopper simulate --plant out/diagnosis/plant.yaml --like out/run/hop_01.hop.csv.gz --out out/p.csv",
    ),
    "import": ("hopper import DATA_EMPS.mat --map emps --out out/emps.mcap",),
    "convert": ("hopper convert out/run/hop_01.hop.csv.gz out/hop.mcap",),
    "export": (
        "hopper export out/run/flight.mcap --to parquet --out out/tables",
        "hopper export out/run/hop_01.hop.csv.gz --to csv --out out/hop",
    ),
    "figures": ("hopper figures out/run/report.html --out out/figures",),
    "layout": ("hopper layout hopper.layout.json",),
    "replay": ("hopper replay out/run/flight.mcap", "hopper replay cut.mcap --recover --json"),
    "reproduce": (
        "hopper reproduce --out out/reproduction",
        "hopper reproduce --table runs.csv --map hopper_runs",
    ),
    "calibrate": ("hopper calibrate",),
    "campaign faults": (
        "hopper campaign faults --count 100 --seed 1 --out out/campaign-faults",
        "hopper campaign faults --count 10000 --scheduler tcp://10.0.0.1:8786",
    ),
    "campaign missions": ("hopper campaign missions --count 200 --seed 1 --out out/campaign-missions",),
    "campaign diagnosis": ("hopper campaign diagnosis --count 20 --processes 2",),
    "campaign replay": ("hopper campaign replay out/campaign-faults 17",),
    "compile": ("hopper compile", "hopper compile --remove"),
    "plant check": ("hopper plant check emps_mass",),
    "plant show": ("hopper plant show out/diagnosis/plant.yaml --page out/equations.html",),
    "data list": ("hopper data list",),
    "data fetch": ("hopper data fetch emps --out data/emps",),
    "command": (
        "hopper command ping --port /dev/ttyUSB0 --key link.key",
        "hopper command tension energy_j=5 --port /dev/ttyUSB0",
    ),
    "key": ("hopper key link.key",),
    "dictionary": ("hopper dictionary", "hopper dictionary --json"),
    "dictionary export": ("hopper dictionary export --xtce out/hopper.xml",),
    "setup": ("hopper setup",),
}


def add_examples(app: Typer, above: str = "") -> None:
    """Put each command's examples at the end of its help. Raises `KeyError` for a command that has none."""
    for command in app.registered_commands:
        if command.callback is not None:
            name = command.name or command.callback.__name__.replace("_", "-")
            command.epilog = epilog(EXAMPLES[f"{above}{name}"])
    for group in app.registered_groups:
        if group.typer_instance is not None:
            add_examples(group.typer_instance, f"{above}{group.name} ")


def epilog(examples: tuple[str, ...]) -> str:
    """Examples as the help shows them: each on a line of its own."""
    return "Examples:\n\n" + "\n\n".join(examples)
