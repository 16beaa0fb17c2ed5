"""Plant files: strict reading, lossless writing."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from hal.config import read_yaml
from hal.errors import ConfigError
from sim_hal.plant.compose import place_units
from sim_hal.plant.plant import (
    EffectUse,
    Parameter,
    Plant,
    Sensor,
    check_use,
    check_values,
    duplicates,
    find_effect,
)
from sim_hal.plant.structure import PlantError, Quantity, Reader
from sim_hal.plant.structure_entries import STRUCTURE_KEYS
from sim_hal.plant.structure_file import check_kind, load_kind, read_structure
from sim_hal.plant.units import dimension

FORMAT = 1
_KEYS = ("format", "plant", "name", "kind", "geometry", "parameters", "surfaces", "sensors", "effects")


@dataclass(frozen=True)
class _ParameterEntry:
    value: float
    std: float
    unit: str


@dataclass(frozen=True)
class _SensorEntry:
    noise_std: float = 0.0
    resolution: float | None = None
    range: Any = None


@dataclass(frozen=True)
class _EffectEntry:
    physics_id: str
    parameters: Any
    equation: str | None = None
    channel: str | None = None
    law: str | None = None


def load_plant(path: Path) -> Plant:
    """Read a plant file. Raises `PlantError` that names file, key, value and limit."""
    try:
        data = read_yaml(Path(path))
    except PlantError:
        raise
    except ConfigError as error:
        raise PlantError(str(error)) from None
    return read_plant(data, str(path))


def read_plant(data: Any, source: str) -> Plant:
    """Build a plant from the content of a plant file; `source` names it in errors."""
    if not isinstance(data, dict):
        raise PlantError(f"{source}: the file must be a mapping, not {type(data).__name__}")
    reader = Reader(data, source)
    name, kind = _head(reader)
    allowed = {*_KEYS, *(STRUCTURE_KEYS if kind == "equations" else ())}
    unknown = sorted(str(key) for key in data if key not in allowed)
    if unknown:
        raise reader.error(unknown[0], f"unknown key; known here: {', '.join(sorted(allowed))}")
    parameters = _parameters(reader, "parameters", data.get("parameters", {}))
    geometry = data.get("geometry", "vertical")
    try:
        plant = _build(reader, name, kind, str(geometry), parameters)
    except PlantError as error:
        raise error if str(error).startswith(source) else PlantError(f"{source}: {error}") from None
    return _with_effects(reader, plant)


def _head(reader: Reader) -> tuple[str, str]:
    """Name and kind of the plant, once the file says that it is one."""
    data = reader.data
    for key in ("format", "kind"):
        if key not in data:
            raise reader.error(key, "is missing; a plant file has format, plant (or name) and kind")
    if data["format"] != FORMAT:
        raise reader.error("format", f"{data['format']!r} must be {FORMAT}")
    named = [key for key in ("plant", "name") if key in data]
    if not named:
        raise reader.error("plant", "is missing; it is the rig's name (name: says the same)")
    if len({repr(data[key]) for key in named}) > 1:
        raise reader.error("name", f"{data['name']!r} is not what plant says, {data['plant']!r}")
    for key in (named[0], "kind"):
        if not isinstance(data[key], str):
            raise reader.error(key, f"{data[key]!r} must be a name")
    check_kind(data["kind"], reader.source)
    return data[named[0]], data["kind"]


def _build(reader: Reader, name: str, kind: str, geometry: str, parameters: dict[str, Parameter]) -> Plant:
    data = reader.data
    surfaces = {
        surface: _parameters(reader, f"surfaces.{surface}", entry)
        for surface, entry in reader.entries("surfaces").items()
    }
    if kind == "equations":
        quantities = {key: Quantity(value.unit) for key, value in parameters.items()}
        per_surface = tuple(next(iter(surfaces.values()), {}))
        quantities |= {key: Quantity(value.unit) for key, value in next(iter(surfaces.values()), {}).items()}
        structure = read_structure(data, reader.source, quantities, per_surface)
    else:
        structure = load_kind(kind, geometry)
    document = {key: data[key] for key in STRUCTURE_KEYS if key in data}
    sensors = {key: _sensor(reader, key, value) for key, value in reader.entries("sensors").items()}
    plant = Plant(name, kind, structure, parameters, surfaces, sensors, (), geometry, reader.source, document)
    _check_parameters(reader, plant)
    _check_sensors(reader, plant)
    return plant


def _check_sensors(reader: Reader, plant: Plant) -> None:
    """Refuse a sensor whose channel looks like a slip of the pen; a rig may have more than its plant predicts."""
    channels = [*plant.structure.outputs, *plant.structure.inputs]
    for name in plant.sensors.keys() - set(channels):
        close = difflib.get_close_matches(name, channels, n=1, cutoff=0.85)
        if close and _letters(close[0]) != _letters(name):
            raise reader.error(f"sensors.{name}", f"is no channel of the plant; did you mean {close[0]!r}?")


def _letters(channel: str) -> str:
    """A channel's name without its number: `angle_1_rad` and `angle_2_rad` are two sensors, and no slip."""
    return "".join(filter(str.isalpha, channel))


def _parameters(reader: Reader, key: str, entries: Any) -> dict[str, Parameter]:
    if not isinstance(entries, dict):
        raise reader.error(key, f"{entries!r} must be a mapping")
    found = {}
    for name, value in entries.items():
        entry = reader.settings(value, _ParameterEntry, f"{key}.{name}")
        if entry.std < 0:
            raise reader.error(f"{key}.{name}.std", f"{entry.std!r} must not be negative")
        reader.unit(entry.unit, f"{key}.{name}.unit")
        found[str(name)] = Parameter(entry.value, entry.std, entry.unit)
    return found


def _sensor(reader: Reader, name: str, value: Any) -> Sensor:
    entry = reader.settings(value, _SensorEntry, f"sensors.{name}")
    for key in ("noise_std", "resolution"):
        size = getattr(entry, key)
        if size is not None and size < 0:
            raise reader.error(f"sensors.{name}.{key}", f"{size!r} must not be negative")
    limits = entry.range
    if limits is not None:
        numbers = isinstance(limits, list) and all(
            isinstance(item, (int, float)) and math.isfinite(item) for item in limits
        )
        if not numbers or len(limits) != 2 or not limits[0] < limits[1]:
            raise reader.error(f"sensors.{name}.range", f"{limits!r} must be [smallest, largest]")
        limits = (float(limits[0]), float(limits[1]))
    return Sensor(entry.noise_std, entry.resolution, limits)


def _check_parameters(reader: Reader, plant: Plant) -> None:
    """Each parameter of the structure once, in its unit and limits, here or under each surface."""
    structure = plant.structure
    per_surface = set(structure.surface_parameters) if plant.surfaces else set()
    _check_values(reader, "parameters", plant, plant.parameters, structure.parameters.keys() - per_surface)
    for surface, values in plant.surfaces.items():
        _check_values(reader, f"surfaces.{surface}", plant, values, per_surface)


def _check_values(
    reader: Reader, key: str, plant: Plant, values: Mapping[str, Parameter], expected: set[str]
) -> None:
    quantities = plant.structure.parameters
    for name, parameter in values.items():
        if name not in expected:
            known = ", ".join(sorted(expected))
            raise reader.error(f"{key}.{name}", f"unknown for kind {plant.kind}; known: {known}")
        quantity = quantities[name]
        if dimension(parameter.unit) != dimension(quantity.unit):
            raise reader.error(f"{key}.{name}.unit", f"{parameter.unit!r} must be {quantity.unit!r}")
        low = -math.inf if quantity.low is None else quantity.low
        high = math.inf if quantity.high is None else quantity.high
        if not low <= parameter.value <= high:
            reason = f"{parameter.value!r} is outside its limits [{low:g}, {high:g}]"
            raise reader.error(f"{key}.{name}.value", reason)
    for name in sorted(expected - values.keys()):
        if not quantities[name].optional:
            raise reader.error(f"{key}.{name}", "is missing")


def _with_effects(reader: Reader, plant: Plant) -> Plant:
    entries = reader.data.get("effects", [])
    if not isinstance(entries, list):
        raise reader.error("effects", f"{entries!r} must be a list")
    uses = []
    for index, value in enumerate(entries):
        key = f"effects[{index}]"
        entry = reader.settings(value, _EffectEntry, key)
        parameters = _parameters(reader, f"{key}.parameters", entry.parameters)
        use = EffectUse(entry.physics_id, _equation(reader, key, entry), entry.channel, parameters, entry.law)
        form = check_use(plant, use)
        for name, unit in place_units(plant, use, form).items():
            if dimension(parameters[name].unit) != dimension(unit):
                reason = f"{parameters[name].unit!r} must be {unit!r}"
                raise reader.error(f"{key}.parameters.{name}.unit", reason)
        check_values(plant, use, form)
        uses.append(use)
    plant = replace(plant, effects=tuple(uses))
    for prefix in duplicates(plant):
        raise reader.error("effects", f"{prefix} stands there twice")
    return plant


def _equation(reader: Reader, key: str, entry: _EffectEntry) -> str:
    """Where an effect enters: as the file says, else where the catalogue puts it."""
    if entry.equation is not None:
        return entry.equation
    if entry.law is not None:
        raise reader.error(f"{key}.equation", "is missing; a law must say which balance it enters")
    return find_effect(entry.physics_id, reader.source).equation


def plant_document(plant: Plant) -> dict[str, Any]:
    """The content of the plant's file."""
    document: dict[str, Any] = {"format": FORMAT, "plant": plant.name, "kind": plant.kind}
    if plant.geometry != "vertical":
        document["geometry"] = plant.geometry
    document |= plant.document
    document["parameters"] = {name: vars(value) for name, value in plant.parameters.items()}
    if plant.surfaces:
        document["surfaces"] = {
            surface: {name: vars(value) for name, value in items.items()}
            for surface, items in plant.surfaces.items()
        }
    if plant.sensors:
        document["sensors"] = {name: _sensor_document(sensor) for name, sensor in plant.sensors.items()}
    if plant.effects:
        document["effects"] = [_effect_document(use) for use in plant.effects]
    return document


def _sensor_document(sensor: Sensor) -> dict[str, Any]:
    found: dict[str, Any] = {"noise_std": sensor.noise_std}
    if sensor.resolution is not None:
        found["resolution"] = sensor.resolution
    if sensor.range is not None:
        found["range"] = list(sensor.range)
    return found


def _effect_document(use: EffectUse) -> dict[str, Any]:
    found: dict[str, Any] = {"physics_id": use.physics_id, "equation": use.equation}
    if use.channel is not None:
        found["channel"] = use.channel
    if use.law is not None:
        found["law"] = use.law
    return found | {"parameters": {name: dict(vars(value)) for name, value in use.parameters.items()}}


def save_plant(plant: Plant, path: Path) -> None:
    """Write a plant file that `load_plant` reads back equal; never leaves a half-written file."""
    text = yaml.safe_dump(
        plant_document(plant), sort_keys=False, allow_unicode=True, default_flow_style=None, width=110
    )
    path = Path(path)
    half = path.with_name(path.name + ".part")
    half.write_text(text, encoding="utf-8")
    half.replace(path)
