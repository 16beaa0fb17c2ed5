"""One group of recordings from diagnosis to scores."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.case_studies.black_box import fit_narx
from benchmarks.case_studies.scores import Predictor, Score, blocks_of, by_plant, scored, squares, windows_of
from benchmarks.case_studies.sparse import sparse_terms, with_terms
from benchmarks.case_studies.study import Study
from ground.diagnose.data import prepare
from ground.diagnose.evidence import LocatedForce
from ground.diagnose.fit import fit_plant
from ground.diagnose.locate import (
    cause_series,
    explained_by,
    state_sizes,
    state_space,
    thinned,
    without_start,
)
from ground.diagnose.pipeline import diagnose, write_outcome
from ground.diagnose.scales import find_scales
from ground.diagnose.segments import Segment
from ground.diagnose.smoothing import smooth
from ground.progress import steps_of
from ground.recordings.model import Recording
from hal.config import config_path
from sim_hal.plant.simulate import MISSING_FORCE, Plant, SimulationError, load_plant

Float = NDArray[np.float64]

GIVEN, REFIT, FOUND = "plant as given", "its parameters refitted", "with what was found"
PUBLISHED, SPARSE, BLACK_BOX = "published model", "sparse regression (PySINDy)", "black box (NARX)"
PHYSICAL = (GIVEN, REFIT, PUBLISHED, SPARSE)
BOX_WINDOWS = 60
"""At most so many windows teach the black box."""
STEPS = 300
WANDER = 10.0
"""Random-walk intensity of the missing force: its wander over a recording, squared, in typical forces."""
BLOCKS = 20


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
    tell: Callable[[str], None],
) -> Result:
    """Diagnose (unless `out` holds a diagnosis already), then score everything on the same held-out data."""
    if not (out / "diagnosis.json").is_file():
        write_outcome(diagnose(recordings, plant, steps_of(tell)), out)
    diagnosis = json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))
    tell("scoring beside the rivals")
    data = prepare(recordings, plant)
    refit = fit_plant(plant, data.windows, data.sigmas, {})
    models = {GIVEN: plant, REFIT: plant.with_values(refit.values), FOUND: load_plant(out / "plant.yaml")}
    if study.published:
        models[PUBLISHED] = load_plant(config_path("plant", f"{study.published}.yaml"))
    balance = balance_of(diagnosis, plant)
    typical = find_scales(refit, data.windows)[balance]["F"]
    lacking = ForceOf(balance, typical, data.sigmas)
    taught = lacking(models[REFIT], data.whole[0])
    terms: dict[str, float] = sparse_terms(taught) if taught else {}
    if taught and terms and (sparse := with_terms(models[REFIT], taught, terms)) is not None:
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
    tell("estimating the force that each plant lacks")
    forces = {name: lacking(model, data.held_out_whole[0]) for name, model in models.items()}
    longest = max(windows, key=lambda segment: float(np.nanmax(np.abs(segment.observed[:, 0]))))
    return Result(
        label=label,
        diagnosis=diagnosis,
        plant=models[FOUND],
        windowed=table(predictors, windows, plant),
        free=table(predictors, whole, plant),
        force={name: scored([f.before[:, None] ** 2], 0, BLOCKS) for name, f in forces.items() if f},
        force_unit=plant.structure.balances[balance].unit,
        before=forces[REFIT],
        after=forces[FOUND],
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


def balance_of(diagnosis: Mapping[str, Any], plant: Plant) -> str:
    """The balance equation that the first finding enters, else the plant's first."""
    names = [finding["equation"] for finding in diagnosis["findings"]]
    return next(
        (name for name in names if name in plant.structure.balances), next(iter(plant.structure.balances))
    )


@dataclass(frozen=True)
class ForceOf:
    """Estimates the force that a plant lacks in one balance along a recording, by smoothing."""

    balance: str
    typical: float
    sigmas: Float

    def __call__(self, plant: Plant, segment: Segment) -> LocatedForce | None:
        segment = without_start(segment, plant)
        sizes = state_sizes(plant, [segment], [{}]) | {MISSING_FORCE: self.typical}
        space = state_space(plant, self.balance, thinned(segment, STEPS), self.sigmas, sizes)
        duration = float(segment.run.times_s[-1] - segment.run.times_s[0])
        try:
            smoothed = smooth(space, WANDER * self.typical**2 / duration)
            causes = cause_series(plant, self.balance, segment, space, smoothed)
        except (SimulationError, np.linalg.LinAlgError):
            return None
        if not np.isfinite(smoothed.force).all():
            return None
        return LocatedForce(
            equation=self.balance,
            run=segment.run_name,
            unit=plant.structure.balances[self.balance].unit,
            times_s=space.times_s,
            before=smoothed.force,
            before_std=smoothed.force_std,
            after=None,
            causes=causes,
            explained={n: explained_by(v, smoothed.force, smoothed.force_std) for n, v in causes.items()},
            log_likelihood_gain=0.0,
        )
