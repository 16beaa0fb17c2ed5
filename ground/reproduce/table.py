"""A laboratory's campaign table (CSV or XLSX) as runs, by a mapping of its columns.

Strict: what is missing, unknown, not a number or out of its limits is an error that names file, sheet, row and
column.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import pint

from flight.settings import RigSettings
from flight.uncertain import Uncertain
from ground.calibration.hop_model import on_arm
from ground.reproduce.cells import Cells, read_cells
from ground.reproduce.chain import CampaignRun
from hal.config import Limits, load_settings
from hal.errors import ConfigError
from sim_hal.truth import REFERENCE

LONGEST_M = 0.2
HIGHEST_M = 100.0
STEEPEST_DEG = 45.0


@dataclass(frozen=True)
class Column:
    """A column of the table by its heading, the unit of its numbers, and what its words mean to us."""

    column: str
    unit: str = ""
    values: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class TableSigmas:
    """Standard uncertainty of one reading: of each of the two distances, and of the height."""

    distance_m: Annotated[float, Limits(0.0, 0.1)]
    height_m: Annotated[float, Limits(0.0, 1.0)]


@dataclass(frozen=True)
class TableMap:
    """Which column holds what. Foot, tilt and set-up may be the same for all (`constant`).

    `before`, `after`: distance between foot and body before tensioning and just before the jump; their difference is
    the compression f_used, whichever is larger. `compression` may stand in place of the two. `height`: h_max of the
    centre of mass. Without `setup` all runs belong to one; a reference jump holds until the next one with its foot.
    """

    surface: Column
    height: Column
    sigma: TableSigmas
    foot: Column | None = None
    tilt: Column | None = None
    setup: Column | None = None
    label: Column | None = None
    before: Column | None = None
    after: Column | None = None
    compression: Column | None = None
    sheet: str | None = None
    header_row: Annotated[int, Limits(1, 1000)] = 1
    reference_surface: str = REFERENCE
    constant: dict[str, str] = field(default_factory=dict)


CONSTANTS = ("foot", "tilt_deg")


def load_map(path: Path) -> TableMap:
    """Read and check a mapping. Raises `ConfigError` naming file, key and what is wrong."""
    found = load_settings(path, TableMap)
    pair = found.before is not None and found.after is not None
    if pair == (found.compression is not None) or (found.before is None) != (found.after is None):
        raise ConfigError(f"{path}: either both before and after are needed, or compression alone")
    for name in found.constant:
        if name not in CONSTANTS:
            raise ConfigError(f"{path}: constant.{name} is unknown; known: {', '.join(CONSTANTS)}")
    if (found.foot is None) == ("foot" not in found.constant):
        raise ConfigError(f"{path}: foot must be either a column or constant.foot")
    if found.tilt is not None and "tilt_deg" in found.constant:
        raise ConfigError(f"{path}: tilt and constant.tilt_deg cannot both be given")
    for name in ("height", "before", "after", "compression", "tilt"):
        column = getattr(found, name)
        if column is not None:
            _factor(column, "deg" if name == "tilt" else "m", f"{path}: {name}.unit")
    return found


def read_campaign_table(path: Path, mapping: TableMap, source: Path, rig: RigSettings) -> list[CampaignRun]:
    """The runs of a table. Raises `ConfigError` naming file, sheet, row and column; nothing is skipped or mended."""
    cells = read_cells(path, mapping.sheet, mapping.header_row)
    for name in ("surface", "height", "foot", "tilt", "setup", "label", "before", "after", "compression"):
        column = getattr(mapping, name)
        if column is not None and column.column not in cells.headings:
            raise ConfigError(
                f"{cells.where}: no column {column.column!r} ({source}: {name}); columns: "
                f"{', '.join(cells.headings)}"
            )
    runs = [_run(cells, index, mapping, rig) for index in range(len(cells.rows))]
    if not any(run.reference for run in runs):
        raise ConfigError(
            f"{cells.where}: no reference jump: no row has the surface {mapping.reference_surface!r}, "
            "without which there is no C2_ref"
        )
    return runs


def _run(cells: Cells, index: int, mapping: TableMap, rig: RigSettings) -> CampaignRun:
    row = cells.numbers[index]
    surface = _words(cells, index, mapping.surface)
    foot = mapping.constant.get("foot", "") if mapping.foot is None else _words(cells, index, mapping.foot)
    if foot not in rig.feet:
        column = mapping.foot.column if mapping.foot else "constant.foot"
        raise cells.error(index, column, f"foot {foot!r} is unknown; known: {', '.join(rig.feet)}")
    compression_m = _compression(cells, index, mapping, rig, foot)
    height_m = _number(cells, index, mapping.height, "m", (0.0, HIGHEST_M))
    setup = "all" if mapping.setup is None else _words(cells, index, mapping.setup)
    return CampaignRun(
        label=str(row) if mapping.label is None else _words(cells, index, mapping.label),
        setup=setup,
        surface=REFERENCE if surface == mapping.reference_surface else surface,
        foot=foot,
        tilt_deg=_tilt_deg(cells, index, mapping),
        place=str(row),
        reference=surface == mapping.reference_surface,
        compression_m=compression_m,
        height_m=Uncertain.of(height_m, mapping.sigma.height_m, f"height#{row}"),
    )


def _tilt_deg(cells: Cells, index: int, mapping: TableMap) -> float:
    if mapping.tilt is not None:
        return _number(cells, index, mapping.tilt, "deg", (0.0, STEEPEST_DEG))
    try:
        return float(mapping.constant.get("tilt_deg", "0"))
    except ValueError:
        raise ConfigError(f"constant.tilt_deg = {mapping.constant['tilt_deg']!r} is no number") from None


def _compression(cells: Cells, index: int, mapping: TableMap, rig: RigSettings, foot: str) -> Uncertain:
    row = cells.numbers[index]
    limits = (0.0, LONGEST_M)
    if mapping.compression is not None:
        column, readings = mapping.compression, 1
        value_m = _number(cells, index, mapping.compression, "m", limits)
    else:
        assert mapping.before is not None and mapping.after is not None
        column, readings = mapping.after, 2
        before_m = _number(cells, index, mapping.before, "m", (0.0, HIGHEST_M))
        value_m = abs(before_m - _number(cells, index, mapping.after, "m", (0.0, HIGHEST_M)))
    here = on_arm(rig, foot)
    weight_n = (here.body_mass_kg + here.leg_mass_kg) * here.gravity_m_s2
    least_m = weight_n / here.spring_stiffness_n_m
    if not least_m < value_m <= LONGEST_M:
        raise cells.error(
            index,
            column.column,
            f"a compression of {1e3 * value_m:g} mm is outside ({1e3 * least_m:.2f}, {1e3 * LONGEST_M:g}] mm; "
            "less does not lift the robot",
        )
    sigma_m = readings**0.5 * mapping.sigma.distance_m
    return Uncertain.of(value_m, sigma_m, f"compression#{row}")


def _words(cells: Cells, index: int, column: Column) -> str:
    text = cells.text(index, column.column)
    if column.values and text not in column.values:
        raise cells.error(
            index, column.column, f"{text!r} is not among the mapping's values: {', '.join(column.values)}"
        )
    return column.values.get(text, text)


def _number(cells: Cells, index: int, column: Column, unit: str, limits: tuple[float, float]) -> float:
    value = cells.number(index, column.column) * _factor(column, unit, f"{cells.where}: {column.column}")
    if not limits[0] <= value <= limits[1]:
        raise cells.error(
            index, column.column, f"{value:g} {unit} is outside [{limits[0]:g}, {limits[1]:g}] {unit}"
        )
    return value


def _factor(column: Column, unit: str, where: str) -> float:
    """What a column's numbers are to be multiplied with. Raises `ConfigError` for a unit of another kind."""
    if not column.unit:
        raise ConfigError(f"{where}: a unit is needed, such as {'mm' if unit == 'm' else unit}")
    try:
        return float(_UNITS.Quantity(1.0, column.unit).to(unit).magnitude)
    except (pint.PintError, AttributeError, ValueError, TypeError) as error:
        raise ConfigError(f"{where}: {column.unit!r} is no unit of the kind of {unit!r} ({error})") from None


_UNITS: pint.UnitRegistry[float] = pint.UnitRegistry()
