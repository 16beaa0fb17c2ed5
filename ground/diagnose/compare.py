"""A published model of the same rig beside what was found: parameters, and errors on the same held-out data."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ground.diagnose.segments import Segment
from ground.diagnose.verify import channel_units, predict, rms, windowed_rms
from sim_hal.plant.simulate import Plant

Float = NDArray[np.float64]


def compare_with(
    published: Plant, found: Plant, free_run: Sequence[Segment], windows: Sequence[Segment], sigmas: Float
) -> dict[str, Any]:
    """Rows of parameters (as texts) and of held-out errors, for the report and for `diagnosis.json`.

    Both plants must have the same outputs; parameters are matched by flat name.
    """
    theirs, ours = published.flat(), found.flat()
    rows = []
    for name in dict.fromkeys((*theirs, *ours)):
        here, there = ours.get(name), theirs.get(name)
        unit = next(p.unit for p in (here, there) if p is not None)
        apart = "–"
        if here is not None and there is not None:
            spread = math.hypot(here.std, there.std)
            apart = f"{(here.value - there.value) / spread:+.1f} σ" if spread > 0.0 else "–"
        cells = [("–", "–") if p is None else (f"{p.value:.5g}", f"{p.std:.2g}") for p in (here, there)]
        rows.append([name, unit, *cells[0], *cells[1], apart])
    for label, errors in held_out_errors(published, found, free_run, windows, sigmas).items():
        rows.append([label[0], label[1], f"{errors[0]:.4g}", "–", f"{errors[1]:.4g}", "–", "–"])
    return {"source": published.name, "rows": rows}


def held_out_errors(
    published: Plant, found: Plant, free_run: Sequence[Segment], windows: Sequence[Segment], sigmas: Float
) -> dict[tuple[str, str], tuple[float, float]]:
    """Errors of (found, published) by (what, unit): free over the whole held-out part, and by window."""
    units = channel_units(found)
    errors: dict[tuple[str, str], tuple[float, float]] = {}
    for column, name in enumerate(found.structure.outputs):
        free, short = [], []
        for plant in (found, published):
            residuals = [s.judged[:, column] - predict(plant, s, sigmas)[:, column] for s in free_run]
            free.append(rms(np.concatenate(residuals)))
            short.append(float(np.sqrt(np.mean(windowed_rms(plant, windows, sigmas)[name] ** 2))))
        errors[f"held-out {name}, free run", units[name]] = (free[0], free[1])
        errors[f"held-out {name}, windows", units[name]] = (short[0], short[1])
    return errors
