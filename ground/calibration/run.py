"""`hopper calibrate`: fit, show, write."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from flight import settings as flight_settings
from ground.calibration.fit import Calibration, RowFit
from ground.calibration.targets import load_calibration
from ground.calibration.write import PLANTS, rounded, span_text, write_plant_surfaces, write_surfaces
from ground.progress import Show
from ground.reproduce.paper import load_paper
from hal.config import config_path, config_root
from sim_hal.soils import Soils

CALIBRATION_HEADERS = ("ground, foot, tilt", "published", "fitted", "off", "fold")


def calibrate_surfaces(show: Show) -> tuple[Calibration, Soils]:
    """Fit all soils to the published numbers, rounded as the file will hold them; `show` is told what goes on."""
    rig = flight_settings.load(config_path("flight.yaml")).rig
    calibration = Calibration(load_paper(), load_calibration(), rig)
    return calibration, rounded(calibration.fitted(show))


def write_calibration(calibration: Calibration, soils: Soils, fits: Sequence[RowFit]) -> list[Path]:
    """Write the configuration's `surfaces.yaml` and the surfaces of its hop plants; returns the files."""
    written = [write_surfaces(config_path("surfaces.yaml"), calibration.paper, soils, fits)]
    for name, feet in PLANTS.items():
        written.append(write_plant_surfaces(config_root() / "plant" / name, soils, feet))
    return written


def calibration_rows(fits: Sequence[RowFit]) -> list[tuple[str, ...]]:
    """Target and fit of each row of Table 5, under `CALIBRATION_HEADERS`."""
    rows: list[tuple[str, ...]] = []
    for fit in fits:
        aim = fit.row.c3_direct
        rows.append(
            (
                f"{fit.row.surface.replace('_', ' ')} #{fit.row.foot} {fit.row.tilt_deg:.0f}°",
                span_text(aim.mean, aim.low, aim.high),
                span_text(fit.mean, fit.low, fit.high),
                f"{100 * (fit.mean - aim.mean):+.1f}",
                "–" if fit.fold is None else f"{fit.fold:.1f}",
            )
        )
    return rows


def calibration_content(fits: Sequence[RowFit], written: Sequence[Path]) -> dict[str, Any]:
    """The same as JSON-able data, with the files that were written."""
    rows = [
        {
            "surface": fit.row.surface,
            "foot": fit.row.foot,
            "tilt_deg": fit.row.tilt_deg,
            "published": {key: getattr(fit.row.c3_direct, key) for key in ("mean", "low", "high")},
            "fitted": {"mean": fit.mean, "low": fit.low, "high": fit.high},
            "fold": fit.fold,
        }
        for fit in fits
    ]
    return {"c3": rows, "written": [str(path) for path in written]}
