"""The whole diagnosis: refit, locate, name, model, verify; from files to files."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ground.diagnose.belonging import amount
from ground.diagnose.between import between_samples
from ground.diagnose.candidates import label_of
from ground.diagnose.chosen import Named
from ground.diagnose.compare import compare_with
from ground.diagnose.confirm import HeldOutViews, holds, searched
from ground.diagnose.evidence import Evidence, LocatedForce
from ground.diagnose.findings import findings_of, next_run, unexplained, verdict_of
from ground.diagnose.fit import Fit, fit_plant
from ground.diagnose.locate import LocateTask, locate, still_missing
from ground.diagnose.name import Search
from ground.diagnose.nameless import with_formula
from ground.diagnose.needed import needed
from ground.diagnose.outlook import Outlook
from ground.diagnose.periods import with_periods
from ground.diagnose.power import power_of, untestable
from ground.diagnose.problem import PRIOR_REACH
from ground.diagnose.result import Diagnosis
from ground.diagnose.scales import find_scales
from ground.diagnose.segments import (
    Segment,
    channel_sigmas,
    last_part,
    segment_of,
    sensor_sigma,
    sigma_vector,
    split_last_part,
    starts_anywhere,
)
from ground.diagnose.tension import strained
from ground.diagnose.unlike_units import unlike_units, unstated_units
from ground.diagnose.verify import Verified, verify, windowed_rms
from ground.diagnose.windows import runs_away, segments_to_fit
from ground.diagnose.withdraw import withdrawals
from ground.diagnose.workers import APPROACH, FINAL_TOLERANCE, Workers
from ground.files import check_place, write_atomic
from ground.progress import Show, nobody
from ground.recordings.model import Recording
from sim_hal.plant.simulate import Plant, compile_plant

Float = NDArray[np.float64]

HELD_OUT_SHARE = 0.25
"""Last part of a single recording that the fit never sees."""
LEAST_SAMPLES = 30


RESULTS = ("diagnosis.json", "plant.yaml", "report.html")
"""What a diagnosis leaves in its folder; the first says that the others are its own."""


class DiagnosisError(ValueError):
    """The recordings cannot be diagnosed with this plant; the message says why and what to do."""


@dataclass(frozen=True)
class Data:
    """Recordings split into what is fitted and what is held out, as segments of the plant."""

    fitted: tuple[Recording, ...]
    held_out: tuple[Recording, ...]
    windows: tuple[Segment, ...]
    whole: tuple[Segment, ...]
    held_out_whole: tuple[Segment, ...]
    held_out_windows: tuple[Segment, ...]
    sigmas: Float
    noise: Mapping[str, float]
    single: bool
    by_windows: bool  # the plant runs away when run free: what is held out is judged in windows alone

    def finer(self, names: Sequence[str]) -> Float:
        """How many times finer each sensor is than the plant is judged, (outputs,), outputs named in order."""
        noise = np.array([self.noise.get(name, math.nan) for name in names])
        return np.where(noise > 0.0, self.sigmas / np.where(noise > 0.0, noise, 1.0), 1.0)


@dataclass(frozen=True)
class Outcome:
    """A diagnosis with its extended plant and the evidence to show."""

    diagnosis: Diagnosis
    plant: Plant
    evidence: Evidence


def prepare(recordings: Sequence[Recording], plant: Plant) -> Data:
    """Split whole recordings into fitted and held out; one recording alone gives its last part away."""
    for recording in recordings:
        if recording.times_s.size < LEAST_SAMPLES:
            raise DiagnosisError(
                f"{recording.source or recording.run}: {recording.times_s.size} samples; a diagnosis needs at least "
                f"{LEAST_SAMPLES} in each recording"
            )
    if not recordings:
        raise DiagnosisError("no recordings were given")
    if len(recordings) == 1:
        first, last = split_last_part(recordings[0], HELD_OUT_SHARE)
        fitted: tuple[Recording, ...] = (first,)
        held_out: tuple[Recording, ...] = (last,)
    else:
        fitted, held_out = split_whole(recordings)
    compiled = compile_plant(plant)
    names = compiled.output_names
    sigmas = channel_sigmas(fitted, plant, names)
    still = [name for name, sigma in sigmas.items() if not sigma > 0.0]
    if still:
        raise DiagnosisError(
            f"channel {still[0]!r} reads the same in every recording that is fitted, and nothing says how finely: "
            "state noise_std or resolution under sensors, or leave the channel out"
        )
    windows = segments_to_fit(held_out, plant, compiled)
    whole = tuple(segment_of(recording, plant, compiled) for recording in held_out)
    by_windows = runs_away(held_out, plant, compiled)
    if by_windows:
        whole = windows
    if len(recordings) == 1 and not starts_anywhere(compiled):
        windows = whole = (last_part(recordings[0], plant, compiled, HELD_OUT_SHARE),)
    return Data(
        fitted=fitted,
        held_out=held_out,
        windows=segments_to_fit(fitted, plant, compiled),
        whole=tuple(segment_of(r, plant, compiled) for r in fitted),
        held_out_whole=whole,
        held_out_windows=windows,
        sigmas=sigma_vector(sigmas, names),
        noise={name: sensor_sigma(fitted, plant, name) for name in sigmas},
        single=len(recordings) == 1,
        by_windows=by_windows,
    )


def split_whole(
    recordings: Sequence[Recording],
) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    """A quarter of the recordings, at least one, held out: the last whose surface the others have met as well."""
    wanted = max(1, len(recordings) // 4)
    surfaces = [str(recording.conditions.get("surface", "")) for recording in recordings]
    held: list[int] = []
    for number in reversed(range(len(recordings))):
        rest = [s for i, s in enumerate(surfaces) if i != number and i not in held]
        if len(held) < wanted and surfaces[number] in rest:
            held.append(number)
    held = held or [len(recordings) - 1]
    fitted = tuple(r for i, r in enumerate(recordings) if i not in held)
    return fitted, tuple(recordings[i] for i in sorted(held))


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
    data = prepare(recordings, plant)
    if reference is not None:  # refused now, if it does not go with the recordings, and not after the search
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
        search = Search(workers, outlook, plant, with_periods(scales, forces))
        unseen = HeldOutViews(data.held_out_windows, data.held_out_whole)
        named, failed = searched(search, refit, unseen)
        if unexplained(named.fit, data.windows):
            outlook.say("looking for a formula")
            left = locate(named.fit, data.windows, data.whole[0], data.sigmas, scales, workers)
            with_law = with_formula(named, left[0], workers) if left else named
            named = with_law if holds(with_law, search, unseen) else named
        if named.chosen and forces:
            typical = scales[forces[0].equation]["F"]
            task = LocateTask(
                *(named.fit, data.windows, data.whole[0], data.sigmas), forces[0].equation, typical
            )
            forces[0] = still_missing(forces[0], task, workers.context)
    outlook.begin("verify", "verifying on what was held out")
    refitted = plant.with_values(refit.values)
    extended = settled_plant(named.fit, plant)
    plants = {"nominal": plant, "refit": refitted, "extended": extended}
    verified = verify(plants, data.held_out_whole, data.sigmas, data.noise)
    result = conclude(data, plant, refit, named, verified, forces, plants)
    lost = (
        f"Left out again, as what was held out is predicted no better with it: {name}." for name in failed
    )
    result = replace(result, notes=(*(w.words for w in needless), *lost, *result.notes))
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


def notes_of(data: Data, plant: Plant, refit: Fit, named: Named) -> tuple[str, ...]:
    """What a reader must keep in mind."""
    notes = [
        *unlike_units(plant, data.whole),
        *unstated_units(plant),
        amount((*data.fitted, *data.held_out), data.single),
    ]
    if data.by_windows:
        notes.append(
            "Run free, this plant runs away from what was recorded: it was fitted, and judged on what was held out, "
            f"in windows of {data.windows[0].samples} samples, each with a start of its own."
        )
    notes += needed(named.chosen, plant)
    if data.single:
        notes.append(
            f"There was one recording: its last {HELD_OUT_SHARE:.0%} was held out, so what changes from run to run "
            "was not tested. A second recording would."
        )
    notes += between_samples(plant, named.fit.plant)
    notes += strained(named.fit) if named.chosen else ()
    stated = refit.plant.flat()
    for name, value in named.fit.values.items():
        if name in stated and stated[name].std > 0.0:
            away = (value - stated[name].value) / stated[name].std
            if abs(away) > PRIOR_REACH - 0.01:
                notes.append(f"{name} ends at the edge of its tolerance ({away:+.1f} sigma).")
    refused = ", ".join(f"{label_of(candidate)} ({p:.2f})" for candidate, p in named.refused)
    if refused:
        notes.append(f"Tried last and not taken (probability of predicting better in brackets): {refused}.")
    return tuple(notes)


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
