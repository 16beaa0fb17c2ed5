"""Every single number of config/flight.yaml: beyond its range, missing, without its unit, it is refused in words."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from flight import settings as flight_settings
from flight.parameters import entry_of
from hal.config import config_path, read_yaml
from hal.errors import ConfigError

SHIPPED: dict[str, Any] = read_yaml(config_path("flight.yaml"))


def numbers(content: Any, at: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """The place of every number."""
    if isinstance(content, dict):
        for key, value in content.items():
            yield from numbers(value, (*at, str(key)))
    elif isinstance(content, int | float) and not isinstance(content, bool):
        yield at


PLACES = list(numbers(SHIPPED))


def altered(folder: Path, at: tuple[str, ...], value: Any = None, key: str | None = None) -> Path:
    """The shipped settings with one value changed, or its key (to `key`, where given; else it is left out)."""
    content = copy.deepcopy(SHIPPED)
    *above, last = at
    block = content
    for name in above:
        block = block[name]
    before = block.pop(last)
    if value is not None:
        block[last] = value
    elif key is not None:
        block[key] = before
    path = folder / "flight.yaml"
    path.write_text(json.dumps(content), encoding="utf-8")  # which is YAML
    return path


def refused(path: Path) -> str:
    with pytest.raises(ConfigError) as refusal:
        flight_settings.load(path)
    message = str(refusal.value)
    assert message.startswith(f"{path}: ")
    return message.removeprefix(f"{path}: ")


def test_there_are_numbers_to_check_and_as_they_are_they_load(tmp_path: Path) -> None:
    path = tmp_path / "flight.yaml"
    path.write_text(json.dumps(SHIPPED), encoding="utf-8")
    assert flight_settings.load(path) == flight_settings.load()
    assert len(PLACES) > 150


@pytest.mark.parametrize("at", PLACES, ids=".".join)
def test_a_value_beyond_its_range_is_refused_with_key_value_and_limit(
    tmp_path: Path, at: tuple[str, ...]
) -> None:
    entry = entry_of(".".join(at))
    assert entry is not None
    for value in (2 * entry.high + 1, entry.low - abs(entry.low) - 1):
        bad = round(value) if entry.type == "int" else value
        message = refused(altered(tmp_path, at, bad))
        assert f"{'.'.join(at)} = {bad:g}" in message or f"{'.'.join(at)} = {bad!r}" in message
        assert "[" in message.split("=", 1)[1]


@pytest.mark.parametrize("at", [at for at in PLACES if at[0] != "monitors"], ids=".".join)
def test_a_key_that_is_missing_or_ends_in_another_unit_is_refused_by_name(
    tmp_path: Path, at: tuple[str, ...]
) -> None:
    name = ".".join(at)
    if at[:2] == ("surface", "learning") and at[2] == "foot_factors":
        pytest.skip("a table by name: which feet it has is not fixed")
    assert f"key {name} is missing" in refused(altered(tmp_path, at))
    assert f"{name}_milli" in refused(altered(tmp_path, at, key=f"{at[-1]}_milli"))


@pytest.mark.parametrize("value", ["5 W", "five", True, [5.0], {"w": 5.0}])
def test_a_value_with_its_unit_written_out_or_of_another_type_is_refused(tmp_path: Path, value: Any) -> None:
    message = refused(altered(tmp_path, ("drive", "power_limit_w"), value))
    assert "drive.power_limit_w" in message


@pytest.mark.parametrize(
    ("monitor", "row", "words"),
    [
        ("stall", {"response": "shrug"}, "response = 'shrug' is none of retry, safe_hold"),
        ("stall", {"then": "de_tension"}, "then = 'de_tension': a retry, and nothing else"),
        ("latch_did_not_close", {"then": ""}, "then = '': a retry, and nothing else"),
        ("latch_did_not_close", {"then": "retry"}, "then = 'retry' is none of safe_hold"),
        ("stall", {"below": 0.1}, "below = 0.1: only one of them can be the limit"),
        ("stall", {"watched_in": []}, "a limit needs watched_in"),
        ("stall", {"watched_in": ["monday"]}, "watched_in = 'monday' is no phase or group of phases"),
        ("stall", {"response": "retry", "then": "de_tension"}, "'retry' is possible in latch_check only"),
        ("stall", {"above": None, "watched_in": []}, "needs a limit"),
        ("abort", {"above": 1.0, "watched_in": ["hold"]}, "cannot have a limit"),
        ("stall", None, "key monitors.stall is missing"),
        ("no_such_fault", {"response": "de_tension"}, "unknown key monitors.no_such_fault"),
    ],
)
def test_a_row_of_the_fault_table_that_makes_no_sense_is_refused_in_words(
    tmp_path: Path, monitor: str, row: dict[str, Any] | None, words: str
) -> None:
    content = copy.deepcopy(SHIPPED)
    if row is None:
        del content["monitors"][monitor]
    else:
        whole = content["monitors"].setdefault(monitor, {})
        whole |= row
        content["monitors"][monitor] = {key: value for key, value in whole.items() if value is not None}
    path = tmp_path / "flight.yaml"
    path.write_text(json.dumps(content), encoding="utf-8")
    message = refused(path)
    assert words in message
    assert monitor in message
