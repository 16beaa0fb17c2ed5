"""Configuration files: where they are, and how they become checked, frozen dataclasses.

Every number of a rig lives in YAML under `config/`. A settings class declares each key once, as a dataclass
field annotated with `Limits`; `load_settings` refuses unknown and missing keys, wrong types, values out of
range and numbers that are not finite, naming file, key, value and limit.
"""

from __future__ import annotations

import dataclasses
import math
import re
import types
from collections.abc import Hashable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, Union, get_args, get_origin, get_type_hints

import yaml

from hal.errors import ConfigError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T", bound="DataclassInstance")


@dataclass(frozen=True)
class Limits:
    """Smallest and largest allowed value of a number, both included."""

    low: float = -math.inf
    high: float = math.inf

    def __str__(self) -> str:
        return f"[{self.low:g}, {self.high:g}]"


def config_root() -> Path:
    """The folder of the configuration: inside an installed wheel, else the checkout's `config/`."""
    here = Path(__file__).resolve().parent
    packed = here / "_config"
    return packed if packed.is_dir() else here.parent / "config"


def config_path(*parts: str) -> Path:
    """Path of one file, e.g. `config_path("boards", "sim.yaml")`. Raises `ConfigError` if absent."""
    path = config_root().joinpath(*parts)
    if not path.is_file():
        raise ConfigError(f"{path}: no such configuration file")
    return path


def read_yaml(path: Path) -> Any:
    """Parse one YAML file. Raises `ConfigError` with file, line and column when it is not readable YAML."""
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: not UTF-8 text (byte {error.start})") from error
    try:
        return _parsed(text)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        where = f":{mark.line + 1}:{mark.column + 1}" if mark else ""
        raise ConfigError(f"{path}{where}: {error.problem or 'not valid YAML'}") from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:  # control characters, dates that are none
        raise ConfigError(f"{path}: not valid YAML ({str(error).splitlines()[0]})") from error


def _parsed(text: str) -> Any:
    """By libyaml where PyYAML has it, in a fifth of the time; what that refuses, PyYAML's own parser has to judge.

    libyaml ends the process where its stack is full, so it is not given what may be nested deeper than any settings.
    """
    deepest = text.count("[") + text.count("{") + max(map(len, text.splitlines()), default=0)
    if _QuickLoader is not None and deepest < _DEEPEST:
        with suppress(yaml.YAMLError, ValueError, RecursionError):
            return yaml.load(text, Loader=_QuickLoader)
    return yaml.load(text, Loader=StrictLoader)


class _Strict(yaml.constructor.SafeConstructor):
    """Refuses a key that stands twice in one mapping."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[object] = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, Hashable):
                raise yaml.constructor.ConstructorError(
                    None, None, "a list or mapping cannot be a key", key_node.start_mark
                )
            if key in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"key {key!r} stands twice", key_node.start_mark
                )
            seen.add(key)
        return super().construct_mapping(node, deep)


class StrictLoader(_Strict, yaml.SafeLoader):
    """YAML's safe loader, refusing a key that stands twice in one mapping; `1e-5` is read as a number."""


StrictLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(?:[0-9][0-9_]*\.?[0-9_]*|\.[0-9_]+)[eE][-+]?[0-9]+$"),
    list("-+0123456789."),
)

_DEEPEST = 2000
_QuickLoader: Any = None
if yaml.__with_libyaml__:
    _QuickLoader = type("_QuickLoader", (_Strict, yaml.CSafeLoader), {})
    _QuickLoader.yaml_implicit_resolvers = StrictLoader.yaml_implicit_resolvers


class StrictDumper(yaml.SafeDumper):
    """YAML's safe dumper, quoting the texts that `StrictLoader` would read as numbers, such as `1e-5`."""


StrictDumper.yaml_implicit_resolvers = StrictLoader.yaml_implicit_resolvers


def to_yaml(data: Any) -> str:
    """Plain data, or a settings dataclass, as YAML text that reads back as the same values, to the bit."""
    if dataclasses.is_dataclass(data) and not isinstance(data, type):
        data = dataclasses.asdict(data)
    return yaml.dump(data, Dumper=StrictDumper, sort_keys=False, default_flow_style=None, width=110)


def load_settings(path: Path, settings: type[T]) -> T:
    """Read `path` into the frozen dataclass `settings`, checked key by key.

    Raises `ConfigError` naming file, key, value and limit.
    """
    return build_settings(read_yaml(path), settings, str(path))


def build_settings(data: Any, settings: type[T], source: str, prefix: str = "") -> T:
    """Build the dataclass `settings` from a mapping already read; `source` names its origin in errors."""
    if not isinstance(data, Mapping):
        raise ConfigError(
            f"{source}: {prefix.rstrip('.') or 'the file'} must be a mapping, not {type(data).__name__}"
        )
    hints, fields = _declared(settings)
    unknown = sorted(str(key) for key in data if key not in fields)
    if unknown:
        raise ConfigError(
            f"{source}: unknown key {prefix}{unknown[0]}; known here: {', '.join(sorted(fields))}"
        )
    values: dict[str, Any] = {}
    for name, field in fields.items():
        if name in data:
            values[name] = _convert(data[name], hints[name], source, prefix + name)
        elif field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING:
            raise ConfigError(f"{source}: key {prefix}{name} is missing")
    return settings(**values)


@cache
def _declared(settings: type[DataclassInstance]) -> tuple[dict[str, Any], dict[str, dataclasses.Field[Any]]]:
    """Annotations and fields of a settings class, by name."""
    fields = {field.name: field for field in dataclasses.fields(settings)}
    return get_type_hints(settings, include_extras=True), fields


def _convert(value: Any, hint: Any, source: str, key: str) -> Any:
    """One value as its annotation asks, or a `ConfigError` that names its place."""
    limits = Limits()
    if get_origin(hint) is Annotated:
        hint, *extras = get_args(hint)
        limits = next((extra for extra in extras if isinstance(extra, Limits)), limits)
    if get_origin(hint) in (Union, types.UnionType):
        if value is None and type(None) in get_args(hint):
            return None
        hint = next(option for option in get_args(hint) if option is not type(None))
    if isinstance(hint, type) and dataclasses.is_dataclass(hint):
        return build_settings(value, hint, source, key + ".")
    if get_origin(hint) is tuple:
        if not isinstance(value, list):
            raise ConfigError(f"{source}: {key} = {value!r} must be a list")
        item = get_args(hint)[0]
        return tuple(_convert(entry, item, source, f"{key}[{index}]") for index, entry in enumerate(value))
    if get_origin(hint) in (dict, Mapping):
        if not isinstance(value, dict):
            raise ConfigError(f"{source}: {key} = {value!r} must be a mapping")
        item = get_args(hint)[1]
        return {str(name): _convert(entry, item, source, f"{key}.{name}") for name, entry in value.items()}
    return _scalar(value, hint, limits, source, key)


def _scalar(value: Any, hint: Any, limits: Limits, source: str, key: str) -> Any:
    if hint in (float, int):
        whole = hint is int
        if isinstance(value, bool) or not isinstance(value, int if whole else (int, float)):
            raise ConfigError(f"{source}: {key} = {value!r} must be a {'whole ' if whole else ''}number")
        if not math.isfinite(value):
            raise ConfigError(f"{source}: {key} = {value!r} must be finite")
        if not limits.low <= value <= limits.high:
            raise ConfigError(f"{source}: {key} = {value!r} is outside its limits {limits}")
        return hint(value)
    if hint is Any:
        return value
    if not isinstance(value, hint):
        raise ConfigError(f"{source}: {key} = {value!r} must be {hint.__name__}")
    return value
