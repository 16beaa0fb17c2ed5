"""Writing the calibration where the simulation and the flight code read it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from flight.surface.known import KnownSurface, SurfaceSettings, load_surfaces
from ground.calibration.fit import RowFit
from ground.files import write_atomic
from ground.reproduce.paper import Paper
from hal.config import build_settings, read_yaml
from hal.errors import ConfigError
from sim_hal.soils import Soils, ground_of, load_soils
from sim_hal.truth import REFERENCE

PLANTS = {"bb0b_hop.yaml": 1.0, "bb0b_hop_arm.yaml": 1.0, "hopter_hop.yaml": 3.0}
"""Plant files of `config/plant` whose surfaces are the calibrated soils, and on how many such feet each stands."""

PRIORS = (
    "unknown_probability",
    "unknown_c3_low",
    "unknown_c3_high",
    "unknown_stiffness_low_n_m",
    "unknown_stiffness_high_n_m",
)
NOTES = {
    "unknown_probability": "prior that the ground is none of these",
    "unknown_c3_low": "C3 of an unknown ground: anything between",
    "unknown_stiffness_low_n_m": "of unknown ground under the foot, from fluff to rock",
}
HEAD = """\
# What is known of surfaces. `hopper calibrate --write` writes this file and the surfaces of config/plant/*_hop*.yaml.
#
# surfaces: published dissipation C3, mean, range and runs (Wisniewski et al. 2021, Table 5, C2_ref_direct). The
# flight code's posterior over surfaces and its prior for a spot start from these. fresh, fall, stiffness: what it
# expects beside; they stay as they stand here (stiffness as first calibrated, steel's as far as the robot can tell).
"""
MIDDLE = """
# simulated: the soils of the simulation (sim_hal/soils.py says what each number does), fitted so that simulated runs
# meet Table 5. Target (published) and what the fit gives, C3 in %:
"""


def rounded(soils: Soils) -> Soils:
    """The same soils to the digits that the file holds."""
    return build_settings(_plain(asdict(soils)), Soils, "rounded soils")


def write_surfaces(path: Path, paper: Paper, soils: Soils, table: Sequence[RowFit]) -> Path:
    """Write `config/surfaces.yaml`; the flight code's own priors stay as they stand there."""
    priors = load_surfaces(path)
    return write_atomic(
        path, HEAD + _known(paper, priors) + _priors(priors) + MIDDLE + _fit(table) + _soils(soils)
    )


def write_plant_surfaces(path: Path, soils: Soils, feet: float) -> Path:
    """Put the middling fresh soils under the reference foot into a plant file, all else kept to the letter.

    Raises `ConfigError` where the file has no line for a soil's value.
    """
    text = path.read_text(encoding="utf-8")
    for name in soils.soils:
        ground = ground_of(soils, name, "1")
        for key, value in (("k_l", feet * ground.stiffness_n_m), ("chi", ground.lost_share)):
            pattern = rf"(^  {name}:\n(?:    .*\n)*?    {key}: \{{value: )[^,]+(, std: )([^,]+)(,)"
            std = f"{0.15 * value:.3e}" if key == "k_l" else None
            new = re.compile(pattern, re.MULTILINE)
            text, count = new.subn(lambda m, v=value, s=std: _line(m, v, s), text)  # type: ignore[misc]
            if count != 1:
                raise ConfigError(f"{path}: surfaces.{name}.{key} has no line of its own to be written to")
    return write_atomic(path, text)


def _line(match: re.Match[str], value: float, std: str | None) -> str:
    text = f"{value:.4g}" if std is None else f"{value:.3e}"  # YAML 1.1 wants the point in 1.0e+05
    return f"{match[1]}{text}{match[2]}{std or match[3]}{match[4]}"


def plants_agree(folder: Path) -> list[str]:
    """What the plant files of a configuration folder say otherwise than its `surfaces.yaml`, in words."""
    soils = load_soils(folder / "surfaces.yaml")
    wrong = []
    for name, feet in PLANTS.items():
        surfaces = read_yaml(folder / "plant" / name)["surfaces"]
        for soil in soils.soils:
            ground = ground_of(soils, soil, "1")
            for key, value in (("k_l", feet * ground.stiffness_n_m), ("chi", ground.lost_share)):
                if abs(surfaces[soil][key]["value"] / value - 1.0) > 1e-3:
                    wrong.append(f"plant/{name}: surfaces.{soil}.{key}")
    return wrong


def _known(paper: Paper, priors: SurfaceSettings) -> str:
    """Steel as it stands, then the published rows; beside each what the flight code's own priors have."""
    own = {(s.name, s.foot, s.tilt_deg): s for s in priors.surfaces}
    steel = own[REFERENCE, "1", 0.0]
    lines = [_row(REFERENCE, "1", 0.0, steel.c3_mean, steel.c3_low, steel.c3_high, steel.runs, steel)]
    for row in paper.surfaces:
        c3, known = row.c3_direct, own.get((row.surface, row.foot, row.tilt_deg))
        lines.append(_row(row.surface, row.foot, row.tilt_deg, c3.mean, c3.low, c3.high, row.runs, known))
    return "surfaces:\n" + "\n".join(lines) + "\n"


def _row(
    name: str,
    foot: str,
    tilt_deg: float,
    mean: float,
    low: float | None,
    high: float | None,
    runs: int,
    own: KnownSurface | None,
) -> str:
    extras = "".join(
        f", {key}: {getattr(own, key):{form}}"
        for key, form in (
            ("fresh_c3_mean", "g"),
            ("fresh_c3_std", "g"),
            ("fall", "g"),
            ("stiffness_n_m", ".3e"),
        )
        if getattr(own, key, None) is not None
    )
    return (
        f'  - {{name: {name}, foot: "{foot}", tilt_deg: {tilt_deg:.1f}, '
        f"c3_mean: {mean:g}, c3_low: {low:g}, c3_high: {high:g}, runs: {runs}{extras}}}"
    )


def _priors(settings: SurfaceSettings) -> str:
    lines = []
    for name in PRIORS:
        note = f"  # {NOTES[name]}" if name in NOTES else ""
        lines.append(f"{name}: {getattr(settings, name):g}{note}\n")
    return "".join(lines)


def _fit(table: Sequence[RowFit]) -> str:
    lines = ["#   surface           foot tilt   published            fitted"]
    for row in table:
        aim = row.row.c3_direct
        fold = f", fold {row.fold:.1f}" if row.fold else ""
        spans = f"{span_text(aim.mean, aim.low, aim.high)}   {span_text(row.mean, row.low, row.high)}"
        lines.append(f"#   {row.row.surface:17} #{row.row.foot} {row.row.tilt_deg:5.0f}   {spans}{fold}")
    return "\n".join(lines) + "\n"


def span_text(mean: float, low: float | None, high: float | None) -> str:
    """Mean and range of shares, in percent."""
    assert low is not None and high is not None
    return f"{100 * mean:4.1f} ({100 * low:4.1f} - {100 * high:4.1f})"


def _soils(soils: Soils) -> str:
    data = _plain(asdict(soils))
    law, tilt = data["foot_law"], data["tilt_law"]
    lines = ["simulated:", "  feet:"]
    lines += [f'    "{name}": {_flow(pad)}' for name, pad in data["feet"].items()]
    lines += [
        f"  foot_law: {_flow(law)}",
        f"  tilt_law: {_flow(tilt)}",
        "  soils:",
    ]
    for name, soil in data["soils"].items():
        lines += [f"    {name}:"] + [f"      {key}: {_number(value)}" for key, value in soil.items()]
    return "\n".join(lines) + "\n"


def _flow(values: dict[str, Any]) -> str:
    return "{" + ", ".join(f"{key}: {_number(value)}" for key, value in values.items()) + "}"


def _number(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.4g}" if abs(value) < 1e4 else f"{value:.1f}"


def _plain(value: Any) -> Any:
    """Plain data with numbers to four digits."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    return float(f"{value:.4g}") if isinstance(value, float) else value
