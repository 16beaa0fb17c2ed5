"""One group of recordings from diagnosis to scores."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.case_studies.black_box import fit_narx
from benchmarks.case_studies.scores import Predictor, Score, blocks_of, by_plant, scored, squares, windows_of
from benchmarks.case_studies.sparse import sparse_terms, with_terms
from benchmarks.case_studies.study import Study
from ground.diagnose.evidence import LocatedForce
from ground.diagnose.fit import Fit, fit_plant
from ground.diagnose.locate import locate, locate_in
from ground.diagnose.pipeline import Data, diagnose, prepare, write_outcome
from ground.diagnose.scales import find_scales
from ground.diagnose.segments import Segment
from ground.diagnose.workers import Workers
from ground.recordings.model import Recording
from hal.config import config_path
from sim_hal.plant.simulate import Plant, load_plant

Float = NDArray[np.float64]

GIVEN, REFIT, FOUND = "plant as given", "its parameters refitted", "with what was found"
PUBLISHED, SPARSE, BLACK_BOX = "published model", "sparse regression (PySINDy)", "black box (NARX)"
PHYSICAL = (GIVEN, REFIT, PUBLISHED, SPARSE)
BOX_WINDOWS = 160
"""At most so many windows teach the black box."""


@dataclass(frozen=True)
class Result:
    """What came of one group: the diagnosis as its file has it, plants, scores by model and channel, traces."""

    label: str
    diagnosis: Mapping[str, Any]
    plant: Plant
    windowed: Mapping[str, Mapping[str, Score]]
    free: Mapping[str, Mapping[str, Score]]
    force: Mapping[str, Score]
    force_unit: str
    before: LocatedForce | None
    after: LocatedForce | None
    window: Segment
    traces: Mapping[str, Float]
    sparse: Mapping[str, float]


def run_group(
    study: Study,
    label: str,
    recordings: Sequence[Recording],
    unseen: Sequence[Recording],
    plant: Plant,
    out: Path,
    say: Callable[[str], None],
) -> Result:
    """Diagnose (unless `out` holds a diagnosis already), then score everything on the same held-out data."""
    if not (out / "diagnosis.json").is_file():
        write_outcome(diagnose(recordings, plant, say), out)
    diagnosis = json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))
    say("scoring beside the rivals")
    data = prepare(recordings, plant)
    refit = fit_plant(plant, data.windows, data.sigmas, {})
    models = {GIVEN: plant, REFIT: plant.with_values(refit.values), FOUND: load_plant(out / "plant.yaml")}
    if study.published:
        models[PUBLISHED] = load_plant(config_path("plant", f"{study.published}.yaml"))
    forces = located(refit, data)
    terms: dict[str, float] = sparse_terms(forces[0]) if forces else {}
    if terms and (sparse := with_terms(models[REFIT], forces[0], terms)) is not None:
        models[SPARSE] = sparse
    held_out = [*data.held_out, *unseen]
    windows = windows_of(held_out, plant, study.window_samples)
    predictors: dict[str, Predictor] = {name: by_plant(model, data.sigmas) for name, model in models.items()}
    teach = windows_of(data.fitted, plant, study.window_samples)
    spread = np.unique(np.linspace(0, len(teach) - 1, min(BOX_WINDOWS, len(teach))).round().astype(int))
    box = fit_narx([teach[i] for i in spread], tuple(plant.structure.inputs))
    if box is not None:
        predictors[BLACK_BOX] = box
    whole = windows_of(held_out, plant, max(r.times_s.size for r in held_out))
    after = None
    if forces:
        after = missing(models[FOUND], refit, data, forces[0].equation, data.whole[0])
    longest = max(windows, key=lambda segment: float(np.nanmax(np.abs(segment.observed[:, 0]))))
    return Result(
        label=label,
        diagnosis=diagnosis,
        plant=models[FOUND],
        windowed=table(predictors, windows, plant),
        free=table(predictors, whole, plant),
        force=force_errors(models, refit, data, forces[0].equation) if forces else {},
        force_unit=forces[0].unit if forces else "",
        before=forces[0] if forces else None,
        after=after,
        window=longest,
        traces={name: predictors[name](longest)[:, 0] for name in (REFIT, FOUND)},
        sparse=terms,
    )


def table(
    predictors: Mapping[str, Predictor], windows: Sequence[Segment], plant: Plant
) -> dict[str, dict[str, Score]]:
    """Scores by model and channel."""
    found = {}
    for name, predictor in predictors.items():
        errors = squares(predictor, windows)
        parts = blocks_of(windows)
        found[name] = {
            channel: scored(errors, column, parts) for column, channel in enumerate(plant.structure.outputs)
        }
    return found


def located(refit: Fit, data: Data) -> list[LocatedForce]:
    """The forces that the refitted plant lacks, likeliest first."""
    scales = find_scales(refit, data.windows)
    with Workers(data.windows, data.sigmas, scales, 1) as workers:
        return locate(refit, data.windows, data.whole[0], data.sigmas, scales, workers)


def missing(plant: Plant, refit: Fit, data: Data, balance: str, segment: Segment) -> LocatedForce | None:
    """The force that a plant lacks on a segment."""
    scales = find_scales(refit, data.windows)
    fit = replace(refit, plant=plant, values={name: p.value for name, p in plant.flat().items()})
    return locate_in(fit, segment, data.sigmas, balance, scales[balance]["F"])


def force_errors(models: Mapping[str, Plant], refit: Fit, data: Data, balance: str) -> dict[str, Score]:
    """Root mean square of the force that each plant lacks on the first held-out recording."""
    found = {}
    for name, plant in models.items():
        force = missing(plant, refit, data, balance, data.held_out_whole[0])
        if force is not None:
            found[name] = scored([force.before[:, None] ** 2], 0, 20)
    return found
