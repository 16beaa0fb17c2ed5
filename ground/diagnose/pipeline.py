"""The whole diagnosis: refit, locate, name, model, verify; from files to files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ground.diagnose.between_runs import differing, scatter_of, widened
from ground.diagnose.chosen import Named
from ground.diagnose.compare import compare_with
from ground.diagnose.confirm import searched
from ground.diagnose.data import Data, prepare
from ground.diagnose.evidence import Evidence, LocatedForce
from ground.diagnose.findings import findings_of, next_run, unexplained, verdict_of
from ground.diagnose.fit import Fit, fit_plant
from ground.diagnose.locate import LocateTask, locate, still_missing
from ground.diagnose.name import Search
from ground.diagnose.nameless import with_a_law
from ground.diagnose.notes import notes_of
from ground.diagnose.outlook import Outlook
from ground.diagnose.periods import with_periods
from ground.diagnose.power import power_of, untestable
from ground.diagnose.result import Diagnosis
from ground.diagnose.scales import find_scales
from ground.diagnose.segments import segment_of
from ground.diagnose.unseen import HeldOutViews
from ground.diagnose.verify import Verified, verify, windowed_rms
from ground.diagnose.withdraw import withdrawals
from ground.diagnose.workers import APPROACH, FINAL_TOLERANCE, Workers
from ground.files import check_place, write_atomic
from ground.progress import Show, nobody
from ground.recordings.model import Recording
from ground.recordings.open_starts import unstated_starts, with_open_starts
from sim_hal.plant.simulate import Plant, compile_plant

RESULTS = ("diagnosis.json", "plant.yaml", "report.html")
"""What a diagnosis leaves in its folder; the first says that the others are its own."""


@dataclass(frozen=True)
class Outcome:
    """A diagnosis with its extended plant and the evidence to show."""

    diagnosis: Diagnosis
    plant: Plant
    evidence: Evidence


def diagnose(
    recordings: Sequence[Recording],
    plant: Plant,
    show: Show = nobody,
    reference: Plant | None = None,
    processes: int = 1,
) -> Outcome:
    """Compare the plant's simulation with the recordings and say what it lacks.

    `reference` is a published model of the rig; it takes no part, it is only compared with what was found.
    `show` is told how far it is, about. Raises `DiagnosisError`, `RecordingError` or `SimulationError`, all with
    words for a person.
    """
    unstated = unstated_starts(plant, recordings)
    plant = with_open_starts(plant, recordings)
    data = prepare(recordings, plant)
    if reference is not None:  # refused now, if it does not go with the recordings, and not after the search
        reference = with_open_starts(reference, recordings)
        segment_of(data.held_out[0], reference, compile_plant(reference))
    outlook = Outlook(show)
    outlook.begin("refit", "refitting the plant's own parameters")
    refit = fit_plant(
        *(plant, data.windows, data.sigmas, {}),
        tolerance=FINAL_TOLERANCE,
        precise=True,
        approach=APPROACH,
    )
    scales = find_scales(refit, data.windows)
    with Workers(data.windows, data.sigmas, scales, processes) as workers:
        outlook.begin("locate", "locating what is missing")
        forces = locate(refit, data.windows, data.whole[0], data.sigmas, scales, workers)
        needless = withdrawals(refit, plant, workers) if plant.effects else ()
        unseen = HeldOutViews(data.held_out_windows, data.held_out_whole)
        search = Search(workers, outlook, plant, with_periods(scales, forces), unseen.windows)
        named, failed = searched(search, refit, unseen)
        if unexplained(named.fit, data.windows):
            outlook.say("looking for a formula")
            left = locate(named.fit, data.windows, data.whole[0], data.sigmas, scales, workers)
            named = with_a_law(named, refit, forces, left, search, unseen)
        if named.chosen and forces:
            typical = scales[forces[0].equation]["F"]
            task = LocateTask(
                *(named.fit, data.windows, data.whole[0], data.sigmas), forces[0].equation, typical
            )
            forces[0] = still_missing(forces[0], task, workers.context)
    outlook.begin("verify", "verifying on what was held out")
    # what is not understood yet may differ from run to run for that
    told = () if unexplained(named.fit, data.windows) else (*data.windows, *data.held_out_windows)
    scatters = scatter_of(named.fit, told, data.sigmas)
    named = replace(named, fit=widened(named.fit, scatters, [r.run for r in data.fitted]))
    refitted = plant.with_values(refit.values)
    extended = settled_plant(named.fit, plant)
    plants = {"nominal": plant, "refit": refitted, "extended": extended}
    verified = verify(plants, data.held_out_whole, data.sigmas, data.noise)
    result = conclude(data, plant, refit, named, verified, forces, plants)
    lost = (
        f"Left out again, as what was held out is predicted no better with it: {name}." for name in failed
    )
    opened: tuple[str, ...] = ()
    if unstated:
        names = ", ".join(f"state.{name}" for name in unstated)
        opened = (f"Not all recordings tell how they start ({names}): that was fitted.",)
    result = replace(
        result,
        notes=(*opened, *(w.words for w in needless), *lost, *differing(scatters), *result.notes),
        details={**result.details, "between_runs": [one.content for one in scatters]},
    )
    if reference is not None:
        compared = compare_with(reference, extended, data.held_out_whole, data.held_out_windows, data.sigmas)
        result = replace(result, details={**result.details, "reference": compared})
    return Outcome(result, extended, Evidence(verified.traces, tuple(forces)))


def settled_plant(fit: Fit, given: Plant) -> Plant:
    """The plant that the fit found: effects with their sigmas; nominal parameters at their fitted values.

    A nominal parameter keeps the smaller of its tolerance and its fitted sigma.
    """
    stated = given.flat()
    std = {name: min(sigma, stated[name].std) if name in stated else sigma for name, sigma in fit.std.items()}
    return fit.plant.with_values(fit.values, std)


def conclude(
    data: Data,
    plant: Plant,
    refit: Fit,
    named: Named,
    verified: Verified,
    forces: Sequence[LocatedForce],
    plants: Mapping[str, Plant],
) -> Diagnosis:
    """Put the answer together."""
    findings = findings_of(named, refit, data.windows, forces)
    windows = {name: windowed_rms(p, data.held_out_windows, data.sigmas) for name, p in plants.items()}
    return Diagnosis(
        plant=plant.name,
        fitted=tuple(r.run for r in data.fitted),
        held_out=tuple(r.run for r in data.held_out),
        verdict=verdict_of(named, refit, data.windows, data.finer(tuple(plant.structure.outputs))),
        findings=findings,
        fit=verified.fit,
        residual_whiteness=verified.whiteness,
        next_experiment=next_run(named, findings, data.windows, data.sigmas),
        notes=notes_of(data, plant, refit, named),
        details={
            "windowed_rms": {
                channel: {name: float(np.sqrt(np.mean(windows[name][channel] ** 2))) for name in plants}
                for channel in verified.fit
            },
            "nominal_parameters": {
                name: {
                    "refit": refit.values[name],
                    "extended": named.fit.values[name],
                    "std": named.fit.std[name],
                }
                for name in refit.values
            },
            "power": power_of(named.screened),
            "untestable": untestable(named.screened),
            "located": [
                {
                    "equation": f.equation,
                    "log_likelihood_gain": f.log_likelihood_gain,
                    "explained": dict(f.explained),
                }
                for f in forces
            ],
        },
    )


def write_outcome(outcome: Outcome, folder: Path) -> None:
    """Write diagnosis.json, plant.yaml and report.html, each whole or not at all.

    Raises `ConfigError` where one of them would replace a file that is no earlier diagnosis's.
    """
    from ground.report.diagnosis_page import write_diagnosis_page
    from ground.typeset import equations_of, mathml
    from sim_hal.plant.simulate import save_plant

    check_place(folder, RESULTS[0], RESULTS)
    folder.mkdir(parents=True, exist_ok=True)
    save_plant(outcome.plant, folder / "plant.yaml")
    text = (folder / "plant.yaml").read_text(encoding="utf-8")
    equations = [mathml(equation) for equation in equations_of(outcome.plant)]
    write_diagnosis_page(folder / "report.html", outcome.diagnosis, outcome.evidence, text, equations)
    write_atomic(folder / "diagnosis.json", outcome.diagnosis.to_json())
