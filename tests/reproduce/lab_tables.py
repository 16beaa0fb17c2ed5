"""A laboratory's campaign made up from known coefficients, as CSV or XLSX, and the mapping that reads it."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import openpyxl

from flight import energy
from flight.energy import RigConstants
from flight.settings import load
from flight.uncertain import Uncertain
from ground.calibration.hop_model import on_arm

RIG = load().rig
HEADINGS = ("No.", "Ground", "Config", "Angle [deg]", "d0 [mm]", "d1 [mm]", "hmax [cm]")
MAPPING = """\
label: {column: No.}
surface: {column: Ground, values: {Steel plate: steel, Sand: quartz_sand, Syar: syar}}
foot: {column: Config}
tilt: {column: "Angle [deg]", unit: deg}
before: {column: "d0 [mm]", unit: mm}
after: {column: "d1 [mm]", unit: mm}
height: {column: "hmax [cm]", unit: cm}
sigma: {distance_m: 5.0e-5, height_m: 5.0e-4}
"""


@dataclass(frozen=True)
class Planted:
    """One run with the coefficients that it was made from."""

    ground: str
    c2: float
    c3: float
    foot: str = "1"
    tilt_deg: float = 0.0
    compression_m: float = 0.033

    @property
    def height_m(self) -> float:
        """What a robot with these coefficients does."""
        rig = RigConstants.of(on_arm(RIG, self.foot))
        ideal_j = energy.analysis_energy(Uncertain(self.compression_m), rig).value
        weight_n = rig.total_mass_kg.value * rig.gravity_m_s2.value
        return (1.0 - self.c2) * (1.0 - self.c3) * ideal_j / weight_n

    def cells(self, number: int, noise: Sequence[float] = (0.0, 0.0, 0.0)) -> list[object]:
        """The row of a table: distance 180 mm before tensioning, shorter after; noise in m."""
        before, after = 0.18 + noise[0], 0.18 - self.compression_m + noise[1]
        row = (number, self.ground, int(self.foot), self.tilt_deg)
        return [*row, 1e3 * before, 1e3 * after, 1e2 * (self.height_m + noise[2])]


CAMPAIGN = (
    Planted("Steel plate", 0.05, 0.0),
    Planted("Sand", 0.05, 0.36),
    Planted("Sand", 0.05, 0.40, compression_m=0.036),
    Planted("Steel plate", 0.02, 0.0, foot="3"),
    Planted("Sand", 0.02, 0.26, foot="3"),
    Planted("Steel plate", 0.09, 0.0),
    Planted("Sand", 0.09, 0.58, tilt_deg=20.0),
    Planted("Syar", 0.09, 0.0),  # a ground that takes nothing
)


def rows(campaign: Sequence[Planted] = CAMPAIGN) -> list[list[object]]:
    """The table's rows, headings first."""
    return [list(HEADINGS), *(run.cells(number) for number, run in enumerate(campaign, start=1))]


def noisy_rows(chance: np.random.Generator, distance_m: float, height_m: float) -> list[list[object]]:
    """The same as a caliper and a camera would read it."""
    found: list[list[object]] = [list(HEADINGS)]
    for number, run in enumerate(CAMPAIGN, start=1):
        drawn = chance.standard_normal(3) * (distance_m, distance_m, height_m)
        found.append(run.cells(number, drawn.tolist()))
    return found


def write_csv(path: Path, table: Sequence[Sequence[object]]) -> Path:
    """The table as CSV."""
    with path.open("w", encoding="utf-8", newline="") as stream:
        csv.writer(stream).writerows(table)
    return path


def write_xlsx(path: Path, table: Sequence[Sequence[object]], sheet: str = "Runs") -> Path:
    """The table as the second sheet of a workbook."""
    book = openpyxl.Workbook()
    assert book.active is not None
    book.active.title = "Notes"
    own = book.create_sheet(sheet)
    for row in table:
        own.append(list(row))
    book.save(path)
    return path


def changed(table: Sequence[Sequence[object]], row: int, column: int, value: object) -> list[list[object]]:
    """The table with one other cell (0 is the row of headings)."""
    copied = [list(cells) for cells in table]
    copied[row][column] = value
    return copied


def without_references() -> list[Planted]:
    """The tests alone."""
    return [replace(run) for run in CAMPAIGN if run.ground != "Steel plate"]
