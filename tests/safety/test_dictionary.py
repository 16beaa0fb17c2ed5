"""One dictionary for all: names used in code, settings and documentation must stand in it."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from flight import settings as flight_settings
from flight.commands import COMMAND_NAMES, SET_PARAMETER
from flight.monitor_settings import GROUPS
from flight.parameters import entry_of, leaves
from flight.quantities import QUANTITIES
from flight.states import SENSORS, Event
from ground.dictionary_page import dictionary_page
from hal import readings
from hal.config import config_path
from hal.dictionary import dictionary, load_dictionary
from hal.errors import ConfigError

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("flight", "hal", "sim_hal", "ground", "benchmarks")
EVENTS, COMMANDS = dictionary().events, dictionary().commands


def calls() -> Iterator[tuple[str, str, str]]:
    """(place, function, text) of each call in the code with a literal text among its arguments."""
    for path in sorted(file for package in PACKAGES for file in (ROOT / package).rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        others = set(foreign(tree))
        for node in ast.walk(tree):
            if isinstance(node, ast.Call):
                function = getattr(node.func, "attr", getattr(node.func, "id", ""))
                if function in others:
                    continue
                for argument in node.args:
                    if isinstance(argument, ast.Constant) and isinstance(argument.value, str):
                        yield f"{path.relative_to(ROOT)}:{node.lineno}", function, argument.value


def foreign(tree: ast.AST) -> Iterator[str]:
    """Names that a module has from elsewhere than the flight software, such as the `Event` of a recording."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and not (node.module or "").startswith(("flight", "hal")):
            yield from (name.asname or name.name for name in node.names)


def unknown(found: Iterator[tuple[str, str, str]]) -> list[tuple[str, str]]:
    """Places whose name is not in the dictionary."""
    homes = {
        "say": EVENTS,
        "Event": EVENTS,
        "Fault": EVENTS,
        "GroundCommand": COMMANDS,
        "_own": COMMANDS,
        "command": COMMANDS,
        "send": dictionary().topics,
    }
    return [(place, text) for place, function, text in found if text not in homes.get(function, {text})]


def used() -> Iterator[tuple[str, str, str]]:
    """The calls that name something of the dictionary; the command line's own words do not."""
    return (
        call
        for call in calls()
        if not (call[1] in ("command", "say", "send") and call[0].startswith("ground/"))
    )


def test_every_name_in_the_code_is_in_the_dictionary() -> None:
    found = list(used())
    assert sum(function in ("say", "Event", "Fault") for _, function, _ in found) > 20
    assert unknown(iter(found)) == []


def test_a_name_that_is_not_in_the_dictionary_is_found() -> None:
    planted = [
        ("here:1", "say", "nonesuch"),
        ("here:2", "GroundCommand", "launch"),
        ("here:3", "say", "fault"),
        ("here:4", "send", "gossip"),
    ]
    assert unknown(iter(planted)) == [("here:1", "nonesuch"), ("here:2", "launch"), ("here:4", "gossip")]
    with pytest.raises(KeyError):
        Event("nonesuch").severity  # noqa: B018 (asking is what fails)


def test_commands_monitors_topics_and_parameters_are_those_of_the_code() -> None:
    assert set(COMMANDS) == {*COMMAND_NAMES, SET_PARAMETER}
    assert all(group in GROUPS for entry in COMMANDS.values() for group in entry.accepted_in)
    measured = {name for name, entry in EVENTS.items() if entry.monitor == "measured"}
    assert measured == set(QUANTITIES)
    settings = flight_settings.load()
    names = [name for name, _ in leaves(settings)]
    assert all(entry_of(name) for name in names)
    unused = [key for key in dictionary().parameters if "*" not in key and key not in names]
    assert unused == []


def test_every_reading_is_a_channel_with_a_unit_that_fits_its_name() -> None:
    of_sensor = {
        "motor_current": readings.MotorCurrent,
        "nut_encoder": readings.NutPosition,
        "switches": readings.Switches,
        "spring": readings.SpringCompression,
        "magnet_current": readings.MagnetCurrent,
        "accelerometer": readings.SpecificForce,
    }
    assert set(of_sensor) == set(SENSORS)
    bookkeeping = {"time_s", "times_s", "overrun", "saturated"}
    wanted = {f"{name}.{field}" for name, kind in of_sensor.items() for field in kind._fields} - {
        f"{name}.{key}" for name in of_sensor for key in bookkeeping
    }
    channels = dictionary().channels
    assert wanted <= set(channels)
    suffix = {"A": "_a", "V": "_v", "m": "_m", "m/s": "_m_s", "m/s²": "_m_s2"}
    assert all(name.endswith(suffix.get(entry.unit, "")) for name, entry in channels.items())


def test_the_unit_of_each_parameter_is_the_one_in_its_name() -> None:
    ends = {
        **{
            "kg*m²": "_kg_m2",
            "N*s/m": "_n_s_m",
            "N*m*s": "_n_m_s",
            "N*m": "_n_m",
            "K/W": "_k_w",
            "V/s": "_v_s",
        },
        **{
            "m/s²": "_m_s2",
            "N/m": "_n_m",
            "m/s": "_m_s",
            "1/s": "_1_s",
            "Hz": "_hz",
            "ohm": "_ohm",
            "kg": "_kg",
        },
        **{"s": "_s", "m": "_m", "J": "_j", "A": "_a", "V": "_v", "W": "_w", "ticks": "_ticks"},
    }
    units = {name: entry.unit for name, entry in dictionary().parameters.items() if "monitors." not in name}
    wrong = [f"{name} in {unit}" for name, unit in units.items() if not name.endswith(ends.get(unit, ""))]
    assert wrong == []


def test_the_page_in_the_documentation_is_the_dictionary() -> None:
    assert (ROOT / "docs" / "dictionary.md").read_text(encoding="utf-8") == dictionary_page(dictionary())


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("arm: {id: 2", "arm: {id: 1", "commands.arm.id = 1 is taken by tension"),
        (
            "severity: warning, text: a command was",
            "severity: awful, text: a command was",
            "= 'awful' is none of",
        ),
        (
            "low: 0.1, high: 50.0",
            "low: 60, high: 50.0",
            "commands.tension.arguments.energy_j.low = 60 is above",
        ),
        ("low: 0.1, high: 50.0", "high: 50.0", "key commands.tension.arguments.energy_j.low is missing"),
        ("monitor: raised}", "monitor: guessed}", "is neither measured nor raised"),
    ],
)
def test_a_bad_dictionary_is_refused_in_words(tmp_path: Path, old: str, new: str, said: str) -> None:
    path = tmp_path / "dictionary.yaml"
    text = config_path("dictionary.yaml").read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ConfigError) as refused:
        load_dictionary(path)
    assert said in str(refused.value)
    assert str(path) in str(refused.value)
