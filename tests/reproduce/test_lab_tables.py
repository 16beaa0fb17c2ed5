"""A laboratory's table gives back the coefficients that were planted in it, and is refused in clear words."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from lab_tables import (
    CAMPAIGN,
    MAPPING,
    RIG,
    changed,
    noisy_rows,
    rows,
    without_references,
    write_csv,
    write_xlsx,
)

from ground.reproduce.chain import Chain, through_chain
from ground.reproduce.command import configured_campaign, content, reproduce_by_table
from ground.reproduce.table import load_map, read_campaign_table
from hal.errors import ConfigError


def chain_of(table: Path, mapping: Path) -> Chain:
    return through_chain(read_campaign_table(table, load_map(mapping), mapping, RIG), RIG)


@pytest.fixture
def mapping(tmp_path: Path) -> Path:
    path = tmp_path / "map.yaml"
    path.write_text(MAPPING, encoding="utf-8")
    return path


def test_planted_coefficients_come_back_from_csv_and_xlsx(tmp_path: Path, mapping: Path) -> None:
    sheet = tmp_path / "sheet.yaml"
    sheet.write_text(MAPPING + "sheet: Runs\n", encoding="utf-8")
    for table, own in (
        (write_csv(tmp_path / "runs.csv", rows()), mapping),
        (write_xlsx(tmp_path / "runs.xlsx", rows()), sheet),
    ):
        chain = chain_of(table, own)
        for run, planted in zip(chain.runs, CAMPAIGN, strict=True):
            if planted.ground == "Steel plate":
                assert run.c2_reference is not None and run.c3_direct is None
                assert run.c2_reference.value == pytest.approx(planted.c2, abs=1e-9)
            else:
                assert run.c3_direct is not None
                assert run.c3_direct.value == pytest.approx(planted.c3, abs=1e-9)
            assert run.run.compression_m.value == pytest.approx(planted.compression_m)
        assert chain.c2_average is not None
        assert chain.c2_average.value == pytest.approx((0.05 + 0.02 + 0.09) / 3)
        average = chain.runs[-1].c3_average
        assert average is not None and average.value == pytest.approx(1 - 0.91 / (1 - 0.16 / 3))


def test_the_whole_comparison_of_a_table(tmp_path: Path, mapping: Path) -> None:
    table = write_csv(tmp_path / "runs.csv", rows())
    campaign = configured_campaign()
    made = reproduce_by_table(campaign, table, mapping)
    figures = content(campaign, made, None)["figures"]
    assert figures["c3_direct_quartz_sand_foot_1_0deg"]["value"] == pytest.approx(0.38)
    assert figures["c3_direct_quartz_sand_foot_1_0deg"]["met"] is False  # 38 %, published 35.9 %
    assert figures["c3_direct_quartz_sand_foot_1_20deg"]["value"] == pytest.approx(0.58)
    assert figures["c3_direct_quartz_sand_foot_1_20deg"]["met"] is True
    assert figures["c2_ref_foot_1"]["value"] == pytest.approx(0.07)
    assert "mae_by_flight_all" not in figures  # nobody believed anything before these hops
    assert figures["mae_by_average_all"]["runs"] == 5


def test_intervals_cover_what_was_planted(tmp_path: Path, mapping: Path) -> None:
    chance = np.random.default_rng(5)
    errors = []
    for number in range(40):
        table = write_csv(tmp_path / f"{number}.csv", noisy_rows(chance, 5e-5, 5e-4))
        for run, planted in zip(chain_of(table, mapping).runs, CAMPAIGN, strict=True):
            if run.c3_direct is not None:
                own = [run.c3_direct.parts[key] for key in run.c3_direct.parts if "#" in key]
                errors.append((run.c3_direct.value - planted.c3) / np.linalg.norm(own))
    inside = np.mean(np.abs(errors) < 1.96)
    assert 0.90 < inside < 0.99  # 200 draws of a true 95 %
    assert 0.8 < np.std(errors) < 1.2


def test_the_latest_reference_with_the_same_foot_counts(tmp_path: Path, mapping: Path) -> None:
    chain = chain_of(write_csv(tmp_path / "runs.csv", rows()), mapping)
    direct = [run.c2_direct.value for run in chain.tests if run.c2_direct is not None]
    assert direct == pytest.approx([0.05, 0.05, 0.02, 0.09, 0.09])


@pytest.mark.parametrize(
    ("row", "column", "value", "words"),
    [
        (2, 6, "n/a", "row 3, column 'hmax [cm]': 'n/a' is no number"),
        (2, 6, "", "row 3, column 'hmax [cm]': the cell is empty"),
        (2, 6, "nan", "row 3, column 'hmax [cm]': 'nan' is not finite"),
        (2, 6, -3.0, "row 3, column 'hmax [cm]': -0.03 m is outside [0, 100] m"),
        (
            3,
            1,
            "Mud",
            "row 4, column 'Ground': 'Mud' is not among the mapping's values: Steel plate, Sand, Syar",
        ),
        (3, 2, 7, "row 4, column 'Config': foot '7' is unknown; known: 0, 1, 2, 3, 4"),
        (3, 3, 60.0, "row 4, column 'Angle [deg]': 60 deg is outside [0, 45] deg"),
        (1, 5, 179.9, "row 2, column 'd1 [mm]': a compression of 0.1 mm is outside (2.18, 200] mm"),
        (0, 6, "hmax", "no column 'hmax [cm]'"),
        (0, 5, "d0 [mm]", "the heading 'd0 [mm]' stands twice"),
    ],
)
@pytest.mark.parametrize("write", [write_csv, write_xlsx])
def test_a_wrong_cell_is_named(
    tmp_path: Path,
    mapping: Path,
    write: Callable[[Path, list[list[object]]], Path],
    row: int,
    column: int,
    value: object,
    words: str,
) -> None:
    name = "runs.csv" if write is write_csv else "runs.xlsx"
    if write is write_xlsx:
        mapping.write_text(MAPPING + "sheet: Runs\n", encoding="utf-8")
    table = write(tmp_path / name, changed(rows(), row, column, value))
    with pytest.raises(ConfigError) as caught:
        chain_of(table, mapping)
    assert name in str(caught.value) and words in str(caught.value)
    assert ("sheet 'Runs'" in str(caught.value)) == (write is write_xlsx)


def test_a_table_without_references_is_refused(tmp_path: Path, mapping: Path) -> None:
    table = write_csv(tmp_path / "runs.csv", rows(without_references()))
    with pytest.raises(ConfigError, match="no reference jump: no row has the surface 'steel'"):
        chain_of(table, mapping)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('before: {column: "d0 [mm]", unit: mm}\n', "", "either both before and after are needed"),
        ("foot: {column: Config}\n", "", "foot must be either a column or constant.foot"),
        ("unit: cm}", "unit: kg}", "height.unit: 'kg' is no unit of the kind of 'm'"),
        ("unit: cm}", "unit: ''}", "height.unit: a unit is needed"),
        ("label: {column: No.}", "colour: {column: No.}", "unknown key colour"),
        ("height_m: 5.0e-4", "height_m: -1", "sigma.height_m = -1 is outside its limits"),
    ],
)
def test_a_wrong_mapping_is_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert old in MAPPING
    path = tmp_path / "map.yaml"
    path.write_text(MAPPING.replace(old, new), encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        load_map(path)
    assert str(path) in str(caught.value) and words in str(caught.value)


def test_files_that_are_no_tables_are_refused(tmp_path: Path, mapping: Path) -> None:
    (tmp_path / "fake.xlsx").write_bytes(b"not a workbook")
    (tmp_path / "empty.csv").write_text("", encoding="utf-8")
    (tmp_path / "latin.csv").write_bytes(b"Gr\xfcn\n")
    (tmp_path / "runs.ods").write_text("x", encoding="utf-8")
    for name, words in (
        ("fake.xlsx", "not readable as XLSX"),
        ("empty.csv", "has 0 rows"),
        ("latin.csv", "not UTF-8"),
        ("runs.ods", r"must be \.csv or \.xlsx"),
        ("gone.xlsx", "no such file"),
    ):
        with pytest.raises(ConfigError, match=words):
            chain_of(tmp_path / name, mapping)
    mapping.write_text(MAPPING + "sheet: Jumps\n", encoding="utf-8")
    with pytest.raises(ConfigError, match="no sheet 'Jumps'; sheets: Notes, Runs"):
        chain_of(write_xlsx(tmp_path / "runs.xlsx", rows()), mapping)
